"""Opens the screens of a campaign, and help and notes over them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, cast

from textual.screen import Screen

from daq import Status

from .state.steps import SCREEN_OF, BenchStep, in_run, progress
from .widgets.message_line import MessageApp

if TYPE_CHECKING:
    from ..jobs.outcome import Outcome
    from .screens.identify import IdentifyScreen
    from .screens.report import ReportScreen
    from .screens.results import ResultsScreen


def _screen(module: str, name: str) -> Screen[Any]:
    """Return a new screen; its module is imported only now, to open the first screen at once."""
    made: Screen[Any] = getattr(import_module(f".screens.{module}", __package__), name)()
    return made


class ScreensApp(MessageApp):
    """An app with one screen of each kind, made when it is first opened."""

    SCREENS: ClassVar[dict[str, Callable[[], Screen[Any]]]] = {
        name: partial(_screen, name, f"{name.capitalize()}Screen")
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
        """Show the screen of a step if it is reached."""
        step = BenchStep(number)
        if progress(self.status).reached(step):
            await self.go_to(step)
        else:
            self.warn(f"step {step.title} is not reached yet")

    async def action_sessions(self) -> None:
        """Show the sessions of the folder."""
        await self.open("sessions")

    async def action_home(self) -> None:
        """Show the next action."""
        await self.open("home")

    def action_note(self, label: str = "") -> None:
        """Open a note on a run; on the session without a label."""
        from .screens.note import NoteScreen

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
