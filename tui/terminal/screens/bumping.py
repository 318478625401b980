"""Home and run screen: the keys of the run loop, lists and live traces."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical

from daq.control.messages import Phase, Status
from daq.control.orders import Accept, Acknowledge, Choose, LeaveOut, Pause, Redo, Reject, Undo
from daq.runlog import LoggedRun, LoggedStatus

from ..context import LiveArrived, RecorderLost
from ..state.campaign import (
    RUNNING,
    BenchStep,
    NextAction,
    bump_step,
    next_action,
    weights_question,
)
from ..state.lanes import lane_specs, window
from ..state.words import banner, run_words
from ..widgets.banner import BannerBar, BigWord
from ..widgets.lists import (
    AlarmList,
    Journal,
    NextPanel,
    ProgressLine,
    RunList,
    SketchBox,
    TallyList,
)
from ..widgets.traces import LaneChart
from .base import BenchScreen
from .dialogs import Confirm, Question

AT_EASE = (Phase.IDLE, Phase.COMPLETE)


class BumpingScreen(BenchScreen):
    """Arms, pauses, rejects and undoes; no key asks to confirm, because all can be undone."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "backspace,pageup",
            "press('reject')",
            "Reject",
            key_display="Bksp",
            tooltip="Reject the run in progress, or the last one",
        ),
        Binding("u", "press('undo')", "Undo", tooltip="Undo the last verdict"),
        Binding("r", "press('redo')", "Redo", tooltip="Redo what was undone"),
        Binding(
            "l",
            "press('leave_out')",
            "Leave out",
            tooltip="Leave out the runs that are unlike the others",
        ),
        Binding(
            "t", "take_back", "Take back", tooltip="Accept the last rejected run, with a reason"
        ),
        Binding("v", "view", "View", tooltip="Another view: body or wheels, sketch or runs"),
        Binding("m", "more", "More", tooltip="More of the kind that is marked; up and down mark"),
        Binding("up", "choose(-1)", show=False),
        Binding("down", "choose(1)", show=False),
        Binding("a", "acknowledge", "Lamp off", tooltip="Acknowledge the overload lamps"),
        Binding("escape", "press('pause')", "Pause", tooltip="Pause; home if nothing is armed"),
        Binding("b", "app.sound", "Sound", tooltip="Sound on or off"),
        Binding("g", "app.big", "Big", tooltip="The state in big letters on or off"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._page = 0
        """Group of lanes that the chart shows."""

    @property
    def step_shown(self) -> BenchStep | None:
        """The step whose bumps come next."""
        status = self.bench_app.status
        return bump_step(status) if status is not None else None

    @property
    def acts(self) -> bool:
        """True while there is a next action and a recorder that accepts it."""
        app = self.bench_app
        return app.lost is None and self._next.words.startswith("SPACE")

    @property
    def ready(self) -> bool:
        """True while SPACE would begin something; `--auto` waits for the end of a countdown."""
        status = self.bench_app.status
        return status is not None and status.phase in AT_EASE and not status.halted and self.acts

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show only the keys that do something now."""
        status = self.bench_app.status
        if action == "start_recorder":
            return super().check_action(action, parameters)
        if status is None or self.bench_app.lost is not None:
            return action not in ("take_back", "more", "acknowledge", "press")
        match (action, parameters):
            case ("press", ("undo",)):
                return bool(status.undo)
            case ("press", ("redo",)):
                return bool(status.redo)
            case ("press", ("reject",)):
                return bool(status.runs)
            case ("press", ("leave_out",)):
                return bool(status.proposed)
            case ("take_back", _):
                return self._rejected is not None
            case ("acknowledge", _):
                return bool(status.overloaded)
            case ("more", _):
                return status.phase in (*AT_EASE, Phase.PAUSED)
        return super().check_action(action, parameters)

    def show_status(self, status: Status) -> None:
        """Show the next action, the lists and the alarms."""
        self.show_next()
        self.query_one(TallyList).show(status)
        self.query_one(RunList).show(status)
        self.query_one(Journal).show(status)
        self.query_one(AlarmList).show(None if self.bench_app.lost else status)
        self.refresh_bindings()

    @abstractmethod
    def show_next(self) -> None:
        """Show the next action, also while no recorder answers."""

    def on_recorder_lost(self, message: RecorderLost) -> None:
        """Show what to do."""
        super().on_recorder_lost(message)
        self.query_one(AlarmList).show(None)
        self.show_next()

    def on_live_arrived(self, _: LiveArrived) -> None:
        """Draw the newest samples."""
        self.draw_lanes()

    def on_lane_chart_resized(self, _: LaneChart.Resized) -> None:
        """Draw the samples in the chart's new size."""
        self.draw_lanes()

    def draw_lanes(self) -> None:
        """Draw the newest samples on the chart, if it is visible."""
        chart, app = self.query_one(LaneChart), self.bench_app
        if not chart.display or not chart.size.height:
            return
        specs = lane_specs(app.bench, app.lanes, self._page, chart.room)
        overloaded = app.status.overloaded if app.status else ()
        chart.show(app.lanes, specs, window(app.status, app.lanes), overloaded)

    async def action_next(self) -> None:
        """Arm, or go to the step that is due."""
        app = self.bench_app
        action = self._next
        question = weights_question(app.status)
        if action.step is not None:
            await app.go_to(action.step)
        elif action.order is not None and question and self._change != app.answered:
            dialog = Confirm(question, "yes, start", "no, not yet")
            self.app.push_screen(dialog, self._weights_are_right)
        elif action.order is not None and await app.ask(action.order) is not None:
            await app.open("run")

    async def _weights_are_right(self, yes: bool | None) -> None:
        """Arm after the operator has checked the weights."""
        if yes:
            self.bench_app.answered = self._change
            await self.action_next()

    async def action_reject(self) -> None:
        """Reject the run in progress, or the last one."""
        await self.bench_app.ask(Reject())

    async def action_undo(self) -> None:
        """Undo the last verdict."""
        if await self.bench_app.ask(Undo()) is not None:
            self.bench_app.inform("undone; R = redo")

    async def action_redo(self) -> None:
        """Redo the last undo."""
        if await self.bench_app.ask(Redo()) is not None:
            self.bench_app.inform("redone; U = undo")

    async def action_leave_out(self) -> None:
        """Leave out the runs that differ from the others of their kind."""
        if await self.bench_app.ask(LeaveOut()) is not None:
            self.bench_app.inform("left out, kept in the recording; U = undo")

    async def action_pause(self) -> None:
        """Pause; go home if nothing is armed."""
        status = self.bench_app.status
        if status is None or status.phase in (*AT_EASE, Phase.PAUSED):
            await self.bench_app.open("home")
        elif await self.bench_app.ask(Pause()) is not None and status.phase in RUNNING:
            self.bench_app.inform("pauses after this run")

    async def action_acknowledge(self) -> None:
        """Acknowledge the overload lamps."""
        await self.bench_app.ask(Acknowledge())

    async def action_more(self) -> None:
        """Bump the chosen kind next, also beyond the planned number."""
        status = self.bench_app.status
        if status is not None and status.tallies:
            tally = status.tallies[min(self.query_one(TallyList).chosen, len(status.tallies) - 1)]
            order = Choose(tally.mass_state, tally.excitation)
            if await self.bench_app.ask(order) is not None:
                self.bench_app.inform(f"next: {tally.mass_state} {tally.excitation.words}")

    def action_choose(self, by: int) -> None:
        """Mark another kind of bump."""
        if self.bench_app.status is not None:
            self.query_one(TallyList).move(by, self.bench_app.status)

    def action_take_back(self) -> None:
        """Accept a rejected run, with a reason; the journal stores reason and name."""
        run = self._rejected
        if run is None:
            return

        async def accept(reason: str | None) -> None:
            if reason:
                await self.bench_app.ask(Accept(run.label, reason))

        words = f"Take {run.mass_state} {run_words(run)} back although: {'; '.join(run.reasons)}"
        self.app.push_screen(Question(words, "reason"), accept)

    @property
    def _change(self) -> str:
        """The last run and the next mass state; with `--auto` every change counts as confirmed."""
        app = self.bench_app
        if app.auto or app.status is None or app.status.due is None or not app.status.runs:
            return app.answered
        return (
            f"{app.status.recording} {app.status.runs[-1].label} {app.status.due.step.mass_state}"
        )

    @property
    def _next(self) -> NextAction:
        return next_action(self.bench_app.status, self.bench_app.in_control)

    @property
    def _rejected(self) -> LoggedRun | None:
        status = self.bench_app.status
        runs = status.runs if status else ()
        return next((r for r in reversed(runs) if r.status is LoggedStatus.REJECTED), None)


class HomeScreen(BumpingScreen):
    """Shows the next action, how to bump, progress, runs and journal."""

    HELP_PAGE: ClassVar[str] = "home"

    def compose_body(self) -> ComposeResult:
        """Compose the next action and the lists."""
        glyphs = self.bench_app.glyphs
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield NextPanel(glyphs)
                yield LaneChart(glyphs)
                yield RunList(glyphs)
            with Vertical(id="right"):
                yield SketchBox()
                yield TallyList(glyphs)
                yield Journal()
        yield AlarmList(glyphs)

    def on_mount(self) -> None:
        """Show immediately that the terminal waits for a recorder."""
        self.show_next()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Hide Esc while nothing is armed, because it would only return here."""
        status = self.bench_app.status
        if (action, parameters) == ("press", ("pause",)) and status and status.phase in AT_EASE:
            return False
        return super().check_action(action, parameters)

    def show_status(self, status: Status) -> None:
        """Show the sketch too."""
        super().show_status(status)
        self.query_one(SketchBox).show(status, self.bench_app.bench)

    def show_next(self) -> None:
        """Show it in its panel."""
        app = self.bench_app
        self.query_one(NextPanel).show(app.status, self._next, app.lost)

    def action_view(self) -> None:
        """Switch between sketch and runs where there is no room for both."""
        self.toggle_class("-runs")


class RunScreen(BumpingScreen):
    """Banner and lanes; on a wide terminal also progress, runs and journal."""

    HELP_PAGE: ClassVar[str] = "run"

    def compose_body(self) -> ComposeResult:
        """Compose the run."""
        glyphs = self.bench_app.glyphs
        yield BigWord(glyphs)
        yield BannerBar(glyphs)
        with Horizontal(id="body"):
            yield LaneChart(glyphs)
            with Vertical(id="right"):
                yield TallyList(glyphs)
                yield RunList(glyphs)
                yield Journal()
        yield AlarmList(glyphs)
        yield ProgressLine(glyphs)

    def show_status(self, status: Status) -> None:
        """Show the progress too."""
        super().show_status(status)
        self.query_one(ProgressLine).show(status)

    def action_view(self) -> None:
        """Show the next group of lanes: body, then each quantity at the wheels."""
        self._page += 1
        self.draw_lanes()

    def show_next(self) -> None:
        """Show it in the banner, with the state."""
        app = self.bench_app
        shown = banner(app.status, app.lost, self._next, app.glyphs)
        self.query_one(BigWord).show(shown, app.signals.big)
        self.query_one(BannerBar).show(shown)
