"""Step 7: writes the report as HTML and PDF, then lists the files and the runs."""

from __future__ import annotations

from contextlib import aclosing
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding, BindingType

from daq import Status
from daq.control import Mark, SessionState, Start
from daq.errors import printable
from dbc import plural

from ...jobs.lines import ReportTask
from ...jobs.session_list import report_of, size_text
from ...jobs.worker import lines_of
from ..background import begin
from ..state.long_work import LongWork, Stage, after
from ..state.steps import BenchStep, is_marked
from .work import OUTDATED, WorkScreen


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
