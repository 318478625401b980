"""The operator's terminal: passes the recorder's news to the screens and their orders back."""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual import on, work
from textual.app import SystemCommand
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.screen import ModalScreen, Screen

from daq import InputError
from daq.control import messages
from daq.control.exchange import OrderRefusedError
from daq.control.messages import Live, Order, Reply, Setup, Status
from daq.files import write_bytes
from dbc.words import printable

from .campaign import BenchStep, in_first_runs, in_run, is_marked, progress
from .device import THEMES, KeyboardApp
from .feed import Lanes, Lost, News, RecorderFeed, Role
from .widgets import Confirm, HelpScreen, LinkScreen, Question
from .words import DisplayLink, Glyphs, Signal, signal_of

if TYPE_CHECKING:
    from daq.bench.config import Bench

RECORDER_GOES_ON = (
    "The recorder goes on. The same command brings you back to where you were;"
    ' to end the recorder, press Ctrl+P there and choose "recorder: shut down".'
)
"""Text that a closed terminal leaves on stderr."""
_WIDTHS = [(0, "-narrow"), (120, "-wide"), (180, "-huge")]
"""Numbers of columns from which a screen has a style class."""
_MODULES = {"home": "bumping", "identify": "work", "report": "work"}
"""Modules of screens that have another name than the screen."""


class NewsArrived(Message):
    """The feed has posted news."""


class StateChanged(Message):
    """A new status of the recorder is in `app.status`, or `app.lost` says why there is none."""


class LiveArrived(Message):
    """New samples are in `app.lanes`."""


def _new_screen(name: str) -> Screen[Any]:
    """Return a new screen; its module is imported only now, to open the first screen at once."""
    module = import_module(f".screens.{_MODULES.get(name, name)}", __package__)
    screen: Screen[Any] = getattr(module, f"{name.capitalize()}Screen")()
    return screen


class BenchApp(KeyboardApp):
    """A client of one recorder.

    `folder`: the recorder's; sessions, reports and drafts are in it.  `operator`: the person; the
    journal stores this name with every verdict.  `auto`: press SPACE whenever there is a next
    action.  `clock`: monotonic seconds, for held keys.  `wanted`: setup that its recorder should
    have; None if any will do.  `display`: link of the display that was started with the terminal.
    """

    CSS_PATH = "app.tcss"
    TITLE = "Bumpbench"
    NOTIFICATION_TIMEOUT = 20.0
    """Seconds for which a message stands: the operator may be at the car."""
    HORIZONTAL_BREAKPOINTS = _WIDTHS
    SCREENS: ClassVar[dict[str, Callable[[], Screen[Any]]]] = {
        name: partial(_new_screen, name)
        for name in (*(step.screen for step in BenchStep), "results")
    }
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("x", "start_recorder", "Start recorder"),
        Binding("f1", "help", "Help", priority=True),
        Binding("1", "step(1)", "Step", key_display="1-7", tooltip="Go to a step"),
        *(Binding(str(i), f"step({i})", show=False) for i in range(2, 8)),
        Binding("n", "note", "Note", tooltip="Write a note on the session"),
        Binding("c", "take_over", show=False, tooltip="Take control"),
        Binding("ctrl+q", "quit", show=False, priority=True, tooltip="Close the terminal"),
    ]

    def __init__(
        self,
        feed: RecorderFeed,
        folder: Path,
        glyphs: Glyphs,
        operator: str,
        theme: str = "bench-dark",
        auto: bool = False,
        clock: Callable[[], float] = time.monotonic,
        wanted: Setup | None = None,
        display: DisplayLink | None = None,
    ) -> None:
        super().__init__(clock)
        for registered in THEMES:
            self.register_theme(registered)
        self.theme = theme
        self.feed, self.folder, self.glyphs, self.operator = feed, folder, glyphs, operator
        self.auto, self.display_link = auto, display
        self.status: Status | None = None
        """Newest status of the recorder; None before the first, kept after the recorder is lost."""
        self.lost: Lost | None = None
        """Why the recorder does not answer; None while it does."""
        self.in_control = False
        self.lanes = Lanes()
        self.bench: Bench | None = None
        """The bench in force; None until the recorder has sent it."""
        self.bench_text = ""
        # News not processed yet: one minute of it, if the output of the terminal is stopped.
        self._news: deque[News] = deque(maxlen=1200)
        self._has_begun = False  # once the first screen of the campaign has been chosen
        self._wanted_setup = wanted
        self._shown_halt = ""  # reason of the halt whose help was shown; empty without a halt

    # News ---------------------------------------------------------------------------------------

    async def on_mount(self) -> None:
        """Start the feed; the first status decides which screen comes first."""
        self.feed.start(self.post)  # the feed connects while the screen is built
        await self.push_screen("home")
        if self.auto:
            self.set_interval(0.25, self._press_next)

    def on_unmount(self) -> None:
        """Stop the feed; the recorder goes on."""
        self.feed.stop()

    def post(self, news: News) -> None:
        """Queue news; called from the feed's thread."""
        if isinstance(news, Role):  # at once: of too many news some are not kept
            self.in_control = news.in_control
        self._news.append(news)
        if len(self._news) == 1:  # one message handles all that is queued
            with suppress(RuntimeError):  # the app has just ended
                self.post_message(NewsArrived())

    @on(NewsArrived)
    async def _process_news(self) -> None:
        """Process all queued news; of several statuses only the newest, and none before a loss."""
        if not self.screen_stack:  # the app is closing
            return
        status: Status | None = None
        has_samples = False
        while self._news:
            news = self._news.popleft()
            if isinstance(news, Status):
                status = news
            elif isinstance(news, Live):
                self.lanes.add(news)
                has_samples = True
            elif isinstance(news, Role):
                if news.text:
                    self.warn(news.text)
            elif isinstance(news, Setup):
                self._compare_setup(news)
            else:  # the recorder is lost, and so a status before it is out of date
                self._ring(signal_of(self.lost, news))
                self.lost, status = news, None
                self._publish(StateChanged())
                if isinstance(self.screen, HelpScreen):
                    self.screen.dismiss()  # the screen below shows what to do
                elif isinstance(self.screen, ModalScreen) and not news.starting:
                    self.warn("RECORDER LOST: Esc, then X = start it again")
        if status is not None:
            await self._process_status(status)
        if has_samples:
            self._publish(LiveArrived())

    async def _process_status(self, status: Status) -> None:
        """Take in a status: change the screen where a run begins, ring, and show it.

        A run that the display or another terminal has armed also takes the place of steps 1 and 2.
        """
        previous, self.status, self.lost = self.status, status, None
        if previous is not None and previous.recording != status.recording:
            self.lanes.clear()
        run_begins = previous is not None and not in_run(previous) and in_run(status)
        # While a dialog is in front no screen is changed: the dialog would be stranded.
        if self.screen is self.get_screen("home") and not self._has_begun:
            self._has_begun = True
            await self._open_first(status)
        before_bumps = self.step in (BenchStep.VEHICLE, BenchStep.CHECK)
        if before_bumps and run_begins and in_first_runs(status):
            await self.open("home")
        self._ring(signal_of(previous, status))
        self._publish(StateChanged())
        if previous is None or previous.bench_crc32 != status.bench_crc32 or self.bench is None:
            self.call_after_refresh(self._fetch_bench)  # the screen comes first
        if status.halted and status.halted != self._shown_halt:
            self.push_screen(HelpScreen(status.halted))
        self._shown_halt = status.halted

    async def _open_first(self, status: Status) -> None:
        """Show the due step; without `--auto` also the display's link, and ask for the operator.

        The vehicle form asks for the operator's name itself.
        """
        step = BenchStep.BASELINE if in_first_runs(status) else progress(status).due
        await self.go_to(step)
        if self.auto:
            return

        async def answered(name: str | None) -> None:
            if name and await self.ask(messages.Hello(name, self.in_control)) is not None:
                self.operator = name

        if not self.operator and step is not BenchStep.VEHICLE:
            question = Question("Your name or initials, for every verdict", "name")
            self.push_screen(question, answered)
        self.action_display()

    def _publish(self, message: Message) -> None:
        """Send news to the screen in front; a worker may bring news after all are closed."""
        if self.screen_stack:
            self.screen.post_message(message)

    @work(group="bench", exclusive=True)
    async def _fetch_bench(self) -> None:
        """Get the bench in force from the recorder, and pass it to the screen."""
        with suppress(OrderRefusedError, InputError):
            self._store_bench((await self.feed.ask(messages.AskBench())).bench_text)
            if self.status is not None:
                self._publish(StateChanged())

    def _store_bench(self, text: str) -> None:
        """Store the bench in force, and its text.  Raises InputError if it is none."""
        from daq.bench.config import parse_bench

        self.bench = parse_bench(text, "bench.toml", self.folder, dbc_text="")
        self.bench_text = text

    def _compare_setup(self, running: Setup) -> None:
        """Ask once whether to attach to a recorder of another setup than the wanted one, if any."""
        wanted = self._wanted_setup
        if wanted is None or not (texts := messages.differences(running, wanted)):
            return
        self._wanted_setup = None

        def answered(attach: bool | None) -> None:
            if not attach:
                self.exit()

        words = printable(f"Another recorder runs here: {'; '.join(texts)}.", 400)
        self.push_screen(Confirm(words, "attach to it as it is", "leave it"), answered)

    def _ring(self, signal: Signal | None) -> None:
        """Ring the bell in the rhythm of a signal."""
        for at_s in signal.value if signal is not None else ():
            self.set_timer(at_s, self.bell) if at_s else self.bell()

    # Orders and messages ------------------------------------------------------------------------

    async def ask(self, order: Order) -> Reply | None:
        """Send an order; return None after a refusal, whose reason is shown to the operator."""
        if not self.in_control and not isinstance(order, messages.Question):
            self.warn("this terminal is a viewer: C asks for control")
            return None
        try:
            reply = await self.feed.ask(order)
        except OrderRefusedError as refused:
            self.warn(str(refused))
            return None
        if reply.status is not None:  # the next action depends on it
            self.post(reply.status)
            await self._process_news()
        return reply

    async def configure(self, edit: Callable[[str], str]) -> bool:
        """Send bench.toml as `edit` changes its text; return True if the recorder now has it.

        A mistake is shown to the operator; an unchanged text is not sent.
        """
        try:
            text = edit(self.bench_text)
        except InputError as error:
            self.warn(str(error))
            return False
        if text != self.bench_text:
            if await self.ask(messages.Configure(text)) is None:
                return False
            self._store_bench(text)  # now: the next edit begins with it
        return True

    async def finish(self, step: BenchStep) -> bool:
        """Mark a step as done unless it is; return False if the recorder has refused that."""
        is_done = self.status is not None and is_marked(self.status, step)
        return is_done or await self.ask(messages.Mark(step.mark)) is not None

    def store_form(self, name: str, values: Mapping[str, Any]) -> None:
        """Store the values of a form in a file of the recorder's folder, all or nothing."""
        try:
            write_bytes(self.folder / name, json.dumps(values).encode())
        except OSError as error:
            self.warn(f"{name} cannot be written: {error.strerror or error}")

    def warn(self, text: str) -> None:
        """Show the operator a warning above the keys, in place of the message before."""
        self.clear_notifications()
        self.notify(printable(text, 600), severity="warning", markup=False)

    def inform(self, text: str) -> None:
        """Show the operator above the keys that something is done."""
        self.clear_notifications()
        self.notify(printable(text, 600), markup=False)

    # Screens ------------------------------------------------------------------------------------

    @property
    def step(self) -> BenchStep | None:
        """The step of the screen in front; None for a dialog."""
        return getattr(self.screen, "step_shown", None)

    async def go_to(self, step: BenchStep) -> None:
        """Show the screen of a step."""
        await self.open(step.screen)

    async def open(self, name: str) -> Any:
        """Show a screen by its name, and return it; it keeps what was typed into it."""
        screen = self.get_screen(name)
        if self.screen is not screen:
            await self.switch_screen(name)
        return screen

    async def action_step(self, number: int) -> None:
        """Show the screen of a step if it is reached; of an identified recording the results."""
        step = BenchStep(number)
        if not progress(self.status).reached(step):
            self.warn(f"step {step.title} is not reached yet")
            return
        if step is BenchStep.IDENTIFY:
            identify: Any = self.get_screen("identify")
            if identify.valid_outcome is not None:
                await identify.show_results()
                return
        await self.go_to(step)

    def action_note(self) -> None:
        """Write a note on the session."""

        async def answered(text: str | None) -> None:
            if text and await self.ask(messages.Note(text)) is not None:
                self.inform("the note is in the recording")

        question = Question("Note on the session", "what the sensors do not see")
        self.push_screen(question, answered)

    def action_display(self) -> None:
        """Show how to open the display at the bench, if there is one."""
        if self.display_link is not None:
            self.push_screen(LinkScreen(self.display_link))

    def action_help(self) -> None:
        """Show the help of the screen in front; of the screen below if a dialog has none."""
        if isinstance(self.screen, HelpScreen):
            self.screen.dismiss()
            return
        pages = (getattr(screen, "help_page", "") for screen in reversed(self.screen_stack))
        self.push_screen(HelpScreen(next(filter(None, pages), "home")))

    async def action_quit(self) -> None:
        """Close the terminal; say below it how to come back and how to end the recorder."""
        self.exit(message=None if self.lost else RECORDER_GOES_ON)

    def action_take_over(self) -> None:
        """Ask for control of the recorder."""
        if not self.in_control:
            self.feed.take_over()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show X only while the recorder is lost."""
        if action == "start_recorder":
            return self.lost is not None and not self.lost.starting
        return super().check_action(action, parameters)

    async def action_start_recorder(self) -> None:
        """Start a recorder to replace the lost one."""
        try:
            await asyncio.to_thread(self.feed.restart)
        except OrderRefusedError as refused:
            self.warn(str(refused))

    async def _press_next(self) -> None:
        screen: Any = self.screen if self.screen_stack else None  # none while the app closes
        if getattr(screen, "ready", False) and self.status is not None:
            await screen.action_next()

    # The command palette ------------------------------------------------------------------------

    def get_system_commands(self, screen: Screen[Any]) -> Iterator[SystemCommand]:
        """Yield the commands that have no key of their own, by name, for Ctrl+P."""

        async def shut_down() -> None:
            if await self.ask(messages.ShutDown()) is not None:
                self.exit()

        words = "end this recording and derive its session file"
        yield SystemCommand("recorder: stop", words, partial(self.ask, messages.Stop()))
        yield SystemCommand("recorder: shut down", "end recorder and terminal", shut_down)
        if self.display_link is not None:
            words = "how to open the display at the bench"
            yield SystemCommand("display: link", words, self.action_display)
