"""Results: the verdict first, then parameters, modes, M C K, decays and findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import isfinite, nan
from pathlib import Path
from textwrap import wrap
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import ContentSwitcher, Static, Tab, Tabs

from daq.control.messages import Status
from daq.control.orders import Accept, Mark, Reject
from daq.errors import printable
from daq.runlog import LoggedStatus
from dbc import counted
from identify import Estimate, Identification, Verdict
from identify.numbers import half_width, largest_share
from identify.words import (
    HEADLINE,
    MEANING,
    damper_columns,
    damper_rows,
    element_answer,
    ends_text,
    half_percent,
    half_text,
    parameter_words,
    plain,
    survival_lines,
    unit_text,
    value_text,
)

from ...jobs.lines import Outcome
from ..state.campaign import BenchStep, is_marked
from ..state.glyphs import Glyphs, GlyphSet
from ..widgets.table import Cell, Table, right
from ..widgets.traces import DecayPlot
from .base import BenchScreen
from .work import OUTDATED, export_session

_BAR = 11
_DOF = ("heave", "pitch", "roll", "FL", "FR", "RL", "RR")
"""As `daq.vehicle.DOF`."""
_SEVERITY = {"refused": "REFUSED", "doubtful": "DOUBT", "ok": "note"}


def mark(verdict: str, glyphs: Glyphs) -> str:
    """Return the symbol of a verdict or severity."""
    return {"ok": glyphs.good, "accepted": glyphs.good, "doubtful": glyphs.warn}.get(
        verdict, glyphs.bad
    )


def verdict_lines(outcome: Outcome, glyphs: Glyphs, width: int, most: int) -> list[str]:
    """Return the verdict in words, then its gravest reasons with advice, at most `most` lines."""
    quality = outcome.result.quality
    verdict = quality.verdict
    fit = f"   chi2/n {quality.chi2_per_n:.3f}" if isfinite(quality.chi2_per_n) else ""
    head = f"{mark(verdict, glyphs)} {verdict.upper()}  {HEADLINE[verdict]}"
    tail = f"{outcome.used} of {counted(len(outcome.runs), 'run')} used{fit}"
    if outcome.without:
        tail += f"   trial without {printable(', '.join(outcome.without), 40)}"
    lines = [f"{head}   {tail}"] if len(head) + len(tail) + 3 <= width else [head, f"  {tail}"]
    findings = [(Verdict.of(finding.severity), finding.text) for finding in quality.findings]
    grave = [one for one in findings if one[0] is not Verdict.OK]
    for severity, text in grave or findings:
        lines += finding_lines(severity, text, glyphs, width)
    if not findings:
        lines += wrap(MEANING[verdict], width - 2, initial_indent="  ", subsequent_indent="  ")
    if len(lines) > most:
        more = counted(len(lines) - most + 1, "more line")
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
    quality = outcome.result.quality
    lines = [*wrap(MEANING[quality.verdict], width), ""]
    for finding in quality.findings:
        lines += finding_lines(Verdict.of(finding.severity), finding.text, glyphs, width)
    if not quality.findings:
        lines.append(f"{glyphs.good} nothing was found that speaks against the result")
    if survival := survival_lines(quality):
        lines += ["", "Which parameters can be used:"]
        for text in survival:
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


def parameter_rows(
    estimates: Mapping[str, Estimate],
    words: Callable[[str], str],
    drivers: Mapping[str, Mapping[str, float]],
    glyphs: Glyphs,
    wide: bool,
) -> tuple[list[str], list[list[Cell]]]:
    """Return heads and rows of quantities with their 95 % intervals, as numbers and as bars."""
    halves = [_half(e) for e in estimates.values()]
    widest = max((half for half in halves if half is not None and isfinite(half)), default=0.0)
    heads = ["parameter", "value", "unit", "95 % interval", f"bar ±{widest:.2g} %"]
    cells: list[list[Cell]] = []
    for (name, e), half in zip(estimates.items(), halves, strict=True):
        symbol = "" if words(name) == plain(name) else f"{name:<5}"
        value, interval = (value_text(e), ends_text(e)) if e.determined else ("", value_text(e))
        title = f"{symbol}{words(name)}"[:29]
        cells.append(
            [title, right(value), unit_text(e.unit), right(interval), bar(half, widest, glyphs)]
        )
        if wide:
            cells[-1] += [right(half_text(e)), f" {largest_share(drivers.get(name, {}))}"]
    return [*heads, "±", " rests mostly on"] if wide else heads, cells


def _half(e: Estimate) -> float | None:
    """Return half of an interval, % of the value; None for a given value, NaN without one."""
    if not e.determined:
        return nan
    return (half_percent(e) or None) if e.value else None


def mode_rows(result: Identification) -> list[list[Cell]]:
    """Return the modes of every mass state with their 95 % intervals."""
    rows: list[list[Cell]] = []
    for state, modes in result.modes.items():
        names = zip(result.mode_names[state], modes, strict=True)
        for i, (name, mode) in enumerate(names, start=1):
            rows.append([printable(state, 12), f"{i} {name}"])
            for e in (mode.frequency, mode.damping_ratio):
                half = half_width(e.value, e.high) if e.determined else ""
                rows[-1] += [right(value_text(e)), right(half)]
    return rows


def matrix_rows(result: Identification) -> list[list[Cell]]:
    """Return M, C and K of every mass state, SI; a row of names before each."""
    if result.undetermined:
        return [["No matrices: a parameter in them is not determined (see Findings)."]]
    rows: list[list[Cell]] = []
    for state, model in result.physical.items():
        for letter, unit, matrix in (
            ("M", "kg, kg m²", model.M),
            ("C", "N s/m, N m s/rad", model.C),
            ("K", "N/m, N m/rad", model.K),
        ):
            title = f"{letter} {printable(state, 9)}"
            rows.append([title, *(right(dof) for dof in _DOF), f" {unit}"])
            for dof, row in zip(_DOF, matrix.tolist(), strict=True):
                rows.append([f"  {dof}", *(right(_short(value)) for value in row)])
    return rows


def _short(value: float) -> str:
    return "0" if abs(value) < 1e-9 else f"{value:.5g}" if abs(value) < 1e4 else f"{value:,.0f}"


def run_rows(outcome: Outcome, glyphs: Glyphs) -> list[list[Cell]]:
    """Return a row for each run of the result."""
    rows: list[list[Cell]] = []
    for run in outcome.runs:
        chi2 = outcome.result.quality.chi2_by_run.get(run.label, {}).values()
        rows.append(
            [
                f"{mark(run.status, glyphs)} {printable(run.label, 40)}",
                "" if run.status == "accepted" else f" {run.status.upper()}",
                f" chi2/n {sum(chi2) / len(chi2):.2f}" if chi2 else "",
            ]
        )
    return rows


def damper_lines(result: Identification) -> Iterator[str]:
    """Yield force at speeds, elements, remarks, and which elements were tried; none if linear."""
    forces = result.forces
    if forces is None:
        return
    yield "Force of one corner at the wheel, N ± half of the 95 % interval"
    yield "over its speed, compression positive; on the right of each with friction"
    yield f"{'m/s':>6}" + "".join(f"{name:>18}" for name in damper_columns(forces))
    for speed, *texts in damper_rows(forces):
        yield f"{speed:>6}" + "".join(f"{text:>18}" for text in texts)
    yield ""
    yield f"{'element of one corner':<30}{'value':>14} {'':<6}{'95 % interval':>26}"
    for one in forces.axles:
        for name, e in one.values.items():
            unit = unit_text(e.unit) if e.determined else ""
            head = f"{one.axle} {plain(name)}"
            yield f"{head:<30}{value_text(e):>14} {unit:<6}{ends_text(e):>26}"
    for one in forces.axles:
        yield from (f"  {one.axle} {note}" for note in one.notes)
    yield ""
    yield "Elements that were tried"
    for tried in forces.choices:
        yield f"  {plain(tried.name):<30}{element_answer(tried)}"


_PAGES = ("Parameters", "Modes", "M C K", "Decays", "Findings", "Derived", "Dampers")
_WIDE = 100
"""Least number of columns for shares, and what a parameter rests on."""
_VERDICT_LINES, _VERDICT_LINES_TALL = 4, 8
_REASON = "excluded at the results"


def _name(page: str) -> str:
    return page.replace(" ", "").lower()


class ResultsScreen(BenchScreen):
    """Shows the results of one session; Tab chooses the page."""

    HELP_PAGE: ClassVar[str] = "results"
    DEFAULT_CSS = """
    ResultsScreen #verdict { height: auto; padding: 0 1; }
    ResultsScreen #verdict.ok { color: $success; }
    ResultsScreen #verdict.doubtful { color: $warning; }
    ResultsScreen #verdict.refused { color: $error; }
    ResultsScreen #head { height: 1; }
    ResultsScreen Tabs { width: auto; height: 1; }
    ResultsScreen Underline { display: none; }
    ResultsScreen Tab { color: $foreground; }
    ResultsScreen Tab.-active { text-style: bold reverse; }
    ResultsScreen #space { width: 1fr; color: $accent; text-style: bold; text-wrap: nowrap; }
    ResultsScreen ContentSwitcher { height: 1fr; }
    ResultsScreen VerticalScroll { padding: 0 1; scrollbar-size: 1 1; }
    ResultsScreen #runs { height: 6; }
    ResultsScreen.-tall #runs { height: 12; }
    ResultsScreen DecayPlot { height: 1fr; }
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
        Binding("escape", "back", "Back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self.outcome: Outcome | None = None
        self._recording = ""
        self._shown_outdated = False

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Let X start a recorder that is lost, and exclude a run otherwise."""
        if action == "exclude":
            return not super().check_action("start_recorder", ())
        return super().check_action(action, parameters)

    def compose_body(self) -> ComposeResult:
        """Compose verdict and pages."""
        yield Static(id="verdict", markup=False)
        with Horizontal(id="head"):
            tabs = Tabs(*(Tab(page, id=_name(page)) for page in _PAGES))
            tabs.can_focus = False
            yield tabs
            yield Static(id="space", markup=False)
        with ContentSwitcher(initial="parameters"):
            for page in ("parameters", "modes", "mck", "derived"):
                yield Table(page, reads=True)
            with Vertical(id="decays"):
                yield Table("runs")
                yield DecayPlot(self.bench_app.glyphs)
            for page in ("findings", "dampers"):
                with VerticalScroll(id=page, can_focus=False):
                    yield Static(markup=False)

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

    async def action_back(self) -> None:
        """Go back to the identify screen."""
        await self.bench_app.go_to(BenchStep.IDENTIFY)

    def action_page(self, step: int) -> None:
        """Show the next page."""
        tabs = self.query_one(Tabs)
        if step > 0:
            tabs.action_next_tab()
        else:
            tabs.action_previous_tab()

    def action_decays(self) -> None:
        """Show the decays, or the parameters again."""
        self.query_one(Tabs).active = "parameters" if self._page == "decays" else "decays"

    def action_move(self, step: int) -> None:
        """Move between the runs where they are shown; else scroll."""
        if self._page == "decays":
            runs = self.query_one("#runs", Table)
            runs.choose(runs.cursor_row + step)
        else:
            self.query_one(f"ContentSwitcher > #{self._page}").scroll_relative(
                y=2 * step, animate=False
            )

    async def action_exclude(self) -> None:
        """Reject the chosen run (or take it back) and identify again."""
        outcome = self.outcome
        if outcome is None or not outcome.runs:
            return
        if self._page != "decays":
            self.bench_app.warn("choose the run first: P shows the runs, X then excludes one")
            return
        label = outcome.runs[self.query_one("#runs", Table).cursor_row].label
        status = self.bench_app.status
        run = None
        if status is not None and self._is_current(status):
            run = next((run for run in status.runs if run.label == label), None)
        if run is None:  # an earlier session: its file stays unchanged
            without = tuple(sorted(set(outcome.without) ^ {label}))
            await self.bench_app.open_identify(outcome.session, without)
            return
        accepted = run.status is LoggedStatus.ACCEPTED
        order = Reject(label, _REASON) if accepted else Accept(label, "taken back at the results")
        if await self.bench_app.ask(order) is not None:
            await self.bench_app.open_build()

    def action_export(self) -> None:
        """Write the session in another tool's format."""
        if self.outcome is not None:
            self.run_worker(export_session(self.app, self.outcome.session), group="export")

    def on_tabs_tab_activated(self, event: Tabs.TabActivated) -> None:
        """Show the page of a tab."""
        self.query_one(ContentSwitcher).current = event.tab.id

    def on_data_table_row_highlighted(self, event: Table.RowHighlighted) -> None:
        """Show the decay of the marked run."""
        outcome, row = self.outcome, event.cursor_row
        run = outcome.runs[row] if outcome is not None and row < len(outcome.runs) else None
        self.query_one(DecayPlot).show(run)

    # Inside -------------------------------------------------------------------------------------

    @property
    def _page(self) -> str:
        return self.query_one(Tabs).active

    def _is_current(self, status: Status | None) -> bool:
        """Return True if the outcome belongs to the present recording."""
        return status is not None and status.recording == self._recording

    def _fill(self) -> None:
        """Show an outcome from its first page."""
        if not self.query("#runs") or self.outcome is None:
            return
        tabs = self.query_one(Tabs)
        result = self.outcome.result
        if result.forces:
            tabs.show("dampers")
        else:
            tabs.hide("dampers")
        tabs.styles.width = 63 if result.forces else 54
        tabs.active = "parameters" if result.parameters else "findings"
        self._draw()

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
        result = outcome.result
        verdict.set_classes(str(result.quality.verdict))
        step = BenchStep.IDENTIFY if self._shown_outdated else BenchStep.REPORT
        name = printable(Path(outcome.session).name, 60)
        ours = self.step_shown is not None
        words = f"step {step.title}" if ours else f"report of {name}"
        self.query_one("#space", Static).update(f"SPACE = {words}")
        wide = size.width >= _WIDE
        for page, estimates, in_words in (
            ("parameters", result.parameters, parameter_words),
            ("derived", result.derived, plain),
        ):
            table = parameter_rows(estimates, in_words, result.drivers, glyphs, wide)
            self.query_one(f"Table#{page}", Table).show(*table)
        heads = ("mass state", "mode", "Hz", "± 95 %", "damping ratio", "± 95 %")
        self.query_one("Table#modes", Table).show(heads, mode_rows(result))
        self.query_one("Table#mck", Table).show([""] * 9, matrix_rows(result))
        self.query_one("#runs", Table).show([""] * 3, run_rows(outcome, glyphs))
        findings = "\n".join(findings_lines(outcome, glyphs, size.width - 3))
        self.query_one("#findings Static", Static).update(findings)
        self.query_one("#dampers Static", Static).update("\n".join(damper_lines(result)))
