"""Steps 6 and 7: identify and report, in a worker with progress; and exports."""

from __future__ import annotations

from abc import abstractmethod
from contextlib import aclosing
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from glob import escape
from pathlib import Path
from typing import Any, ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.widgets import Static

from daq.control.messages import SessionState, Status
from daq.control.orders import Build, Mark, Start
from daq.errors import printable
from daq.runlog import LoggedStatus
from dbc import counted, plural

from ...jobs.lines import (
    Done,
    ExportTask,
    IdentifyTask,
    Item,
    Line,
    Outcome,
    Progress,
    ReportTask,
    Trouble,
)
from ...jobs.session_list import report_of, size_text
from ...jobs.worker import lines_of
from ..context import begin
from ..state.campaign import BenchStep, is_marked
from ..state.glyphs import Glyphs
from .base import BenchScreen
from .dialogs import ChoiceScreen, Confirm


class Stage(StrEnum):
    """Stages of the work."""

    IDLE = "idle"
    BUILDING = "building the session file"
    WORKING = "working"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class LongWork:
    """The state of the work."""

    stage: Stage = Stage.IDLE
    session: str = ""
    """Session file that is being processed."""
    share: float = 0.0
    """Share of the work that is done, 0..1."""
    begun: tuple[str, ...] = ()
    """The parts that were begun, in order."""
    trouble: Trouble | None = None
    """Why it failed."""
    answer: Any = None
    """The worker's answer."""


def after(work: LongWork, line: Line) -> LongWork:
    """Return the state after a line."""
    match line:
        case Progress(share, text):
            begun = work.begun if text in work.begun else (*work.begun, text)
            # Two processes report in any order, but a bar never goes back.
            share = max(work.share, min(1.0, share))
            return replace(work, stage=Stage.WORKING, share=share, begun=begun)
        case Done(body):
            return replace(work, stage=Stage.DONE, share=1.0, answer=body)
        case Trouble():
            return replace(work, stage=Stage.FAILED, trouble=line)
        case Item():
            return work


def bar_line(share: float, width: int, glyphs: Glyphs) -> str:
    """Return a bar with its figure."""
    cells = max(8, min(60, width - 10))
    full = round(share * cells)
    return f"[{glyphs.full * full}{glyphs.empty * (cells - full)}] {share:4.0%}"


def work_text(work: LongWork, glyphs: Glyphs, width: int) -> list[str]:
    """Return bar and stages, or the error and what to do."""
    if work.stage is Stage.FAILED and work.trouble is not None:
        trouble = work.trouble
        return [
            f"{glyphs.bad} FAILED  {printable(trouble.what, 400)}",
            f"  {printable(trouble.where)}",
            f"  What to do: {printable(trouble.advice, 300)}",
        ]
    lines = [bar_line(work.share, width, glyphs), ""]
    for i, text in enumerate(work.begun):
        done = work.stage is Stage.DONE or i < len(work.begun) - 1
        lines.append(f"  {glyphs.good if done else glyphs.now} {printable(text)}")
    return lines


FORMATS = (
    ("mf4", "MF4      measurement tools: asammdf, CANape"),
    ("mat", "MAT      MATLAB, Octave, SciPy"),
    ("uff", "UFF      modal analysis tools"),
    ("csv", "CSV      tables, one a run and sample clock"),
    ("parquet", "Parquet  data frames"),
    ("blf", "BLF      raw frames: CANalyzer, SavvyCAN"),
    ("asc", "ASC      raw frames as text"),
    ("log", "candump  raw frames as candump -l has them"),
)


async def export_session(app: App[None], path: str) -> None:
    """Ask for the format, export in a worker process and show the files; needs a Textual worker."""
    name = printable(Path(path).name, 40)
    form = await app.push_screen_wait(ChoiceScreen(f"Export {name} as", FORMATS))
    if form is None:
        return
    there = _existing(Path(path), form)
    if there is not None:
        words = f"{printable(there.name, 40)} exists already: replace it?"
        if not await app.push_screen_wait(Confirm(words, "yes, replace", "no, keep it")):
            return
    app.notify(f"exporting {name} as {form}", markup=False)
    async with aclosing(lines_of(ExportTask(path, form, there is not None), name)) as lines:
        async for line in lines:
            if isinstance(line, Trouble):
                app.notify(line.text, severity="error", markup=False)
            elif isinstance(line, Done):
                paths = [printable(str(item)) for item in line.body["paths"]]
                more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
                app.notify(
                    "\n".join([f"written: {paths[0]}{more}", *line.body["notes"]]), markup=False
                )


def _existing(session: Path, form: str) -> Path | None:
    """Return the export of a session that is there already; None if there is none."""
    from daq.formats.export.export import ExportFormat  # with all writers, which few need

    if form == ExportFormat.CSV:  # a file for each run and sample clock
        return next(session.parent.glob(f"{escape(session.stem)}_*.csv"), None)
    place = session.with_suffix(ExportFormat(form).suffix)
    return place if place.exists() else None


OUTDATED = "runs, weights or vehicle have changed since the session file was built"


class WorkScreen(BenchScreen):
    """Shows the progress of a worker, and the action of SPACE before and after."""

    DEFAULT_CSS = """
    WorkScreen #work { height: 1fr; }
    """
    TITLE_OF_BOX: ClassVar[str]

    def __init__(self) -> None:
        super().__init__()
        self.work = LongWork()

    def compose_body(self) -> ComposeResult:
        """Compose the box."""
        box = Static(id="work", classes="box", markup=False)
        box.border_title = self.TITLE_OF_BOX
        yield box

    def on_mount(self) -> None:
        """Show the present state."""
        self.draw()

    def on_resize(self) -> None:
        """Fit the bar."""
        self.draw()

    async def action_cancel(self) -> None:
        """End the worker; without one, go to the home screen."""
        if self.work.stage in (Stage.BUILDING, Stage.WORKING):
            self.workers.cancel_node(self)
            self.work = LongWork()
            self.draw()
        else:
            await self.bench_app.action_home()

    def draw(self) -> None:
        """Draw the box."""
        if self.query("#work"):
            box = self.query_one("#work", Static)
            box.update("\n".join(self.lines(box.size.width)))

    @abstractmethod
    def lines(self, width: int) -> list[str]:
        """Return the lines of the box."""

    def under_way(self, width: int) -> list[str]:
        """Return progress and how to cancel; after a failure its reason and how to try again."""
        glyphs = self.bench_app.glyphs
        failed = self.work.stage is Stage.FAILED
        end = f"{glyphs.now} SPACE = try again" if failed else "Esc cancels; nothing is lost"
        return [*work_text(self.work, glyphs, width), "", end]


_BUILD_ADVICE = "SPACE = try again; the journal is untouched"
_KEPT = 8
"""Number of outcomes kept in memory, for an operator who switches between sessions."""


class IdentifyScreen(WorkScreen):
    """Builds the session file, identifies it in a worker, and shows the results."""

    HELP_PAGE: ClassVar[str] = "identify"
    TITLE_OF_BOX: ClassVar[str] = "Identify"
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "cancel", "Back")]

    def __init__(self) -> None:
        super().__init__()
        self.outcome: Outcome | None = None
        self._kept: dict[tuple[str, int, tuple[str, ...]], Outcome] = {}
        self._asked_ns = 0

    @property
    def step_shown(self) -> BenchStep | None:
        """Step 6; None while an earlier session is identified."""
        path = self.work.session
        return BenchStep.IDENTIFY if not path or self._is_current(path) else None

    @property
    def acts(self) -> bool:
        """True while SPACE does something: not during the work."""
        return self.work.stage in (Stage.IDLE, Stage.FAILED, Stage.DONE)

    @property
    def ready(self) -> bool:
        """True while `--auto` may press SPACE."""
        return self.work.stage in (Stage.IDLE, Stage.DONE)

    async def action_next(self) -> None:
        """Build and identify; show the results once they are there."""
        if self.work.stage in (Stage.IDLE, Stage.FAILED) or self._outdated:
            await self.build()
        elif self.work.stage is Stage.DONE and self.outcome is not None:
            await self.bench_app.open_results(self.outcome)

    @property
    def valid_outcome(self) -> Outcome | None:
        """The result of the recording as it is now; None without one."""
        valid = self.work.stage is Stage.DONE and self._is_current(self.work.session)
        return self.outcome if valid and not self._outdated else None

    async def build(self) -> None:
        """Order the recorder to build the session file; identify it as soon as it is built."""
        reply = await self.bench_app.ask(Build())
        if reply is None or reply.status is None:
            return
        self.workers.cancel_node(self)
        self._asked_ns = reply.status.wall_ns
        self.work = LongWork(Stage.BUILDING, begun=(Stage.BUILDING.value,))
        self.show_status(reply.status)

    def show_status(self, status: Status) -> None:
        """Follow the recorder while it builds."""
        # A status sent before the order shows the older file.
        if self.work.stage is Stage.BUILDING and status.wall_ns >= self._asked_ns:
            session = status.session
            if session.state is SessionState.READY:
                self.begin(session.path)
            elif session.state is SessionState.FAILED:
                where, what = session.path or status.folder, session.text or "no session file"
                trouble = Trouble(where, what, _BUILD_ADVICE)
                self.work = replace(self.work, stage=Stage.FAILED, trouble=trouble)
        self.draw()

    def begin(self, path: str, without: tuple[str, ...] = ()) -> None:
        """Identify a session file in a worker; show a stored result at once."""
        self.workers.cancel_node(self)
        begun = (Stage.BUILDING.value,) if self.work.stage is Stage.BUILDING else ()
        self.work = LongWork(Stage.WORKING, path, 0.0, begun)
        self.draw()
        begin(self, partial(self._identify, path, without), exclusive=True)

    async def _identify(self, path: str, without: tuple[str, ...]) -> None:
        key = (path, _changed_ns(path), without)
        if key not in self._kept:
            async with aclosing(lines_of(IdentifyTask(path, without), Path(path).name)) as lines:
                async for line in lines:
                    self.work = after(self.work, line)
                    if isinstance(line, Done):
                        self._kept[key] = line.body
                    self.draw()
            if key not in self._kept:
                return
            while len(self._kept) > _KEPT:
                self._kept.pop(next(iter(self._kept)))
        self.outcome = self._kept[key]
        self.work = replace(self.work, stage=Stage.DONE, share=1.0)
        self.draw()
        if self.app.screen is self:
            await self.bench_app.open_results(self.outcome)
        else:
            self.bench_app.inform("identified: step 6 shows the results")

    def lines(self, width: int) -> list[str]:
        """Return the lines of the box."""
        glyphs, work = self.bench_app.glyphs, self.work
        lines = [*self._about(), ""]
        match work.stage:
            case Stage.IDLE:
                lines.append(f"{glyphs.now} SPACE = build the session file and identify it")
            case Stage.DONE if self._outdated:
                lines += [f"{glyphs.warn} {OUTDATED}", ""]
                lines.append(f"{glyphs.now} SPACE = build the session file anew and identify it")
            case Stage.DONE:
                lines += [*work_text(work, glyphs, width), "", f"{glyphs.now} SPACE = results"]
            case _:
                lines += self.under_way(width)
        return lines

    def _about(self) -> list[str]:
        if self.work.session and not self._is_current(self.work.session):
            return [f"Session {printable(Path(self.work.session).name)}"]
        status = self.bench_app.status
        if status is None:
            return ["waiting for the recorder"]
        accepted = sum(run.status is LoggedStatus.ACCEPTED for run in status.runs)
        rejected = sum(run.status is LoggedStatus.REJECTED for run in status.runs)
        lines = [
            f"{printable(status.vehicle, 60)}: {counted(accepted, 'run')} accepted, "
            f"{rejected} rejected (kept)"
        ]
        glyphs = self.bench_app.glyphs
        for t in status.tallies:
            mark = glyphs.good if t.accepted >= t.planned else glyphs.warn
            kind = f"{t.mass_state} {t.excitation.words}"
            lines.append(f"  {mark} {kind:<20} {t.accepted} of {t.planned} accepted")
        if status.own_session:
            lines.append(f"  session file: {printable(status.own_session)}")
        return lines

    @property
    def _outdated(self) -> bool:
        """True if this recording was identified and has changed since."""
        status, work = self.bench_app.status, self.work
        is_own = work.stage is Stage.DONE and self._is_current(work.session)
        return is_own and status is not None and status.outdated

    def _is_current(self, path: str) -> bool:
        status = self.bench_app.status
        return status is not None and status.own_session == path


def _changed_ns(path: str) -> int:
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return 0


class ReportScreen(WorkScreen):
    """Writes the report of a session in a worker."""

    HELP_PAGE: ClassVar[str] = "report"
    TITLE_OF_BOX: ClassVar[str] = "Report"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("r", "again", "Write again", tooltip="Write the report again"),
        Binding(
            "w", "new_vehicle", "Next vehicle", tooltip="Begin the recording of the next vehicle"
        ),
        Binding("escape", "cancel", "Back"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._session = ""

    @property
    def step_shown(self) -> BenchStep | None:
        """Step 7; None for an earlier session."""
        status = self.bench_app.status
        own = not self._session or (status is not None and status.own_session == self._session)
        return BenchStep.REPORT if own else None

    @property
    def _outdated(self) -> bool:
        """True if the recording has changed since its session file was built."""
        status = self.bench_app.status
        return status is not None and status.own_session == self._session and status.outdated

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show R only after a report was written or failed."""
        if action == "again":
            return bool(self._session) and self.work.stage in (Stage.DONE, Stage.FAILED)
        return super().check_action(action, parameters)

    @property
    def acts(self) -> bool:
        """True while SPACE does something: neither during the writing nor after it."""
        idle = self.work.stage in (Stage.IDLE, Stage.FAILED)
        return not self._session or idle or (self._outdated and self.work.stage is Stage.DONE)

    @property
    def ready(self) -> bool:
        """True while `--auto` may press SPACE."""
        return self.work.stage is Stage.IDLE

    def show_session(self, path: str) -> None:
        """Choose the session of the report."""
        if path != self._session:
            self.workers.cancel_node(self)
            self._session, self.work = path, LongWork()
        self.draw()

    def show_status(self, status: Status) -> None:
        """Take the session of this recording if none was chosen."""
        ready = status.session.state is SessionState.READY
        if not self._session and ready:
            self._session = status.own_session
        self.draw()
        self.refresh_bindings()

    async def action_next(self) -> None:
        """Write the report; identify first where there is no session file."""
        if not self.acts:
            return
        if not self._session or self._outdated:
            await self.bench_app.go_to(BenchStep.IDENTIFY)
        else:
            self.begin()

    def action_again(self) -> None:
        """Write the report once more."""
        if self.work.stage in (Stage.DONE, Stage.FAILED):
            self.begin()

    async def action_new_vehicle(self) -> None:
        """End the recording and begin the next vehicle's."""
        if await self.bench_app.ask(Start()) is not None:
            self._session, self.work = "", LongWork()
            await self.bench_app.go_to(BenchStep.VEHICLE)

    def begin(self) -> None:
        """Write the report in a worker."""
        self.work = LongWork(Stage.WORKING, self._session)
        self.draw()
        begin(self, partial(self._write, self._session), exclusive=True)

    async def _write(self, path: str) -> None:
        html = report_of(Path(path))
        task = ReportTask(path, str(html), str(html.with_suffix(".pdf")))
        async with aclosing(lines_of(task, Path(path).name)) as lines:
            async for line in lines:
                self.work = after(self.work, line)
                self.draw()
        status, step = self.bench_app.status, BenchStep.REPORT
        if self.work.stage is Stage.DONE and status is not None and status.own_session == path:
            if not is_marked(status, step) and not status.outdated:
                await self.bench_app.ask(Mark(step.mark))
            self.draw()

    def lines(self, width: int) -> list[str]:
        """Return the lines of the box."""
        glyphs = self.bench_app.glyphs
        if not self._session:
            return [f"{glyphs.now} no session file yet: SPACE = step 6 Identify"]
        lines = [f"Session {printable(Path(self._session).name)}", ""]
        if self._outdated and self.work.stage is not Stage.WORKING:
            lines += [f"{glyphs.warn} {OUTDATED}", "", f"{glyphs.now} SPACE = step 6 Identify", ""]
            return lines + (self._done() if self.work.stage is Stage.DONE else [])
        match self.work.stage:
            case Stage.IDLE:
                page = printable(str(report_of(Path(self._session))))
                return [*lines, f"{glyphs.now} SPACE = write the report", f"  {page}"]
            case Stage.DONE:
                return [*lines, *self._done()]
            case _:
                return [*lines, *self.under_way(width)]

    def _done(self) -> list[str]:
        """Return the files, the runs and the next keys."""
        glyphs, status = self.bench_app.glyphs, self.bench_app.status
        lines = [f"{glyphs.good} WRITTEN   verdict {printable(str(self.work.answer['verdict']))}"]
        files: dict[str, int] = self.work.answer["files"]
        for path, size in files.items():
            lines.append(f"  {printable(path)}   {size_text(size)}")
        lines += [
            "  The page is one file: open it in any browser, print it, send it.",
            f"  The session itself is {printable(self._session)}",
        ]
        if status is not None and status.own_session == self._session:
            lines += ["", f"Recorded   {printable(status.vehicle, 60)}"]
            lines += [
                f"  {t.mass_state} {t.excitation.words}: {t.accepted} accepted, "
                f"{t.rejected} rejected"
                for t in status.tallies
            ]
            frames, journal = status.disk.recorded_frames, printable(status.folder)
            lines.append(f"  {frames:,} raw {plural(frames, 'frame')} in the journal in {journal}")
        return [*lines, "", f"{glyphs.now} W = next vehicle   S = sessions   R = write again"]
