"""Results of a session, verdict first; and the sessions of the folder."""

from __future__ import annotations

from contextlib import aclosing, redirect_stdout
from io import StringIO
from math import isfinite
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, ClassVar

from textual import work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import TabbedContent, TabPane, Tabs

from daq.control.messages import Accept, Mark, Reject, Status
from daq.runs import RunStatus
from dbc import counted
from dbc.words import Finding, printable
from identify import Identification, Verdict
from identify.numbers import half_width, largest_share
from identify.words import (
    HEADLINE,
    MEANING,
    ends_text,
    half_text,
    parameter_words,
    survival_lines,
    unit_text,
    value_text,
)

from ...jobs.session_list import EntryState, SessionEntry, with_open
from ...jobs.worker import Item, ListTask, Outcome, Task, Trouble, lines_of
from ..campaign import BenchStep, is_marked, progress
from ..widgets import SPACE_INK, Cell, Table, Words, right
from ..words import Glyphs
from .base import BenchScreen, SessionScreen
from .work import OUTDATED

if TYPE_CHECKING:
    from identify.nonlinear.forces import Forces

_SEVERITY = {Verdict.REFUSED: "REFUSED", Verdict.DOUBTFUL: "DOUBT", Verdict.OK: "note"}


def mark(verdict: str, glyphs: Glyphs) -> str:
    """Return the symbol of a verdict or severity."""
    return {"ok": glyphs.good, "accepted": glyphs.good, "doubtful": glyphs.warn}.get(
        verdict, glyphs.bad
    )


def verdict_lines(outcome: Outcome, glyphs: Glyphs, width: int, most: int) -> list[str]:
    """Return the verdict, then its reasons (notes only if there is none): at most `most` lines."""
    quality = outcome.result.quality
    verdict = quality.verdict
    fit = f"   chi2/n {quality.chi2_per_n:.3f}" if isfinite(quality.chi2_per_n) else ""
    head = f"{mark(verdict, glyphs)} {verdict.upper()}  {HEADLINE[verdict]}"
    tail = f"{outcome.used} of {counted(len(outcome.runs), 'run')} used{fit}"
    one_line = f"{head}   {tail}"
    lines = [one_line] if len(one_line) <= width else [head, f"  {tail}"]
    grave = [f for f in quality.findings if Verdict.of(f.severity) is not Verdict.OK]
    for finding in grave or quality.findings:
        lines += finding_lines(finding, glyphs, width)
    if not quality.findings:
        lines += wrap(MEANING[verdict], width - 2, initial_indent="  ", subsequent_indent="  ")
    if len(lines) > most:
        more = counted(len(lines) - most + 1, "more line")
        lines = [*lines[: most - 1], f"  ... {more}: Tab to Findings"]
    return lines


def finding_lines(finding: Finding, glyphs: Glyphs, width: int) -> list[str]:
    """Return one finding, folded."""
    severity = Verdict.of(finding.severity)
    head = f"{mark(severity, glyphs)} {_SEVERITY[severity]}: "
    return wrap(head + printable(finding.text, 1000), width, subsequent_indent="    ")


def findings_lines(outcome: Outcome, glyphs: Glyphs, width: int) -> list[str]:
    """Return all findings, and the warnings that a person overrode."""
    quality = outcome.result.quality
    lines = [*wrap(MEANING[quality.verdict], width), ""]
    for finding in quality.findings:
        lines += finding_lines(finding, glyphs, width)
    if not quality.findings:
        lines.append(f"{glyphs.good} nothing was found that speaks against the result")
    overridden = [f"{glyphs.warn} {text}" for text in outcome.overrides] or ["  none"]
    survival = [f"  {text}" for text in survival_lines(quality)]
    for title, texts in (
        ("Which parameters can be used:", survival),
        ("Warnings of the bench check that a person overrode:", overridden),
    ):
        lines += ["", title] if texts else []
        for text in texts:
            lines += wrap(printable(text, 700), width, subsequent_indent="    ")
    return lines


def parameter_rows(result: Identification, wide: bool) -> tuple[list[str], list[list[Cell]]]:
    """Return heads and rows of the parameters with their 95 % intervals.

    `wide`: add a column of what each rests mostly on.
    """
    heads = ["parameter", "value", "unit", "95 % interval", "±"]
    rows: list[list[Cell]] = []
    for name, e in result.parameters.items():
        if e.determined:
            value, interval = value_text(e), ends_text(e)
        else:  # which is said where there is room for it
            value, interval = "", value_text(e)
        title = f"{name:<5}{parameter_words(name)}"[:29]
        rows.append([title, right(value), unit_text(e.unit), right(interval), right(half_text(e))])
        if wide:
            rows[-1].append(f" {largest_share(result.drivers.get(name, {}))}")
    return [*heads, " rests mostly on"] if wide else heads, rows


def mode_rows(result: Identification) -> list[list[Cell]]:
    """Return the modes of every mass state with half of their 95 % intervals."""
    rows: list[list[Cell]] = []
    for state, modes in result.modes.items():
        named_modes = zip(result.mode_names[state], modes, strict=True)
        for number, (name, mode) in enumerate(named_modes, start=1):
            row: list[Cell] = [printable(state, 12), f"{number} {name}"]
            for estimate in (mode.frequency, mode.damping_ratio):
                half = half_width(estimate.value, estimate.high) if estimate.determined else ""
                row += [right(value_text(estimate)), right(half)]
            rows.append(row)
    return rows


def run_rows(outcome: Outcome, glyphs: Glyphs) -> list[list[Cell]]:
    """Return a row for each run of the result."""
    rows: list[list[Cell]] = []
    for run in outcome.runs:
        name = f"{mark(run.status, glyphs)} {printable(run.label, 40)}"
        status = "" if run.status == "accepted" else f" {run.status.upper()}"
        chi2 = outcome.result.quality.chi2_by_run.get(run.label, {}).values()  # of its channels
        rows.append([name, status, f" chi2/n {sum(chi2) / len(chi2):.2f}" if chi2 else ""])
    return rows


def forces_text(forces: Forces) -> str:
    """Return damper curves and force elements as `bumpbench identify` prints them."""
    from ...result import print_forces  # with what prints a table

    with redirect_stdout(StringIO()) as printed:
        print_forces(forces)
    return printed.getvalue()


_PAGES = ("Parameters", "Modes", "Runs", "Findings", "Dampers")
_WIDE = 100
"""Least number of columns for shares, and what a parameter rests on."""
_VERDICT_LINES, _VERDICT_LINES_TALL = 3, 8


class ResultsScreen(SessionScreen):
    """Shows the results of one session; Tab chooses the page."""

    HELP_PAGE: ClassVar[str] = "results"
    STEP: ClassVar[BenchStep] = BenchStep.IDENTIFY
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "page(1)", "Page", tooltip="Next page"),
        Binding("shift+tab", "page(-1)", "Page back", show=False),
        Binding("down", "move(1)", "Next run, or scroll", show=False),
        Binding("up", "move(-1)", "Run before, or scroll back", show=False),
        Binding("x", "start_recorder", "Start recorder"),
        Binding("x", "exclude", "Exclude run", tooltip="Leave the marked run out, or use it again"),
        Binding("escape", "back", "Back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self.outcome: Outcome | None = None

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Let X start a recorder that is lost, and exclude a run otherwise."""
        if action == "exclude":
            return not super().check_action("start_recorder", ())
        return super().check_action(action, parameters)

    def compose_body(self) -> ComposeResult:
        """Compose verdict and pages."""
        yield Words("verdict")
        yield Words("space")
        with TabbedContent(id="pages"):
            for title in _PAGES:
                page = title.lower()
                with TabPane(title, id=page):
                    if page in ("findings", "dampers"):
                        with VerticalScroll(can_focus=False):
                            yield Words(f"{page}-text")
                    else:
                        yield Table(f"{page}-table", reads=page != "runs")

    def on_mount(self) -> None:
        """Show an outcome that arrived before the screen was composed."""
        self.query_one(Tabs).can_focus = False
        self._fill()

    def show_status(self, status: Status) -> None:
        """Show whether the recording has changed since."""
        self._draw()

    @property
    def ready(self) -> bool:
        """True while `--auto` may press SPACE."""
        return self.outcome is not None

    def show_outcome(self, outcome: Outcome) -> None:
        """Show an identification."""
        self.outcome, self.session = outcome, outcome.session
        self._fill()

    # Keys ---------------------------------------------------------------------------------------

    async def action_next(self) -> None:
        """Go on to the report of this session."""
        if self.outcome is None or self.outdated:
            await self.bench_app.go_to(BenchStep.IDENTIFY)
            return
        status, step = self.bench_app.status, BenchStep.IDENTIFY
        if status is not None and self.is_of_recording and not is_marked(status, step):
            await self.bench_app.ask(Mark(step.mark))
        (await self.bench_app.open("report")).show_session(self.session)

    async def action_back(self) -> None:
        """Go back to the identify screen."""
        await self.bench_app.go_to(BenchStep.IDENTIFY)

    def action_page(self, step: int) -> None:
        """Show the next page."""
        tabs = self.query_one(Tabs)
        tabs.action_next_tab() if step > 0 else tabs.action_previous_tab()

    def action_move(self, step: int) -> None:
        """Move between the runs where they are shown; else scroll."""
        page = self.query_one(TabbedContent).active
        if page == "runs":
            runs = self.query_one("#runs-table", Table)
            runs.choose(runs.cursor_row + step)
        else:
            widget = self.query_one(f"#{page} > *")
            widget.scroll_relative(y=2 * step, animate=False)

    async def action_exclude(self) -> None:
        """Reject the marked run of this recording, or take it back, and identify again."""
        outcome, status = self.outcome, self.bench_app.status
        if outcome is None or not outcome.runs:
            return
        if self.query_one(TabbedContent).active != "runs":
            self.bench_app.warn("choose the run first: Tab shows the runs, X then excludes one")
            return
        label = outcome.runs[self.query_one("#runs-table", Table).cursor_row].label
        runs = status.runs if status is not None and self.is_of_recording else ()
        run = next((run for run in runs if run.label == label), None)
        if run is None:
            self.bench_app.warn("the runs of an earlier session stay as they are")
            return
        accepted = run.status is RunStatus.ACCEPTED
        reason = "changed at the results"
        order = Reject(label, reason) if accepted else Accept(label, reason)
        if await self.bench_app.ask(order) is not None:
            await (await self.bench_app.open("identify")).build()

    # Inside -------------------------------------------------------------------------------------

    def _fill(self) -> None:
        """Show an outcome from its first page."""
        outcome = self.outcome
        if outcome is None or not self.query("#space"):
            return
        pages = self.query_one(TabbedContent)
        result = outcome.result
        pages.active = "parameters" if result.parameters else "findings"
        glyphs = self.bench_app.glyphs
        heads = ("mass state", "mode", "Hz", "± 95 %", "damping ratio", "± 95 %")
        self.query_one("#modes-table", Table).show(heads, mode_rows(result))
        self.query_one("#runs-table", Table).show([""] * 3, run_rows(outcome, glyphs))
        pages.hide_tab("dampers")
        if result.forces:
            pages.show_tab("dampers")
            self.query_one("#dampers-text", Words).say(Content(forces_text(result.forces)))
        self._draw()

    def _draw(self) -> None:
        """Show what depends on the size of the terminal, and on the recording."""
        outcome, space = self.outcome, self.query_one("#space", Words)
        if outcome is None:
            words = "nothing is identified yet: SPACE = step 6 Identify"
            space.say(Content.styled(words, SPACE_INK))
            return
        glyphs, (width, height) = self.bench_app.glyphs, self.app.size
        most = _VERDICT_LINES if height < 36 else _VERDICT_LINES_TALL
        lines = [f"{glyphs.warn} {OUTDATED}"] if self.outdated else []
        lines += verdict_lines(outcome, glyphs, width - 2, most - len(lines))
        verdict = self.query_one("#verdict", Words)
        verdict.say(Content("\n".join(lines)))
        verdict.set_classes(str(outcome.result.quality.verdict))
        step = BenchStep.IDENTIFY if self.outdated else BenchStep.REPORT
        name = printable(Path(outcome.session).name, 60)
        words = f"step {step.title}" if self.step_shown is not None else f"report of {name}"
        space.say(Content.styled(f"SPACE = {words}", SPACE_INK))
        table = parameter_rows(outcome.result, width >= _WIDE)
        self.query_one("#parameters-table", Table).show(*table)
        findings = "\n".join(findings_lines(outcome, glyphs, width - 3))
        self.query_one("#findings-text", Words).say(Content(findings))


class SessionsScreen(BenchScreen):
    """The sessions of the folder, which is read again whenever the screen comes to the front."""

    HELP_PAGE: ClassVar[str] = "sessions"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space,o", "next", "Open", key_display="SPACE",
                tooltip="Results of the marked session"),
        Binding("r", "report", "Report", tooltip="Write its report"),
        Binding("escape", "app.home", "Back", show=False),
    ]  # fmt: skip

    def __init__(self) -> None:
        super().__init__()
        self._entries: list[SessionEntry] = []
        self._trouble = ""
        self._reading = False

    def compose_body(self) -> ComposeResult:
        """Compose the place of the marked session, and the list."""
        yield Words("about")
        table = Table("list")
        table.can_focus = True
        yield table

    def on_screen_resume(self) -> None:
        """Read the folder anew."""
        self.query_one(Table).focus()
        self._read()

    @property
    def acts(self) -> bool:
        """True while a session is marked."""
        return self._chosen is not None

    @property
    def ready(self) -> bool:
        """Never: `--auto` opens no session."""
        return False

    def show_status(self, status: Status) -> None:
        """Mark the session that is being recorded."""
        before = self._entries
        self._entries = [with_open(entry, status.recording) for entry in before]
        if self._entries != before:
            self._draw()

    async def action_next(self) -> None:
        """Show the results of a session; for the open recording, go to its due step."""
        entry = self._chosen
        if entry is None:
            return
        if entry.state is EntryState.OPEN:
            await self.bench_app.go_to(progress(self.bench_app.status).due)
        elif entry.state is EntryState.CUT_OFF:
            self.bench_app.warn("this recording was cut off: F1 says how to go on with it")
        elif self._is_file(entry):
            (await self.bench_app.open("identify")).begin(entry.path)

    async def action_report(self) -> None:
        """Write the report of a session."""
        entry = self._chosen
        if entry is not None and self._is_file(entry):
            report = await self.bench_app.open("report")
            report.show_session(entry.path)
            report.begin()

    def on_data_table_row_highlighted(self, _: Table.RowHighlighted) -> None:
        """Show where the marked session is."""
        self._about()

    async def on_data_table_row_selected(self, _: Table.RowSelected) -> None:
        """Open the session on Enter."""
        await self.action_next()

    @work(group="list", exclusive=True)
    async def _read(self) -> None:
        entries: list[SessionEntry] = []
        self._reading, self._trouble = True, ""
        task: Task = ListTask(str(self.bench_app.folder))
        async with aclosing(lines_of(task, "list of sessions")) as lines:
            async for line in lines:
                if isinstance(line, Item):
                    entries.append(line.body)
                elif isinstance(line, Trouble):
                    self._trouble = line.text
        status = self.bench_app.status
        self._entries = [with_open(e, status.recording if status else "") for e in entries]
        self._reading = False
        self._draw()

    def _is_file(self, entry: SessionEntry) -> bool:
        """Return True if there is a session file that can be read; else say why not."""
        if entry.path and entry.state is not EntryState.DAMAGED:
            return True
        status = self.bench_app.status
        if entry.state is EntryState.OPEN and status is not None and status.own_session:
            name = printable(Path(status.own_session).name, 60)
            self.bench_app.warn(f"this line is the recording itself: mark that of {name}")
        else:
            self.bench_app.warn(entry.note or "there is no session file yet: step 6 makes it")
        return False

    @property
    def _chosen(self) -> SessionEntry | None:
        row = self.query_one(Table).cursor_row
        return self._entries[row] if row < len(self._entries) else None

    def _draw(self) -> None:
        if len(self.query("#list, #about")) < 2:
            return  # not composed yet, or being removed
        glyphs = self.bench_app.glyphs
        marks = {
            EntryState.OPEN: glyphs.bus,
            EntryState.CUT_OFF: glyphs.warn,
            EntryState.REPORTED: glyphs.good,
            EntryState.DAMAGED: glyphs.bad,
        }
        rows: list[list[Cell]] = []
        for entry in self._entries:  # its texts may come from a foreign file
            known = bool(entry.vehicle or entry.recording)
            counts = (entry.accepted + entry.rejected, entry.rejected)
            rows.append(
                [
                    printable(entry.date, 16),
                    printable(entry.vehicle or entry.name, 28),
                    f"{marks.get(entry.state, ' ')} {entry.state}",
                    *(right(str(count) if known else "") for count in counts),
                    printable(entry.note, 160),
                ]
            )
        self.query_one(Table).show(("date", "vehicle", "state", "runs", "rejected", "note"), rows)
        self._about()

    def _about(self) -> None:
        entry = self._chosen
        words = "reading the folder ..." if self._reading else "no session here yet"
        if entry is not None:
            words = printable(entry.path or str(Path(entry.folder) / "journal"), 400)
            words = f"{words}\n{printable(entry.note, 300)}"
        self.query_one("#about", Words).say(Content(self._trouble or words))
