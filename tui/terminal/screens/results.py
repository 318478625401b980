"""Results of the recording, verdict first."""

from __future__ import annotations

from math import isfinite
from textwrap import wrap
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import TabbedContent, TabPane, Tabs

from daq.control.messages import Accept, Reject, Status
from daq.runs import RunStatus
from dbc import counted
from dbc.words import Finding, printable
from identify import Identification, Verdict, words
from identify.numbers import half_width

from ...jobs.worker import Outcome
from ..campaign import BenchStep
from ..widgets import SPACE_INK, Cell, Table, Words, right
from ..words import Glyphs
from .base import SessionScreen
from .work import OUTDATED

_SEVERITY_WORDS = {Verdict.REFUSED: "REFUSED", Verdict.DOUBTFUL: "DOUBT", Verdict.OK: "note"}


def symbol(verdict: str, glyphs: Glyphs) -> str:
    """Return the character for a verdict on a result or a run, or for a severity."""
    symbols = {"ok": glyphs.good, "accepted": glyphs.good, "doubtful": glyphs.warn}
    return symbols.get(verdict, glyphs.bad)


def verdict_lines(outcome: Outcome, glyphs: Glyphs, width: int, most_lines: int) -> list[str]:
    """Return the verdict, then its reasons (notes only if there is none): `most_lines` at most."""
    quality = outcome.result.quality
    verdict = quality.verdict
    fit = f"   chi2/n {quality.chi2_per_n:.3f}" if isfinite(quality.chi2_per_n) else ""
    head = f"{symbol(verdict, glyphs)} {verdict.upper()}  {words.HEADLINE[verdict]}"
    n_used = sum(status == "accepted" for _, status in outcome.runs)
    basis = f"{n_used} of {counted(len(outcome.runs), 'run')} used{fit}"
    one_line = f"{head}   {basis}"
    lines = [one_line] if len(one_line) <= width else [head, f"  {basis}"]
    reasons = [f for f in quality.findings if Verdict.of(f.severity) is not Verdict.OK]
    for finding in reasons or quality.findings:
        lines += finding_lines(finding, glyphs, width)
    if not quality.findings:
        meaning = words.MEANING[verdict]
        lines += wrap(meaning, width - 2, initial_indent="  ", subsequent_indent="  ")
    if len(lines) > most_lines:
        left_out = counted(len(lines) - most_lines + 1, "more line")
        lines = [*lines[: most_lines - 1], f"  ... {left_out}: Tab to Findings"]
    return lines


def finding_lines(finding: Finding, glyphs: Glyphs, width: int) -> list[str]:
    """Return one finding, folded."""
    severity = Verdict.of(finding.severity)
    head = f"{symbol(severity, glyphs)} {_SEVERITY_WORDS[severity]}: "
    return wrap(head + printable(finding.text, 1000), width, subsequent_indent="    ")


def findings_page(outcome: Outcome, glyphs: Glyphs, width: int) -> list[str]:
    """Return the lines of all findings, of usable parameters, and of overridden warnings."""
    quality = outcome.result.quality
    lines = [*wrap(words.MEANING[quality.verdict], width), ""]
    for finding in quality.findings:
        lines += finding_lines(finding, glyphs, width)
    if not quality.findings:
        lines.append(f"{glyphs.good} nothing was found that speaks against the result")
    overridden = [f"{glyphs.warn} {text}" for text in outcome.overrides] or ["  none"]
    usable = [f"  {text}" for text in words.survival_lines(quality)]
    for title, texts in (
        ("Which parameters can be used:", usable),
        ("Warnings of the bench check that a person overrode:", overridden),
    ):
        lines += ["", title] if texts else []
        for text in texts:
            lines += wrap(printable(text, 700), width, subsequent_indent="    ")
    return lines


def parameter_rows(result: Identification) -> list[list[Cell]]:
    """Return name, value, unit, 95 % interval and half of it for each parameter."""
    rows: list[list[Cell]] = []
    for name, estimate in result.parameters.items():
        if estimate.determined:
            value, interval = words.value_text(estimate), words.ends_text(estimate)
        else:  # `not determined` has room in the column of intervals only
            value, interval = "", words.value_text(estimate)
        title = f"{name:<5}{words.parameter_words(name)}"[:29]  # for a table of 80 columns
        numbers = right(interval), right(words.half_text(estimate))
        rows.append([title, right(value), words.unit_text(estimate.unit), *numbers])
    return rows


def mode_rows(result: Identification) -> list[list[Cell]]:
    """Return the modes of every mass state with half of their 95 % intervals."""
    rows: list[list[Cell]] = []
    for state, modes in result.modes.items():
        named_modes = zip(result.mode_names[state], modes, strict=True)
        for number, (name, mode) in enumerate(named_modes, start=1):
            row: list[Cell] = [printable(state, 12), f"{number} {name}"]
            for estimate in (mode.frequency, mode.damping_ratio):
                half = half_width(estimate.value, estimate.high) if estimate.determined else ""
                row += [right(words.value_text(estimate)), right(half)]
            rows.append(row)
    return rows


def run_rows(outcome: Outcome, glyphs: Glyphs) -> list[list[Cell]]:
    """Return name, `REJECTED` if it is so, and misfit of each run of the result."""
    rows: list[list[Cell]] = []
    for label, status in outcome.runs:
        name = f"{symbol(status, glyphs)} {printable(label, 40)}"
        rejected = "" if status == "accepted" else f" {status.upper()}"
        of_channels = outcome.result.quality.chi2_by_run.get(label, {}).values()
        mean = f" chi2/n {sum(of_channels) / len(of_channels):.2f}" if of_channels else ""
        rows.append([name, rejected, mean])
    return rows


class ResultsScreen(SessionScreen):
    """Shows the results of the identification; Tab chooses the page."""

    STEP: ClassVar[BenchStep] = BenchStep.IDENTIFY
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "page(1)", "Page", tooltip="Next page"),
        Binding("shift+tab", "page(-1)", "Page back", show=False),
        Binding("down", "move(1)", "Next run, or scroll", show=False),
        Binding("up", "move(-1)", "Run before, or scroll back", show=False),
        Binding("x", "exclude", "Exclude run", tooltip="Leave the marked run out, or use it again"),
        Binding("escape", "back", "Back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self.outcome: Outcome | None = None

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave X to the app while the recorder is lost: it starts one then."""
        if action == "exclude":
            return self.bench_app.lost is None
        return super().check_action(action, parameters)

    def compose_body(self) -> ComposeResult:
        """Compose verdict and pages."""
        yield Words("verdict")
        yield Words("space")
        with TabbedContent(id="pages"):
            for title in ("Parameters", "Modes", "Runs", "Findings"):
                page = title.lower()
                with TabPane(title, id=page):
                    if page == "findings":
                        with VerticalScroll(can_focus=False):
                            yield Words("findings-text")
                    else:
                        yield Table(f"{page}-table", reads=page != "runs")

    def on_mount(self) -> None:
        """Leave Tab to the screen."""
        self.query_one(Tabs).can_focus = False

    def show_outcome(self, outcome: Outcome) -> None:
        """Show an identification from its first page, on a screen that has been opened."""
        self.outcome, self.session = outcome, outcome.session
        result, glyphs = outcome.result, self.bench_app.glyphs
        first_page = "parameters" if result.parameters else "findings"
        self.query_one(TabbedContent).active = first_page
        heads = ("parameter", "value", "unit", "95 % interval", "±")
        self.query_one("#parameters-table", Table).show(heads, parameter_rows(result))
        heads_of_modes = ("mass state", "mode", "Hz", "± 95 %", "damping ratio", "± 95 %")
        self.query_one("#modes-table", Table).show(heads_of_modes, mode_rows(result))
        self.query_one("#runs-table", Table).show([""] * 3, run_rows(outcome, glyphs))
        self._show()

    async def action_next(self) -> None:
        """Go on to the report."""
        if self.outdated:
            await self.bench_app.go_to(BenchStep.IDENTIFY)
        else:
            await self.bench_app.finish(self.STEP)
            await self.bench_app.go_to(BenchStep.REPORT)

    async def action_back(self) -> None:
        """Go back to the identify screen."""
        await self.bench_app.go_to(BenchStep.IDENTIFY)

    def action_page(self, direction: int) -> None:
        """Show the next page, or with -1 the one before."""
        tabs = self.query_one(Tabs)
        tabs.action_next_tab() if direction > 0 else tabs.action_previous_tab()

    def action_move(self, direction: int) -> None:
        """Mark the next run (1) or the one before (-1) where runs are shown; else scroll."""
        page = self.query_one(TabbedContent).active
        if page == "runs":
            runs = self.query_one("#runs-table", Table)
            runs.move_cursor(row=max(0, runs.cursor_row + direction))
        else:
            self.query_one(f"#{page} > *").scroll_relative(y=2 * direction, animate=False)

    async def action_exclude(self) -> None:
        """Reject the marked run of this recording, or take it back, and identify again."""
        outcome, status = self.outcome, self.bench_app.status
        if outcome is None or not outcome.runs:
            return
        if self.query_one(TabbedContent).active != "runs":
            self.bench_app.warn("choose the run first: Tab shows the runs, X then excludes one")
            return
        label, _ = outcome.runs[self.query_one("#runs-table", Table).cursor_row]
        if status is None or status.own_session != self.session:
            self.bench_app.warn("these are the runs of the recording before: they stay")
            return
        run = next(run for run in status.runs if run.label == label)
        accepted = run.status is RunStatus.ACCEPTED
        reason = "changed at the results"
        order = Reject(label, reason) if accepted else Accept(label, reason)
        if await self.bench_app.ask(order) is not None:
            await (await self.bench_app.open("identify")).build()

    def show_status(self, status: Status) -> None:
        """Show what depends on the size of the terminal, and on the recording."""
        outcome = self.outcome
        if outcome is None:  # `show_outcome` follows as soon as the screen is open
            return
        glyphs, (width, height) = self.bench_app.glyphs, self.app.size
        most_lines = 3 if height < 36 else 8  # the table of parameters needs the others
        lines = [f"{glyphs.warn} {OUTDATED}"] if self.outdated else []
        lines += verdict_lines(outcome, glyphs, width - 2, most_lines - len(lines))
        verdict = self.query_one("#verdict", Words)
        verdict.say(Content("\n".join(lines)))
        verdict.set_classes(str(outcome.result.quality.verdict))
        step = BenchStep.IDENTIFY if self.outdated else BenchStep.REPORT
        next_words = Content.styled(f"SPACE = step {step.title}", SPACE_INK)
        self.query_one("#space", Words).say(next_words)
        findings = "\n".join(findings_page(outcome, glyphs, width - 3))
        self.query_one("#findings-text", Words).say(Content(findings))
