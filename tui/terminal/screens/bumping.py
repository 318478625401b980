"""Home and run screen: the keys of the run loop, its boxes, and the live traces."""

from __future__ import annotations

from statistics import fmean, stdev
from textwrap import wrap
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.content import Content

from daq.bench.campaign import sketch
from daq.control.messages import (
    Accept,
    Acknowledge,
    Choose,
    Order,
    Pause,
    Phase,
    Redo,
    Reject,
    Status,
    Tally,
    Undo,
)
from daq.runlog import LoggedRun
from daq.runs import RunStatus
from dbc.words import printable

from ..campaign import (
    RUNNING,
    BenchStep,
    NextAction,
    bump_step,
    cause_words,
    next_action,
    obstacle,
    progress,
    weights_question,
)
from ..chart import LaneChart
from ..feed import Lost, lane_specs, window
from ..widgets import SPACE_INK, BannerBar, Cell, Confirm, Table, Words, right
from ..words import Glyphs, accepted_words, banner, reason_words, run_words
from .base import BenchScreen

if TYPE_CHECKING:
    from daq.bench.config import Bench


def next_text(
    status: Status | None, action: NextAction, lost: Lost | None, glyphs: Glyphs
) -> Content:
    """Return the next bump in words, and what SPACE does; without a recorder, how to start one."""
    if lost is not None:
        shown = banner(status, lost, action, glyphs)
        head = Content.styled(f"{shown.symbol} {shown.word}", "bold $error")
        words = Content.styled(shown.title, SPACE_INK)
        parts = [head, Content(shown.first), Content(shown.second), Content(""), words]
        return Content("\n").join(parts)
    lines: list[Content] = []
    if status is None:
        lines = [Content("waiting for the recorder; to start it takes some seconds")]
    elif action.step is not None:
        lines = [Content.styled(f"{glyphs.now} Step {action.step.title}", "bold")]
    elif (alarm := obstacle(status)) is not None:
        name, advice, details = cause_words(alarm)
        head = Content.styled(f"{glyphs.bad} STOP  {name}", "bold $error")
        lines = [head, Content(advice), Content(details)]
    elif status.due is not None:
        due = status.due
        title = f"{due.step.mass_state.capitalize()} · {due.step.excitation.words.upper()}"
        count = f"run {min(due.accepted + 1, due.planned)} of {due.planned}"
        if due.accepted >= due.planned:
            count = f"run {due.accepted + 1}, {due.planned} were planned"
        lines = [
            Content.styled(f"{glyphs.now} {title}, {count}", "bold"),
            Content(printable(due.instruction, 300)),
        ]
    else:
        lines = [Content(f"step {progress(status).due.title}")]
    return Content("\n").join([*lines, Content(""), Content.styled(action.words, SPACE_INK)])


def sketch_text(status: Status, bench: Bench | None) -> Content:
    """Return the sketch of the bump that is due."""
    if bench is None or status.due is None:
        return Content("")
    return Content("\n".join(sketch(bench.campaign, status.due.step.excitation)))


def tally_rows(status: Status, glyphs: Glyphs) -> list[list[Cell]]:
    """Return accepted and planned runs of each kind, the one that is due marked."""
    due = status.due.step if status.due else None
    due_kind = (due.mass_state, due.excitation) if due else None
    rows: list[list[Cell]] = []
    for tally in status.tallies:
        accepted, planned = tally.accepted, tally.planned
        is_due = due_kind == (tally.mass_state, tally.excitation)
        kind = f"{glyphs.now if is_due else ' '} {tally.mass_state} {tally.excitation.words}"
        more = f" +{accepted - planned}" if accepted > planned else ""
        motions = [
            finding.value
            for run in _of_kind(status, tally, RunStatus.ACCEPTED)
            for finding in run.findings
            if finding.code == "motion" and finding.value > 0
        ]
        scatter = f" ± {stdev(motions):.2f}" if len(motions) > 1 else ""
        reasons = dict.fromkeys(
            reason_words(run.failed.code) if run.failed else "by hand"
            for run in _of_kind(status, tally, RunStatus.REJECTED)
        )
        rejected = f"{tally.rejected} rejected: {printable(', '.join(reasons), 60)}"
        rows.append(
            [
                Text(kind, "bold" if is_due else "", no_wrap=True),
                glyphs.bar(accepted, planned),
                right(f"{min(accepted, planned)}/{planned}{more}"),
                right(f"{fmean(motions):.2f}{scatter} Hz" if motions else ""),
                rejected if tally.rejected else "",
            ]
        )
    return rows


def _of_kind(status: Status, tally: Tally, state: RunStatus) -> list[LoggedRun]:
    kind = (tally.mass_state, tally.excitation, state)
    return [run for run in status.runs if (run.mass_state, run.excitation, run.status) == kind]


def runs_text(status: Status, glyphs: Glyphs, figures: bool) -> Content:
    """Return the runs, the newest first, in words, with the reasons of rejected ones.

    `figures`: add the measured figures of accepted runs.
    """
    lines = []
    for run in reversed(status.runs):
        name = f"{run.mass_state} {run.excitation.words} {run.repeat}"
        if run.status is RunStatus.OPEN:
            lines.append(Content.styled(f"{glyphs.now} {name}  running", "bold"))
        elif run.status is RunStatus.ACCEPTED:
            by_hand = f"; taken by {run.by}: {run.reason}" if run.by and run.reason else ""
            words = printable(f"{accepted_words(status, run)}{by_hand}", 160)
            lines.append(Content.assemble((glyphs.good, "bold $success"), f" {name}  {words}"))
            measured = (f.text for f in run.findings if f.code == "motion")
            lines += [Content(f"    {printable(text, 160)}") for text in measured if figures]
        else:
            why = printable("; ".join(run.reasons), 160)
            mark = (glyphs.bad, "bold $error")
            lines.append(Content.assemble(mark, f" {name}  rejected, kept: {why}"))
    return Content("\n").join(lines or [Content("no runs yet")])


def alarms_text(status: Status, glyphs: Glyphs, width: int) -> Content:
    """Return the alarms with their advice, the gravest first, in four rows; empty without any."""
    alarms = []
    for a in status.alarms:
        name = f"{glyphs.warn} {printable(reason_words(a.code).upper(), 40)}"
        about = printable(f"{a.subject}: " if a.subject else "", 40)
        alarms.append((name, f"{about}{printable(a.text, 120)}: {printable(a.advice, 120)}"))
    if status.overloaded:
        names = printable(", ".join(status.overloaded), 120)
        text = f"{names} touched the end of the range: A puts the lamp out"
        alarms.append((f"{glyphs.overload} OVERLOAD", text))
    rows: list[Content] = []
    for i, (name, text) in enumerate(alarms):
        first, *others = wrap(f"{name} {text}", width, subsequent_indent="  ")
        lines = [Content.assemble((name, "bold $error"), first.removeprefix(name))]
        lines += map(Content, others[: 1 if i else 2])
        n_after = len(alarms) - i - 1
        if len(rows) + len(lines) > (3 if n_after else 4):  # the last row counts the others
            rows.append(Content(f"{glyphs.warn} and {n_after + 1} more"))
            break
        rows += lines
    return Content("\n").join(rows)


AT_EASE = (Phase.IDLE, Phase.COMPLETE)
_ORDERS: dict[str, tuple[Order, str]] = {
    "reject": (Reject(), ""),
    "undo": (Undo(), "undone; R = redo"),
    "redo": (Redo(), "redone; U = undo"),
    "lamp off": (Acknowledge(), ""),
}
"""The orders of keys that need nothing else, and what is said when one is carried out."""


class BumpingScreen(BenchScreen):
    """Arms, pauses, rejects and undoes; no key asks to confirm, because all can be undone."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "backspace,pageup", "order('reject')", "Reject", key_display="Bksp",
            tooltip="Reject the run in progress, or the last one",
        ),
        Binding("u", "order('undo')", "Undo", tooltip="Undo the last verdict"),
        Binding("r", "order('redo')", "Redo", tooltip="Redo what was undone"),
        Binding("t", "take_back", "Take back",
                tooltip="Accept the last rejected run, with a reason"),
        Binding("a", "order('lamp off')", "Lamp off", tooltip="Acknowledge the overload lamps"),
        Binding("escape", "pause", "Pause", tooltip="Pause; home if nothing is armed"),
        Binding("v", "view", "View", tooltip="Another view: body or wheels, figures of the runs"),
        Binding("m", "more", "More", tooltip="More of the kind that is marked; up and down mark"),
        Binding("b", "app.sound", show=False, tooltip="Sound on or off"),
        Binding("up", "choose(-1)", show=False),
        Binding("down", "choose(1)", show=False),
    ]  # fmt: skip

    def __init__(self) -> None:
        super().__init__()
        self._page = 0
        """Group of lanes that the chart shows."""

    def compose_lists(self) -> ComposeResult:
        """Compose progress and runs."""
        tallies = Table("tallies")
        tallies.add_class("box")
        tallies.border_title = "Progress"
        yield tallies
        yield Words("runs", "box", "Runs")

    @property
    def step_shown(self) -> BenchStep | None:
        """The step whose bumps come next."""
        status = self.bench_app.status
        return bump_step(status) if status is not None else None

    @property
    def acts(self) -> bool:
        """True while there is a next action and a recorder that accepts it."""
        return self.bench_app.lost is None and self._next.words.startswith("SPACE")

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
            return action in ("view", "choose")
        if action == "order":
            changeable = {"undo": status.undo, "redo": status.redo, "reject": status.runs}
            return bool((changeable | {"lamp off": status.overloaded})[str(parameters[0])])
        if action == "take_back":
            return self._rejected is not None
        if action == "more":
            return status.phase in (*AT_EASE, Phase.PAUSED)
        return super().check_action(action, parameters)

    def _show(self) -> None:
        super()._show()
        if self.is_mounted and self.query("#alarms"):
            app, alarms = self.bench_app, self.query_one("#alarms", Words)
            text = Content("")
            if app.status is not None and app.lost is None:
                text = alarms_text(app.status, app.glyphs, self.app.size.width)
            alarms.say(text)
            alarms.display = bool(text)
            self.show_next()

    def show_status(self, status: Status) -> None:
        """Show progress and runs."""
        glyphs = self.bench_app.glyphs
        tallies = self.query_one("#tallies", Table)
        tallies.styles.height = len(status.tallies) + 2  # Textual measures it too late
        tallies.show([""] * 5, tally_rows(status, glyphs))
        self.query_one("#runs", Words).say(runs_text(status, glyphs, self.shows_figures))

    @property
    def shows_figures(self) -> bool:
        """True while the runs are shown with their figures."""
        return self._page % 2 == 1

    def show_next(self) -> None:
        """Show the next action, also while no recorder answers."""

    def on_live_arrived(self) -> None:
        """Draw the newest samples."""
        self.draw_lanes()

    def on_lane_chart_resized(self) -> None:
        """Draw the samples in the chart's new size."""
        self.draw_lanes()

    def draw_lanes(self) -> None:
        """Draw the newest samples on the chart, if it is visible."""
        chart, app = self.query_one(LaneChart), self.bench_app
        if not chart.display or not chart.size.height:
            return
        specs = lane_specs(app.bench, self._page, chart.room)
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

            async def answered(yes: bool | None) -> None:
                if yes:
                    app.answered = self._change
                    await self.action_next()

            app.push_screen(Confirm(question, "yes, start", "no, not yet"), answered)
        elif action.order is not None and await app.ask(action.order) is not None:
            await app.open("run")

    async def action_order(self, name: str) -> None:
        """Send an order on the last verdict, or put the overload lamps out."""
        order, done = _ORDERS[name]
        if await self.bench_app.ask(order) is not None and done:
            self.bench_app.inform(done)

    async def action_pause(self) -> None:
        """Pause; go home if nothing is armed."""
        status = self.bench_app.status
        if status is None or status.phase in (*AT_EASE, Phase.PAUSED):
            await self.bench_app.open("home")
        elif await self.bench_app.ask(Pause()) is not None and status.phase in RUNNING:
            self.bench_app.inform("pauses after this run")

    async def action_more(self) -> None:
        """Bump the chosen kind next, also beyond the planned number."""
        status = self.bench_app.status
        if status is not None and status.tallies:
            tally = status.tallies[self.query_one("#tallies", Table).cursor_row]
            order = Choose(tally.mass_state, tally.excitation)
            if await self.bench_app.ask(order) is not None:
                self.bench_app.inform(f"next: {tally.mass_state} {tally.excitation.words}")

    def action_choose(self, by: int) -> None:
        """Mark another kind of bump."""
        tallies = self.query_one("#tallies", Table)
        tallies.choose(tallies.cursor_row + by)

    def action_take_back(self) -> None:
        """Accept a rejected run, with a reason; the journal stores reason and name."""
        run = self._rejected
        if run is None:
            return

        async def accept(reason: str | None) -> None:
            if reason:
                await self.bench_app.ask(Accept(run.label, reason))

        words = f"Take {run.mass_state} {run_words(run)} back although: {'; '.join(run.reasons)}"
        self.bench_app.question(words, "reason", accept)

    @property
    def _change(self) -> str:
        """The last run and the next mass state; with `--auto` every change counts as confirmed."""
        app = self.bench_app
        if app.auto or app.status is None or app.status.due is None or not app.status.runs:
            return app.answered
        last, state = app.status.runs[-1].label, app.status.due.step.mass_state
        return f"{app.status.recording} {last} {state}"

    @property
    def _next(self) -> NextAction:
        return next_action(self.bench_app.status, self.bench_app.in_control)

    @property
    def _rejected(self) -> LoggedRun | None:
        status = self.bench_app.status
        runs = status.runs if status else ()
        return next((r for r in reversed(runs) if r.status is RunStatus.REJECTED), None)


class HomeScreen(BumpingScreen):
    """Shows the next action, how to bump, progress and runs."""

    HELP_PAGE: ClassVar[str] = "home"

    def compose_body(self) -> ComposeResult:
        """Compose the next action and the lists."""
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield Words("next", "box", "Next")
                yield LaneChart(self.bench_app.glyphs)
            with Vertical(id="right"):
                yield Words("sketch", "box", "How to bump")
                yield from self.compose_lists()
        yield Words("alarms")

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Hide Esc while nothing is armed, because it would only return here."""
        status = self.bench_app.status
        if action == "pause" and status and status.phase in AT_EASE:
            return False
        return super().check_action(action, parameters)

    def show_status(self, status: Status) -> None:
        """Show the sketch too."""
        super().show_status(status)
        sketch = self.query_one("#sketch", Words)
        sketch.say(sketch_text(status, self.bench_app.bench))
        due = status.due
        sketch.border_title = f"How to bump: {due.step.excitation.words}" if due else "How to bump"

    def show_next(self) -> None:
        """Show it in its box."""
        app = self.bench_app
        words = next_text(app.status, self._next, app.lost, app.glyphs)
        self.query_one("#next", Words).say(words)

    def action_view(self) -> None:
        """Show the runs with their figures; where there is room for one, in place of the sketch."""
        self._page += 1
        self.set_class(self.shows_figures, "-runs")
        self._show()


class RunScreen(BumpingScreen):
    """Banner and lanes; on a wide terminal also progress and runs."""

    HELP_PAGE: ClassVar[str] = "run"

    def compose_body(self) -> ComposeResult:
        """Compose the run."""
        yield BannerBar()
        with Horizontal(id="body"):
            yield LaneChart(self.bench_app.glyphs)
            with Vertical(id="right"):
                yield from self.compose_lists()
        yield Words("alarms")

    def action_view(self) -> None:
        """Show the next group of lanes, body or a quantity at the wheels; figures of the runs."""
        self._page += 1
        self._show()
        self.draw_lanes()

    def show_next(self) -> None:
        """Show it in the banner, with the state."""
        app = self.bench_app
        self.query_one(BannerBar).show(banner(app.status, app.lost, self._next, app.glyphs))
