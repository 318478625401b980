"""The operator's terminal: passes the recorder's news to the screens and their orders back."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from textual.binding import Binding, BindingType
from textual.command import Provider
from textual.filter import LineFilter
from textual.message import Message
from textual.screen import ModalScreen, Screen

from daq import InputError
from daq.control.client import OrderRefusedError
from daq.control.messages import Live, Reply, Setup, Status
from daq.control.orders import AskBench, AskHistory, Hello, Order, Question
from daq.errors import printable

from ..diagnostics import unknown_value
from .context import LiveArrived, RecorderLost, StatusArrived, begin
from .keyboard import KeyboardApp
from .look import THEMES, PlainAscii
from .screens.dialogs import OtherRecorder
from .state.campaign import SCREEN_OF, BenchStep, in_run, progress, waits_unarmed
from .state.feed import Feed, Lost, News, Role
from .state.glyphs import Glyphs, GlyphSet
from .state.lanes import Lanes
from .state.signals import Signals, signal_of
from .widgets.bars import LOST_IN_A_FIELD, MessageApp

if TYPE_CHECKING:
    from daq.bench.config import Bench

    from ..jobs.lines import Outcome
    from .screens.results import ResultsScreen
    from .screens.work import IdentifyScreen, ReportScreen

RECORDER_GOES_ON = (
    "The recorder goes on. The same command brings you back to where you were;"
    ' to end the recorder, press Ctrl+P there and choose "recorder: shut down".'
)
"""Text that a closed terminal leaves on stderr."""
_MODULES = {"home": "bumping", "run": "bumping", "identify": "work", "report": "work"}
"""Modules of screens that have another name than the screen."""


def _screen(module: str, name: str) -> Screen[Any]:
    """Return a new screen; its module is imported only now, to open the first screen at once."""
    made: Screen[Any] = getattr(import_module(f".screens.{module}", __package__), name)()
    return made


class ScreensApp(MessageApp):
    """An app with one screen of each kind, made when it is first opened."""

    SCREENS: ClassVar[dict[str, Callable[[], Screen[Any]]]] = {
        name: partial(_screen, _MODULES.get(name, name), f"{name.capitalize()}Screen")
        for name in (*SCREEN_OF.values(), "run", "results", "sessions")
    }

    def __init__(self) -> None:
        super().__init__()
        self.status: Status | None = None
        """Newest status of the recorder; None before the first."""

    @property
    def step(self) -> BenchStep | None:
        """The step of the screen in front; None for a dialog and for an earlier session."""
        return getattr(self.screen, "step_shown", None)

    async def go_to(self, step: BenchStep) -> None:
        """Show the screen of a step; the run screen while a run is in progress."""
        name = SCREEN_OF[step]
        if name == "home" and self.status is not None and in_run(self.status):
            name = "run"
        await self.open(name)

    async def open(self, name: str) -> None:
        """Show a screen by its name; it keeps what was typed into it."""
        if self.screen is not self.get_screen(name):
            await self.switch_screen(name)

    async def open_build(self) -> None:
        """Show the identify screen, build the recording's session file and identify it."""
        await self.open("identify")
        await self._identify_screen().build()

    async def open_identify(self, session: str, without: tuple[str, ...] = ()) -> None:
        """Show the identify screen and identify a session file, without the named runs."""
        await self.open("identify")
        self._identify_screen().begin(session, without)

    def _identify_screen(self) -> IdentifyScreen:
        return cast("IdentifyScreen", self.get_screen("identify"))

    async def open_results(self, outcome: Outcome) -> None:
        """Show the results of an identification."""
        cast("ResultsScreen", self.get_screen("results")).show_outcome(outcome)
        await self.open("results")

    async def open_report(self, session: str, write: bool = False) -> None:
        """Show the report screen of a session file; write the report at once if asked."""
        report = cast("ReportScreen", self.get_screen("report"))
        report.show_session(session)
        await self.open("report")
        if write:
            report.begin()

    async def action_step(self, number: int) -> None:
        """Show the screen of a step if it is reached; of an identified recording the results."""
        step = BenchStep(number)
        if not progress(self.status).reached(step):
            self.warn(f"step {step.title} is not reached yet")
        elif step is BenchStep.IDENTIFY and (outcome := self._identify_screen().valid_outcome):
            await self.open_results(outcome)
        else:
            await self.go_to(step)

    async def action_sessions(self) -> None:
        """Show the sessions of the folder."""
        await self.open("sessions")

    async def action_home(self) -> None:
        """Show the next action."""
        await self.open("home")

    def action_note(self, label: str = "") -> None:
        """Open a note on a run; on the session without a label."""
        from .screens.dialogs import NoteScreen

        self.push_screen(NoteScreen(label))

    def show_help(self, page: str) -> None:
        """Show a page of help over the screen."""
        from .screens.help import HelpScreen

        self.push_screen(HelpScreen(page))

    def action_help_quit(self) -> None:
        """Say what closes the terminal; Ctrl+C only copies text that is selected."""
        self.inform("Ctrl+Q closes the terminal; the recording continues")

    def action_help(self) -> None:
        """Show the help of the screen in front; of the screen below if a dialog has none."""
        from .screens.help import HelpScreen

        if isinstance(self.screen, HelpScreen):
            self.screen.dismiss()
            return
        pages = (getattr(screen, "HELP_PAGE", "") for screen in reversed(self.screen_stack))
        self.show_help(next(filter(None, pages), "home"))


HISTORY_S = 10.0
"""Seconds of samples that a new terminal asks for: more than the chart shows."""
AUTO_S = 0.25
"""Seconds between two checks of `--auto` for a next action."""
MOST_NEWS = 1200
"""Largest number of messages kept for a terminal whose output is stopped: one minute of news."""
_WIDTHS = [(0, "-narrow"), (120, "-wide"), (180, "-huge")]
_HEIGHTS = [(0, "-low"), (36, "-tall")]
"""Numbers of columns and rows from which a screen has a style class."""


def _palette() -> type[Provider]:
    from .palette import BenchCommands

    return BenchCommands


class NewsArrived(Message):
    """The feed has posted news."""


class BenchApp(ScreensApp, KeyboardApp):
    """A client of one recorder.

    `folder`: the recorder's; sessions and reports are in it.  `operator`: the person; the journal
    stores this name with every verdict.  `auto`: press SPACE whenever there is a next action.
    `clock`: monotonic seconds, for held keys.  `wanted`: setup of its recorder.  `choices`: file
    that keeps the choices of sound and big letters.
    """

    CSS_PATH = "app.tcss"
    TITLE = "Bumpbench"
    HORIZONTAL_BREAKPOINTS = _WIDTHS
    VERTICAL_BREAKPOINTS = _HEIGHTS
    COMMANDS: ClassVar[set[type[Provider] | Callable[[], type[Provider]]]] = {_palette}
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+q", "quit", "Close the terminal", show=False, priority=True),
        Binding("f1", "help", "Help", priority=True),
    ]

    def __init__(
        self,
        feed: Feed,
        folder: Path,
        glyphs: Glyphs,
        operator: str,
        theme: str = "bench-dark",
        auto: bool = False,
        clock: Callable[[], float] = time.monotonic,
        wanted: Setup | None = None,
        choices: Path | None = None,
    ) -> None:
        super().__init__()
        for made in THEMES:
            self.register_theme(made)
        if theme not in self.available_themes:
            raise unknown_value("--theme", theme, "theme", sorted(self.available_themes))
        self.theme = theme
        self.feed, self.folder, self.glyphs, self.operator = feed, folder, glyphs, operator
        self.auto, self.clock = auto, clock
        self.lost: Lost | None = None
        self.in_control = False
        self.lanes = Lanes()
        self.bench: Bench | None = None
        self.bench_text = ""
        self.signals = Signals(choices, self.bell, self.set_timer)
        self._ascii = PlainAscii()
        self.typed: dict[str, str] = {}
        self.answered = ""
        self._news: deque[News] = deque(maxlen=MOST_NEWS)
        self._role = Role(False)
        self._started = False
        self._other = OtherRecorder(self, wanted)
        self._halted, self._history_of = "", ""
        self.display_link: Callable[[], Screen[None]] | None = None

    # News ---------------------------------------------------------------------------------------

    async def on_mount(self) -> None:
        """Start the feed; the first status decides which screen comes first."""
        self.feed.start(self.post)  # the feed connects while the screen is built
        await self.push_screen("home")
        if self.auto:
            self.set_interval(AUTO_S, self._press_next)

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Add the filter that replaces all but ASCII, for a terminal that can show no more."""
        filters = super().get_line_filters()
        return [*filters, self._ascii] if self.glyphs.name is GlyphSet.ASCII else filters

    def on_unmount(self) -> None:
        """Stop the feed; the recorder goes on."""
        self.feed.stop()

    async def action_quit(self) -> None:
        """Close the terminal; say below it how to come back and how to end the recorder."""
        self.exit(message=None if self.lost else RECORDER_GOES_ON)

    def post(self, news: News) -> None:
        """Queue news; called from the feed's thread."""
        if isinstance(news, Role):
            self._role = news
        self._news.append(news)
        if len(self._news) == 1:  # one message handles all that is queued
            with suppress(RuntimeError):  # the app has just ended
                self.post_message(NewsArrived())

    async def on_news_arrived(self, _: NewsArrived) -> None:
        """Process the queued news."""
        await self._process_news()

    async def _process_news(self) -> None:
        """Process all queued news; of several statuses only the newest."""
        if not self.screen_stack:  # the app is closing
            return
        status: Status | None = None
        live = False
        while self._news:
            news = self._news[0]
            if isinstance(news, Status):
                status = news
            elif isinstance(news, Live):
                self.lanes.add(news)
                live = True
            elif isinstance(news, Role):
                self._history_of = ""
                if news.text:
                    self.warn(news.text)
            elif isinstance(news, Setup):
                self._other.compare(news, self._role.in_control)
            else:
                self.signals.play(signal_of(self.lost, news))
                self.lost, status = news, None
                self._publish(RecorderLost())
                if isinstance(self.screen, ModalScreen) and not news.starting:
                    self.warn(LOST_IN_A_FIELD)
            self._news.popleft()
        self.in_control = self._role.in_control
        if status is not None:
            await self._process_status(status)
        if live:
            self._publish(LiveArrived())

    async def _process_status(self, status: Status) -> None:
        before, self.status, self.lost = self.status, status, None
        if before is not None and before.recording != status.recording:
            self.lanes.clear()
        home = self.screen is self.get_screen("home")  # a dialog in front would be stranded
        if home and not self._started and not self._other.asking:
            self._started = True
            step = BenchStep.BASELINE if waits_unarmed(status) else progress(status).due
            await self.go_to(step)
            if not self.operator and not self.auto and step is not BenchStep.VEHICLE:
                self._ask_name()
            if self.display_link is not None and not self.auto:
                self.push_screen(self.display_link())
        elif before is not None and not in_run(before) and in_run(status) and self._gives_way(home):
            await self.open("run")  # also if another terminal or the display armed
        self._announce_phase(before, status)
        self._publish(StatusArrived(status))
        self.call_after_refresh(self._fetch_missing, before, status)  # the screen comes first
        if status.halted and status.halted != self._halted:
            self.show_help(status.halted)
        self._halted = status.halted

    def _fetch_missing(self, before: Status | None, status: Status) -> None:
        """Fetch the samples from before this terminal's start, and the bench, if they are new."""
        if self._history_of != status.recording:
            self._history_of = status.recording
            begin(self, self._fetch_history, group="history", exclusive=True)
        if before is None or before.bench_crc32 != status.bench_crc32 or self.bench is None:
            begin(self, self._fetch_bench, group="bench", exclusive=True)

    def _publish(self, message: Message) -> None:
        """Send news to the screen in front; a worker may bring news after all are closed."""
        if self.screen_stack:
            self.screen.post_message(message)

    def _ask_name(self) -> None:
        """Ask for the operator's name; called after the vehicle form, which also asks for it."""
        from .screens.dialogs import Question

        async def answered(name: str | None) -> None:
            if name and await self.ask(Hello(name, self.in_control)) is not None:
                self.operator = name

        self.push_screen(Question("Your name or initials, for every verdict", "name"), answered)

    async def _fetch_history(self) -> None:
        with suppress(OrderRefusedError):
            reply = await self.feed.ask(AskHistory(HISTORY_S))
            if reply.live is not None:
                self.lanes.add(reply.live)
                self._publish(LiveArrived())

    async def _fetch_bench(self) -> None:
        from daq.bench.config import parse_bench

        with suppress(OrderRefusedError, InputError):
            text = (await self.feed.ask(AskBench())).bench_text
            self.bench = parse_bench(text, "bench.toml", self.folder, dbc_text="")
            self.bench_text = text
            if self.status is not None:
                self._publish(StatusArrived(self.status))

    def _gives_way(self, home: bool) -> bool:
        """Return True if the screen in front gives way to a run: home, or a screen before it."""
        early = self.step in (BenchStep.VEHICLE, BenchStep.CHECK)
        return home or (early and self.status is not None and waits_unarmed(self.status))

    # Orders -------------------------------------------------------------------------------------

    async def ask(self, order: Order) -> Reply | None:
        """Send an order; return None after a refusal, whose reason is shown to the operator."""
        if not self.in_control and not isinstance(order, Question):
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

    def action_take_over(self) -> None:
        """Ask for control of the recorder."""
        if not self.in_control:
            self.feed.take_over()

    async def action_restart_recorder(self) -> None:
        """Start a recorder if none runs."""
        try:
            await asyncio.to_thread(self.feed.restart)
        except OrderRefusedError as refused:
            self.warn(str(refused))

    def action_sound(self) -> None:
        """Mute the signals, or unmute them."""
        self._show_choice(self.signals.toggle_sound())

    def action_big(self) -> None:
        """Switch the state in big letters on or off."""
        self._show_choice(self.signals.toggle_big())
        if not self.screen.query("BigWord"):
            self.inform(f"big letters on the run screen: {'on' if self.signals.big else 'off'}")

    def _show_choice(self, trouble: str) -> None:
        if trouble:
            self.warn(trouble)
        if self.status is not None:
            self._publish(StatusArrived(self.status))

    async def _press_next(self) -> None:
        from .screens.base import BenchScreen

        screen = self.screen if self.screen_stack else None  # none while the app closes
        if isinstance(screen, BenchScreen) and self.status is not None and screen.ready:
            await screen.action_next()

    def _announce_phase(self, before: Status | None, status: Status) -> None:
        """Signal a change, and set the window's title if the phase has changed."""
        self.signals.play(signal_of(before, status))
        if before is not None and before.phase is status.phase:
            return
        words = f"{status.phase.value.upper()} - {printable(status.vehicle)} - Bumpbench"
        if self._driver is not None and not self.is_headless:
            self._driver.write(f"\x1b]2;{words}\x07")
