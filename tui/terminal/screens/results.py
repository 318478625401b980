"""Results: the verdict first, then parameters, modes, M C K, decays and findings."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from textwrap import wrap
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
from dbc import counted

from ...jobs.outcome import Estimated, Outcome, RunOutcome, StateOutcome
from ..state.campaign import BenchStep, is_marked
from ..state.glyphs import Glyphs, GlyphSet
from ..widgets.rows import MarkedList
from ..widgets.traces import DecayPlot
from .base import BenchScreen
from .work import OUTDATED, export_session

_BAR = 11
_NARROW = 100
_DOF = ("heave", "pitch", "roll", "FL", "FR", "RL", "RR")
"""As `daq.vehicle.DOF`."""
_OPEN = "not determined"
_SEVERITY = {"refused": "REFUSED", "doubtful": "DOUBT", "ok": "note"}


def mark(verdict: str, glyphs: Glyphs) -> str:
    """Return the symbol of a verdict or severity."""
    return {"ok": glyphs.good, "accepted": glyphs.good, "doubtful": glyphs.warn}.get(
        verdict, glyphs.bad
    )


def verdict_lines(outcome: Outcome, glyphs: Glyphs, width: int, most: int) -> list[str]:
    """Return the verdict in words, then its gravest reasons with advice, at most `most` lines."""
    word = outcome.verdict.upper()
    runs = f"{outcome.used} of {counted(len(outcome.runs), 'run')} used"
    fit = f"   chi2/n {outcome.chi2_per_n:.3f}" if isfinite(outcome.chi2_per_n) else ""
    head = f"{mark(outcome.verdict, glyphs)} {word}  {outcome.headline}"
    tail = f"{runs}{fit}"
    if outcome.without:
        tail += f"   trial without {printable(', '.join(outcome.without), 40)}"
    lines = [f"{head}   {tail}"] if len(head) + len(tail) + 3 <= width else [head, f"  {tail}"]
    grave = [finding for finding in outcome.findings if finding.severity != "ok"]
    rest = [finding for finding in outcome.findings if finding.severity == "ok"]
    for finding in (*grave, *(() if grave else rest)):
        lines += finding_lines(finding.severity, finding.text, glyphs, width)
    if not outcome.findings:
        lines += wrap(outcome.meaning, width - 2, initial_indent="  ", subsequent_indent="  ")
    if len(lines) > most:
        hidden = len(lines) - most + 1
        more = counted(hidden, "more line")
        lines = [*lines[: most - 1], f"  ... {more}: Tab to Findings"]
    return lines


def finding_lines(severity: str, text: str, glyphs: Glyphs, width: int) -> list[str]:
    """Return one finding, folded."""
    symbol = "·" if severity == "ok" else mark(severity, glyphs)
    symbol = "-" if glyphs.name is GlyphSet.ASCII and severity == "ok" else symbol
    head = f"{symbol} {_SEVERITY.get(severity, severity)}: "
    return wrap(head + printable(text, 1000), width, subsequent_indent="    ")


def findings_lines(outcome: Outcome, glyphs: Glyphs, width: int) -> list[str]:
    """Return all findings, and the warnings that a person overrode."""
    lines = [*wrap(outcome.meaning, width), ""]
    for finding in outcome.findings:
        lines += finding_lines(finding.severity, finding.text, glyphs, width)
    if not outcome.findings:
        lines.append(f"{glyphs.good} nothing was found that speaks against the result")
    if outcome.survival:
        lines += ["", "Which parameters can be used:"]
        for text in outcome.survival:
            lines += wrap(f"  {printable(text, 700)}", width, subsequent_indent="    ")
    lines += ["", "Warnings of the bench check that a person overrode:"]
    if not outcome.overrides:
        lines.append("  none")
    for text in outcome.overrides:
        lines += wrap(f"{glyphs.warn} {printable(text, 700)}", width, subsequent_indent="    ")
    return lines


def bar(half_percent: float | None, widest: float, glyphs: Glyphs) -> str:
    """Draw a 95 % interval about its value; the widest of a table fills the bar."""
    plain = glyphs.name is GlyphSet.ASCII
    if half_percent is None:
        return "given".center(_BAR)
    reach = _BAR // 2
    cells = reach
    if isfinite(half_percent) and widest > 0.0:
        cells = max(0, min(reach, round(reach * half_percent / widest)))
    arm = "-" if plain else "─"
    point = "*" if plain else "●"
    space = " " * (reach - cells)
    left = ("|" if plain else "├") + arm * (cells - 1) if cells else ""
    right = arm * (cells - 1) + ("|" if plain else "┤") if cells else ""
    return f"{space}{left}{point}{right}{space}"


def parameter_lines(
    rows: tuple[Estimated, ...], title: str, glyphs: Glyphs, width: int
) -> list[str]:
    """Return quantities with their 95 % intervals, as numbers and as bars."""
    halves = [row.half_percent for row in rows]
    widest = max((half for half in halves if half is not None and isfinite(half)), default=0.0)
    wide = width >= _NARROW
    full = f"bar ±{widest:.2g} %"
    head = f"{title:<30}{'value':>10} {'':<6}{'95 % interval':>19} "
    head += f"{'±':>8}  {full:<18} rests mostly on" if wide else f"{full:>11}"
    lines = [head]
    for row, half in zip(rows, halves, strict=True):
        symbol = "" if row.words == row.name.replace("_", " ") else f"{row.name:<5}"
        interval = row.interval if half is None or isfinite(half) else _OPEN
        words = (symbol + row.words)[:29]
        text = f"{words:<30}{row.value:>10} {row.unit:<6}{interval:>19} "
        drawn = bar(half, widest, glyphs)
        if wide:
            text += f"{row.share:>8}  {drawn:<18} {row.rests_on}"
        else:
            text = f"{text:<67}{drawn}"
        lines.append(text[:width].rstrip())
    return lines


def mode_lines(states: tuple[StateOutcome, ...], width: int) -> list[str]:
    """Return the modes of every mass state with their 95 % intervals."""
    lines: list[str] = []
    for state in states:
        title = f"Mass state {printable(state.name, 20)}"
        if lines:
            lines.append("")
        lines.append(f"{title:<30}{'Hz':>9}{'± 95 %':>10}{'damping ratio':>16}{'± 95 %':>10}")
        for i, mode in enumerate(state.modes, start=1):
            pairs = (
                (mode.frequency_hz, mode.frequency_half_hz),
                (mode.damping_ratio, mode.damping_ratio_half),
            )
            lines.append(f"  {i} {mode.name:<26}" + "".join(map(_mode_cells, pairs, (9, 16))))
    return [line[:width] for line in lines]


def _mode_cells(pair: tuple[str, str], width: int) -> str:
    value, half = pair
    if not half:
        return f"{value:>{width + 10}}"
    return f"{value:>{width}}{half:>10}"


def matrix_lines(states: tuple[StateOutcome, ...], width: int) -> list[str]:
    """Return M, C and K of every mass state, SI."""
    lines: list[str] = []
    if not all(state.mass for state in states):
        return ["No matrices: a parameter in them is not determined (see Findings)."[:width]]
    for state in states:
        for letter, unit, matrix in (
            ("M", "kg, kg m²", state.mass),
            ("C", "N s/m, N m s/rad", state.damping),
            ("K", "N/m, N m/rad", state.stiffness),
        ):
            title = f"{letter} {printable(state.name, 12)}"
            if lines:
                lines.append("")
            lines.append(f"{title:<12}" + "".join(f"{dof:>9}" for dof in _DOF) + f"   {unit}")
            for dof, row in zip(_DOF, matrix, strict=True):
                cells = "".join(f"{_short(value):>9}" for value in row)
                lines.append(f"{dof:>10}  {cells}")
    return [line[:width].rstrip() for line in lines]


def _short(value: float) -> str:
    return "0" if abs(value) < 1e-9 else f"{value:.5g}" if abs(value) < 1e4 else f"{value:,.0f}"


def run_lines(runs: Sequence[RunOutcome], glyphs: Glyphs) -> list[str]:
    """Return one line for each run of the result."""
    labels = [printable(run.label, 40) for run in runs]
    width = max(map(len, labels), default=0)
    lines = []
    for run, label in zip(runs, labels, strict=True):
        fit = f"  chi2/n {run.chi2_per_n:.2f}" if isfinite(run.chi2_per_n) else ""
        used = "" if run.status == "accepted" else f"  {run.status.upper()}"
        lines.append(f"{mark(run.status, glyphs)} {label:<{width}}{used}{fit}".rstrip())
    return lines


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
