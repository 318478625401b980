"""Results: the verdict first, then parameters, modes, M C K, decays and findings."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.widgets import OptionList, Static

from daq import Status
from daq.control import Accept, Mark, Reject
from daq.errors import printable
from daq.runlog import LoggedStatus

from ...jobs.outcome import Outcome
from ..state.outcome_text import (
    findings_lines,
    matrix_lines,
    mode_lines,
    parameter_lines,
    run_lines,
    verdict_lines,
)
from ..state.steps import BenchStep, is_marked
from ..widgets.decay_plot import DecayPlot
from ..widgets.marked_list import MarkedList
from .base import BenchScreen
from .export import export_session
from .work import OUTDATED

_PAGES = ("Parameters", "Modes", "M C K", "Decays", "Findings", "Derived")
_DECAYS = _PAGES.index("Decays")
_WIDE = 160
"""Least number of columns to show the decays next to every page."""
_VERDICT_LINES, _VERDICT_LINES_TALL = 4, 8
_REASON = "excluded at the results"


class ResultsScreen(BenchScreen):
    """Shows the results of one session; Tab chooses the page."""

    HELP_PAGE: ClassVar[str] = "results"
    DEFAULT_CSS = """
    ResultsScreen #verdict { height: auto; padding: 0 1; }
    ResultsScreen #verdict.ok { color: $success; }
    ResultsScreen #verdict.doubtful { color: $warning; }
    ResultsScreen #verdict.refused { color: $error; }
    ResultsScreen #pages { height: 1; padding: 0 1; }
    ResultsScreen #body { height: 1fr; }
    ResultsScreen #scroll { width: 1fr; padding: 0 0 0 1; scrollbar-size: 1 1; }
    ResultsScreen #text { width: auto; height: auto; }
    ResultsScreen #side { width: 1fr; display: none; }
    ResultsScreen #runs { height: 6; border: none; padding: 0 1; }
    ResultsScreen DecayPlot { height: 1fr; }
    ResultsScreen.decays #scroll { display: none; }
    ResultsScreen.decays #side { display: block; }
    ResultsScreen.beside #side { display: block; }
    ResultsScreen.-tall #runs { height: 10; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "page(1)", "Page", tooltip="Next page"),
        Binding("shift+tab", "page(-1)", "Page back", show=False),
        Binding("p", "decays", "Decays", tooltip="Show the decays of the runs"),
        Binding("down", "move(1)", "Next run, or scroll", show=False),
        Binding("up", "move(-1)", "Run before, or scroll back", show=False),
        Binding("x", "start_recorder", "Start recorder"),
        Binding("x", "exclude", "Exclude run", tooltip="Leave the marked run out, or use it again"),
        Binding("e", "export", "Export", tooltip="Export the session in another format"),
        Binding("escape", "app.step(6)", "Back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self.outcome: Outcome | None = None
        self._page = 0
        self._recording = ""
        self._shown_outdated = False

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Let X start a recorder that is lost, and exclude a run otherwise."""
        if action == "exclude":
            return not super().check_action("start_recorder", ())
        return super().check_action(action, parameters)

    def compose_body(self) -> ComposeResult:
        """Compose verdict, page and decay."""
        yield Static(id="verdict", markup=False)
        yield Static(id="pages")
        with Horizontal(id="body"):
            with VerticalScroll(id="scroll", can_focus=True):
                yield Static(id="text", markup=False)
            with Vertical(id="side"):
                yield MarkedList(name="runs")
                yield DecayPlot(self.bench_app.glyphs)

    def on_mount(self) -> None:
        """Show an outcome that arrived before the screen was composed."""
        self._fill()

    def on_resize(self) -> None:
        """Fit the tables."""
        self.call_after_refresh(self._draw)

    @property
    def step_shown(self) -> BenchStep | None:
        """Step 6; None for an earlier session."""
        return BenchStep.IDENTIFY if self._is_current(self.bench_app.status) else None

    def show_status(self, status: Status) -> None:
        """Show whether the recording has changed since."""
        if self._outdated is not self._shown_outdated:
            self._draw()

    @property
    def _outdated(self) -> bool:
        status = self.bench_app.status
        return status is not None and self._is_current(status) and status.outdated

    @property
    def _pages(self) -> tuple[str, ...]:
        """Names of the pages; that of the dampers only where the car has curves."""
        return (*_PAGES, "Dampers") if self.outcome and self.outcome.dampers else _PAGES

    @property
    def ready(self) -> bool:
        """True while `--auto` may press SPACE."""
        return self.outcome is not None

    def show_outcome(self, outcome: Outcome) -> None:
        """Show an identification."""
        self.outcome = outcome
        status = self.bench_app.status
        if status is not None and status.own_session == outcome.session:
            self._recording = status.recording
        else:
            self._recording = ""
        self._page = 0 if outcome.parameters else _PAGES.index("Findings")
        self._fill()

    # Keys ---------------------------------------------------------------------------------------

    async def action_next(self) -> None:
        """Go on to the report of this session."""
        if self.outcome is None or self._outdated:
            await self.bench_app.go_to(BenchStep.IDENTIFY)
            return
        status, step = self.bench_app.status, BenchStep.IDENTIFY
        if status is not None and self._is_current(status) and not is_marked(status, step):
            await self.bench_app.ask(Mark(step.mark))
        await self.bench_app.open_report(self.outcome.session)

    def action_page(self, step: int) -> None:
        """Show the next page."""
        self._page = (self._page + step) % len(self._pages)
        self._draw()

    def action_decays(self) -> None:
        """Show the decays, or the parameters again."""
        self._page = 0 if self._page == _DECAYS else _DECAYS
        self._draw()

    def action_move(self, step: int) -> None:
        """Move between the runs where they are shown; else scroll."""
        runs = self.query_one("#runs", OptionList)
        if not self._runs_shown:
            self.query_one("#scroll").scroll_relative(y=2 * step, animate=False)
        elif step > 0:
            runs.action_cursor_down()
        else:
            runs.action_cursor_up()

    async def action_exclude(self) -> None:
        """Reject the chosen run (or take it back) and identify again."""
        outcome = self.outcome
        index = self.query_one("#runs", OptionList).highlighted
        if outcome is None or index is None or not outcome.runs:
            return
        if not self._runs_shown:
            self.bench_app.warn("choose the run first: P shows the runs, X then excludes one")
            return
        label = outcome.runs[index].label
        status = self.bench_app.status
        run = None
        if status is not None and self._is_current(status):
            run = next((run for run in status.runs if run.label == label), None)
        await (
            self._try_without(outcome, label) if run is None else self._decide(label, run.status)
        )

    def action_export(self) -> None:
        """Write the session in another tool's format."""
        if self.outcome is not None:
            self.run_worker(export_session(self.app, self.outcome.session), group="export")

    def on_option_list_option_highlighted(self, _: OptionList.OptionHighlighted) -> None:
        """Show the decay of the marked run."""
        self._draw_run()

    # Inside -------------------------------------------------------------------------------------

    async def _decide(self, label: str, status: LoggedStatus) -> None:
        """Reject or accept a run of the recording, then build and identify it again."""
        order = (
            Reject(label, _REASON)
            if status is LoggedStatus.ACCEPTED
            else Accept(label, "taken back at the results")
        )
        if await self.bench_app.ask(order) is not None:
            await self.bench_app.open_build()

    async def _try_without(self, outcome: Outcome, label: str) -> None:
        """Identify an earlier session without a run; its file stays unchanged."""
        without = tuple(sorted(set(outcome.without) ^ {label}))
        await self.bench_app.open_identify(outcome.session, without)

    @property
    def _runs_shown(self) -> bool:
        return self._page == _DECAYS or self.size.width >= _WIDE

    def _is_current(self, status: Status | None) -> bool:
        """Return True if the outcome belongs to the present recording."""
        return status is not None and status.recording == self._recording

    def _fill(self) -> None:
        if not self.query("#runs") or self.outcome is None:
            return
        self.query_one("#runs", MarkedList).show(
            run_lines(self.outcome.runs, self.bench_app.glyphs)
        )
        self._draw()
        self._draw_run()

    def _draw(self) -> None:
        if not self.query("#runs"):
            return
        outcome = self.outcome
        verdict = self.query_one("#verdict", Static)
        if outcome is None:
            verdict.update("nothing is identified yet: SPACE = step 6 Identify")
            return
        glyphs, size = self.bench_app.glyphs, self.size
        most = _VERDICT_LINES if size.height < 36 else _VERDICT_LINES_TALL
        self._shown_outdated = self._outdated
        lines = [f"{glyphs.warn} {OUTDATED}"] if self._shown_outdated else []
        lines += verdict_lines(outcome, glyphs, size.width - 2, most - len(lines))
        verdict.update("\n".join(lines))
        verdict.set_classes(outcome.verdict)
        names = [f"[{n}]" if i == self._page else f" {n} " for i, n in enumerate(self._pages)]
        name = printable(Path(outcome.session).name, 60)
        tail = f"  {name}" if size.width >= _WIDE else ""
        step = f"step {BenchStep.REPORT.title}" if self.step_shown else f"report of {name}"
        if self._shown_outdated:
            step = f"step {BenchStep.IDENTIFY.title}"
        pages = Content.assemble("".join(names) + tail, "  ", (f"SPACE = {step}", "bold $accent"))
        self.query_one("#pages", Static).update(pages)
        self.set_class(self._page == _DECAYS, "decays")
        self.set_class(size.width >= _WIDE, "beside")
        room = size.width - 2 if size.width < _WIDE else min(124, size.width // 2 - 3)
        self.query_one("#text", Static).update("\n".join(self._page_lines(outcome, room)))

    def _page_lines(self, outcome: Outcome, width: int) -> list[str]:
        glyphs = self.bench_app.glyphs
        match self._pages[self._page]:
            case "Parameters":
                return parameter_lines(outcome.parameters, "parameter", glyphs, width)
            case "Derived":
                return parameter_lines(outcome.derived, "what follows", glyphs, width)
            case "Modes":
                return mode_lines(outcome.states, width)
            case "M C K":
                return matrix_lines(outcome.states, width)
            case "Findings":
                return findings_lines(outcome, glyphs, width)
            case "Dampers":
                return [line[:width] for line in outcome.dampers]
        return []

    def _draw_run(self) -> None:
        index = self.query_one("#runs", OptionList).highlighted
        outcome = self.outcome
        run = None if outcome is None or index is None else outcome.runs[index]
        self.query_one(DecayPlot).show(run)
