"""Steps 3 and 5: the keys of the run loop, its boxes, and the live traces."""

from __future__ import annotations

from textwrap import wrap
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.content import Content

from daq.bench.campaign import sketch
from daq.control import messages
from daq.control.messages import Order, Status
from daq.runlog import LoggedRun
from daq.runs import RunStatus
from dbc.words import printable

from ..app import LiveArrived
from ..campaign import (
    BETWEEN_RUNS,
    RUNNING,
    BenchStep,
    NextAction,
    bump_step,
    in_run,
    next_action,
    weights_question,
)
from ..chart import LaneChart
from ..feed import lane_specs, shown_window
from ..widgets import BannerBar, Cell, Confirm, Question, Table, Words, right
from ..words import Glyphs, accepted_words, banner, reason_words, run_words
from .base import MARK_KEYS, BenchScreen


def tally_rows(status: Status, glyphs: Glyphs) -> list[list[Cell]]:
    """Return name, bar, accepted and rejected runs of each kind of bump; the due one is marked."""
    due_step = status.due.step if status.due else None
    due_kind = (due_step.mass_state, due_step.excitation) if due_step else None
    rows: list[list[Cell]] = []
    for tally in status.tallies:
        accepted, planned = tally.accepted, tally.planned
        is_due = due_kind == (tally.mass_state, tally.excitation)
        words = f"{glyphs.now if is_due else ' '} {tally.mass_state} {tally.excitation.words}"
        kind = Text(words, "bold" if is_due else "", no_wrap=True)
        extra = f" +{accepted - planned}" if accepted > planned else ""
        count = right(f"{min(accepted, planned)}/{planned}{extra}")
        rejected = f"{tally.rejected} rejected" if tally.rejected else ""
        n_pieces = min(planned, 10)  # one for each run, as far as a narrow terminal has room
        bar = glyphs.bar(min(accepted, planned) * n_pieces // max(planned, 1), n_pieces)
        rows.append([kind, bar, count, rejected])
    return rows


def runs_text(status: Status, glyphs: Glyphs) -> Content:
    """Return the runs, the newest first, in words, with the reasons of rejected ones."""
    lines = []
    for run in reversed(status.runs):
        name = f"{run.mass_state} {run.excitation.words} {run.repeat}"
        if run.status is RunStatus.OPEN:
            lines.append(Content.styled(f"{glyphs.now} {name}  running", "bold"))
        elif run.status is RunStatus.ACCEPTED:
            by_hand = f"; taken by {run.by}: {run.reason}" if run.by and run.reason else ""
            words = printable(f"{accepted_words(status, run)}{by_hand}", 160)
            lines.append(Content.assemble((glyphs.good, "bold $success"), f" {name}  {words}"))
        else:
            why = printable("; ".join(run.reasons), 160)
            mark = (glyphs.bad, "bold $error")
            lines.append(Content.assemble(mark, f" {name}  rejected, kept: {why}"))
    return Content("\n").join(lines or [Content("no runs yet")])


def alarms_text(status: Status, glyphs: Glyphs, width: int) -> Content:
    """Return the gravest alarm, cut after three lines, and the number of others; empty without."""
    if not status.alarms:
        return Content("")
    alarm, *others = status.alarms
    name = f"{glyphs.warn} {printable(reason_words(alarm.code).upper(), 40)}"
    subject = printable(f"{alarm.subject}: " if alarm.subject else "", 40)
    text = f"{name} {subject}{printable(alarm.text, 120)}: {printable(alarm.advice, 120)}"
    lines = wrap(text, max(width, 20), subsequent_indent="  ", max_lines=3, placeholder=" ...")
    lines += [f"{glyphs.warn} and {len(others)} more"] if others else []
    return Content("\n".join(lines)).stylize("bold $error", 0, len(name))


_ORDERS: dict[str, tuple[Order, str]] = {
    "reject": (messages.Reject(), ""),
    "undo": (messages.Undo(), "undone; R = redo"),
    "redo": (messages.Redo(), "redone; U = undo"),
    "lamp off": (messages.Acknowledge(), ""),
}
"""The orders of keys that need nothing else, and what is said when one is carried out."""


class HomeScreen(BenchScreen):
    """Arms, pauses, rejects and undoes; no key asks to confirm, because all can be undone."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("backspace,pageup", "order('reject')", "Reject", key_display="Bksp",
                tooltip="Reject the run in progress, or the last one"),
        Binding("u", "order('undo')", "Undo", tooltip="Undo the last verdict"),
        Binding("r", "order('redo')", "Redo", tooltip="Redo what was undone"),
        Binding("t", "take_back", "Take back",
                tooltip="Accept the last rejected run, with a reason"),
        Binding("a", "order('lamp off')", "Lamp off", tooltip="Acknowledge the overload lamps"),
        Binding("escape", "pause", "Pause", tooltip="Arm no further run"),
        Binding("v", "view", "View", tooltip="Another view: body or wheels, sketch or runs"),
        Binding("m", "more", "More", tooltip="More of the kind that is marked; up and down mark"),
        *MARK_KEYS,
    ]  # fmt: skip

    def __init__(self) -> None:
        super().__init__()
        self._view = 0  # first group of the chart's lanes; an odd one shows runs, not the sketch

    def compose_body(self) -> ComposeResult:
        """Compose the banner with the next action, the chart and the lists."""
        tallies = Table("tallies")
        tallies.add_class("box")
        tallies.border_title = "Progress"
        yield BannerBar()
        with Horizontal(id="body"):
            yield LaneChart(self.bench_app.glyphs)
            with Vertical(id="right"):
                yield Words("sketch", "box", "How to bump")
                yield tallies
                yield Words("runs", "box", "Runs")
        yield Words("alarms")

    @property
    def step_shown(self) -> BenchStep | None:
        """The step whose bumps come next."""
        status = self.bench_app.status
        return bump_step(status) if status is not None else None

    @property
    def next_enabled(self) -> bool:
        """True while there is a next action and a recorder that accepts it."""
        return self.bench_app.lost is None and self._next.words.startswith("SPACE")

    @property
    def ready(self) -> bool:
        """True while SPACE would begin something; `--auto` waits for the end of a countdown."""
        status = self.bench_app.status
        return status is not None and not in_run(status) and not status.halted and self.next_enabled

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show only the keys that do something now."""
        status = self.bench_app.status
        if status is None or self.bench_app.lost is not None:
            return action in ("view", "mark")
        if action == "order":
            acts_on = {"undo": status.undo, "redo": status.redo, "reject": status.runs}
            acts_on["lamp off"] = status.overloaded
            return bool(acts_on[str(parameters[0])])
        if action == "take_back":
            return self._rejected is not None
        if action == "more":
            return status.phase in BETWEEN_RUNS
        if action == "pause":
            return status.phase not in BETWEEN_RUNS
        return super().check_action(action, parameters)

    def _show(self) -> None:
        """Show also the banner and the alarms, which do not wait for a first status."""
        super()._show()
        if self.is_mounted and self.query("#alarms"):
            app, alarms = self.bench_app, self.query_one("#alarms", Words)
            text = Content("")
            if app.status is not None and app.lost is None:
                text = alarms_text(app.status, app.glyphs, self.app.size.width)
            alarms.say(text)
            alarms.display = bool(text)
            shown = banner(app.status, app.lost, self._next, app.glyphs)
            self.query_one(BannerBar).show(shown)

    def show_status(self, status: Status) -> None:
        """Show progress and runs, and the sketch of the bump that is due; in a run the traces."""
        self.set_class(status.phase not in BETWEEN_RUNS, "-run")
        glyphs, bench, due = self.bench_app.glyphs, self.bench_app.bench, status.due
        tallies = self.query_one("#tallies", Table)
        tallies.styles.height = len(status.tallies) + 2  # Textual measures it too late
        tallies.show([""] * 4, tally_rows(status, glyphs))
        self.query_one("#runs", Words).say(runs_text(status, glyphs))
        if bench is not None and due is not None:
            lines = sketch(bench.campaign, due.step.excitation)
            self.query_one("#sketch", Words).say(Content("\n".join(lines)))

    def action_view(self) -> None:
        """Show the next group of lanes; where there is no chart, runs in place of the sketch."""
        self._view += 1
        self.set_class(self._view % 2 == 1, "-runs")
        self._show()
        self.draw_lanes()

    @on(LiveArrived)
    @on(LaneChart.Resized)
    def draw_lanes(self) -> None:
        """Draw the newest samples on the chart, if it is visible."""
        chart, app = self.query_one(LaneChart), self.bench_app
        if not chart.display or not chart.size.height:
            return
        specs = lane_specs(app.bench, self._view, chart.most_lanes)
        chart.show(app.lanes, specs, shown_window(app.status, app.lanes))

    async def action_next(self) -> None:
        """Arm, or go to the step that is due; ask first where the weights change."""
        app, action, question = self.bench_app, self._next, weights_question(self.bench_app.status)

        async def arm(confirmed: bool | None) -> None:
            # Another terminal may have chosen another run while the question was open.
            if confirmed and action.order is not None and action == self._next:
                await app.ask(action.order)

        if action.step is not None:
            await app.go_to(action.step)
        elif action.order is not None and question and not app.auto:
            app.push_screen(Confirm(question, "yes, start", "no, not yet"), arm)
        else:
            await arm(True)

    async def action_order(self, name: str) -> None:
        """Send an order on the last verdict, or put the overload lamps out."""
        order, done = _ORDERS[name]
        if await self.bench_app.ask(order) is not None and done:
            self.bench_app.inform(done)

    async def action_pause(self) -> None:
        """Pause, after the run that is being recorded if there is one."""
        status = self.bench_app.status
        is_running = status is not None and status.phase in RUNNING
        if await self.bench_app.ask(messages.Pause()) is not None and is_running:
            self.bench_app.inform("pauses after this run")

    async def action_more(self) -> None:
        """Bump the chosen kind next, also beyond the planned number."""
        status = self.bench_app.status
        if status is not None and status.tallies:
            tally = status.tallies[self.query_one("#tallies", Table).cursor_row]
            order = messages.Choose(tally.mass_state, tally.excitation)
            if await self.bench_app.ask(order) is not None:
                self.bench_app.inform(f"next: {tally.mass_state} {tally.excitation.words}")

    def action_take_back(self) -> None:
        """Accept the last rejected run, with a reason; the journal stores reason and name."""
        run = self._rejected
        if run is None:
            return

        async def accept(reason: str | None) -> None:
            if reason:
                await self.bench_app.ask(messages.Accept(run.label, reason))

        question = f"Take {run.mass_state} {run_words(run)} back although: {'; '.join(run.reasons)}"
        self.app.push_screen(Question(question, "reason"), accept)

    @property
    def _next(self) -> NextAction:
        return next_action(self.bench_app.status, self.bench_app.in_control)

    @property
    def _rejected(self) -> LoggedRun | None:
        status = self.bench_app.status
        runs = status.runs if status else ()
        return next((r for r in reversed(runs) if r.status is RunStatus.REJECTED), None)
