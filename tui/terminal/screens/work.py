"""Steps 6 and 7: identify and report, in a worker with progress."""

from __future__ import annotations

import asyncio
from abc import abstractmethod
from enum import StrEnum
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, ClassVar

from textual import work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.widgets import ProgressBar

from daq.control.messages import Build, Mark, SessionState, Start, Status
from daq.runs import RunStatus
from dbc import BumpbenchError, InputError, counted
from dbc.words import printable

from ...jobs.worker import Outcome, Task, answer_of, identify_session, report_session
from ..campaign import BenchStep, is_marked
from ..widgets import SPACE_INK, Words
from .base import SessionScreen

OUTDATED = "runs, weights or vehicle have changed since the session file was built"


class Stage(StrEnum):
    """Stages of the work."""

    IDLE = "idle"
    BUILDING = "building the session file"
    WORKING = "working"
    DONE = "done"
    FAILED = "failed"


_UNDER_WAY = (Stage.BUILDING, Stage.WORKING)
_MOST_PARTS = 6
"""Largest number of parts of the work that are shown: the newest."""
_LEAST_SHARE = 0.1
"""Share of the work that must be done before its remaining time is shown."""


class WorkScreen(SessionScreen):
    """Shows the progress of a worker, and the action of SPACE before and after."""

    def __init__(self) -> None:
        super().__init__()
        self.stage = Stage.IDLE
        self._begun_parts: dict[str, None] = {}
        """The parts of the work that were begun, in order, each once."""
        self.trouble: BumpbenchError | None = None
        """Why the work failed."""
        self.take = asyncio.Event()
        """Set to end the work with the answer so far."""
        self._begun_s = 0.0
        """Monotonic time at which the work began, s."""
        self._share = 0.0
        """Share of the work that is done."""

    @property
    def ready(self) -> bool:
        """True while `--auto` may press SPACE: it does not repeat what has failed."""
        return self.acts and self.stage is not Stage.FAILED

    def compose_body(self) -> ComposeResult:
        """Compose the box."""
        with Vertical(id="work", classes="box") as box:
            box.border_title = type(self).__name__.removesuffix("Screen")
            yield Words("due")
            yield ProgressBar(total=1.0, show_eta=False)
            yield Words("state")

    def show_status(self, status: Status) -> None:
        """Show the present state."""
        self.draw()

    async def action_cancel(self) -> None:
        """End the worker; without one, go to the home screen."""
        if self.stage in _UNDER_WAY:
            self.workers.cancel_node(self)
            self.begin(Stage.IDLE, self.session)
        else:
            await self.bench_app.open("home")

    def begin(self, stage: Stage, session: str) -> None:
        """Begin a stage on a session file; what earlier work has shown is forgotten."""
        self.stage, self.session, self.trouble = stage, session, None
        self._begun_s, self._share = monotonic(), 0.0
        self._begun_parts = {stage.value: None} if stage is Stage.BUILDING else {}
        self.draw()

    async def answer_to(self, task: Task) -> Any:
        """Do a task in a worker and show its progress; return the answer, None after a failure."""

        def show_progress(share: float, part: str) -> None:
            self._begun_parts[part] = None
            self._share = max(self._share, share)  # two processes report in any order
            self.draw()

        self.take = asyncio.Event()
        try:
            answer = await answer_of(task, Path(self.session).name, show_progress, self.take)
        except BumpbenchError as error:
            self.stage, self.trouble = Stage.FAILED, error
            self.draw()
            return None
        self.stage = Stage.DONE
        return answer

    def draw(self) -> None:
        """Draw the box: what SPACE or another key does, and the state of the work."""
        if not self.is_mounted:
            return
        bar = self.query_one(ProgressBar)
        bar.display = self.stage in _UNDER_WAY
        bar.update(progress=self._share)
        glyphs = self.bench_app.glyphs
        lines, next_words = self.lines_and_keys()
        if self.trouble is not None and self.stage is Stage.FAILED:
            where = printable(self.trouble.where)
            lines = [f"{glyphs.bad} FAILED  {printable(self.trouble.what, 400)}", f"  {where}"]
            lines += [f"  What to do: {printable(self.trouble.advice, 300)}"]
            next_words = "SPACE = try again"
        elif self.stage in _UNDER_WAY:
            *done_parts, present_part = [*self._begun_parts][-_MOST_PARTS:] or [""]
            lines = [f"  {glyphs.good} {printable(part)}" for part in done_parts]
            lines += [f"  {glyphs.now} {printable(present_part)}"]
            elapsed_s = monotonic() - self._begun_s
            keys = "T takes the answer so far, Esc stops" if self.may_take else "Esc stops it"
            next_words = f"{keys}; nothing is lost   {elapsed_s:.0f} s so far"
            if self._share >= _LEAST_SHARE:
                remaining_s = elapsed_s * (1.0 / self._share - 1.0)
                next_words += f", about {remaining_s:.0f} s left"
        self.query_one("#due", Words).say(Content.styled(f"{glyphs.now} {next_words}", SPACE_INK))
        texts = [*lines, "", *self.subject_lines()] if lines else self.subject_lines()
        self.query_one("#state", Words).say(Content("\n".join(["", *texts])))

    @property
    def may_take(self) -> bool:
        """True while the worker looks for more than the answer that it has."""
        # The identification names a part so while it tries further elements.
        has_answer = any(part.startswith("so far") for part in self._begun_parts)
        return self.stage is Stage.WORKING and has_answer and not self.take.is_set()

    @abstractmethod
    def subject_lines(self) -> list[str]:
        """Return the lines on what the work is done with."""

    @abstractmethod
    def lines_and_keys(self) -> tuple[list[str], str]:
        """Return what the box shows before the work and after it: lines, and the next keys."""


class IdentifyScreen(WorkScreen):
    """Builds the session file, identifies it in a worker, and shows the results."""

    HELP_PAGE: ClassVar[str] = "identify"
    STEP: ClassVar[BenchStep] = BenchStep.IDENTIFY
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("t", "take", "Take so far", tooltip="Take the answer so far, without elements"),
        Binding("escape", "cancel", "Back"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self.outcome: Outcome | None = None
        self._ordered_ns = 0  # wall clock of the recorder when it took the order to build

    @property
    def acts(self) -> bool:
        """True while SPACE does something: not during the work."""
        return self.stage not in _UNDER_WAY

    @property
    def valid_outcome(self) -> Outcome | None:
        """The result of the recording as it is now; None without one."""
        return self.outcome if self.stage is Stage.DONE and not self.outdated else None

    async def action_next(self) -> None:
        """Build and identify; show the results once they are there."""
        if self.valid_outcome is None:
            await self.build()
        else:
            await self.show_results()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show T only while there is an answer to take."""
        return self.may_take if action == "take" else super().check_action(action, parameters)

    def action_take(self) -> None:
        """End the work with the answer so far."""
        self.take.set()
        self.draw()

    async def show_results(self) -> None:
        """Show the results of the identification."""
        if self.outcome is not None:
            results: Any = self.bench_app.get_screen("results")
            results.show_outcome(self.outcome)
            await self.bench_app.open("results")

    async def build(self) -> None:
        """Order the recorder to build the session file; identify it as soon as it is built."""
        reply = await self.bench_app.ask(Build())
        if reply is None or reply.status is None:
            return
        self.workers.cancel_node(self)
        self._ordered_ns = reply.status.wall_ns
        self.begin(Stage.BUILDING, self.session)
        self.show_status(reply.status)

    def show_status(self, status: Status) -> None:
        """Follow the recorder while it builds; identify the file once it is built."""
        # A status sent before the order shows the older file.
        if self.stage is Stage.BUILDING and status.wall_ns >= self._ordered_ns:
            session = status.session
            if session.state is SessionState.READY:
                self.begin(Stage.WORKING, session.path)
                self._begun_parts = {Stage.BUILDING.value: None}
                self._identify(session.path)
            elif session.state is SessionState.FAILED:
                where, what = session.path or status.folder, session.text or "no session file"
                advice = "SPACE = try again; the journal is untouched"
                self.stage, self.trouble = Stage.FAILED, InputError(where, what, advice)
        self.draw()

    @work(exclusive=True)
    async def _identify(self, path: str) -> None:
        """Identify a session file, and show the results if this screen is still in front."""
        self.outcome = await self.answer_to(partial(identify_session, path))
        if self.outcome is None:
            return
        self.draw()
        if self.app.screen is self:
            await self.show_results()
        else:
            self.bench_app.inform("identified: step 6 shows the results")

    def subject_lines(self) -> list[str]:
        """Return the runs of the recording, and its session file."""
        status, glyphs = self.bench_app.status, self.bench_app.glyphs
        if status is None:
            return ["waiting for the recorder"]
        accepted = sum(run.status is RunStatus.ACCEPTED for run in status.runs)
        rejected = sum(run.status is RunStatus.REJECTED for run in status.runs)
        count = f"{counted(accepted, 'run')} accepted, {rejected} rejected (kept)"
        lines = [f"{printable(status.vehicle, 60)}: {count}"]
        for tally in status.tallies:
            mark = glyphs.good if tally.accepted >= tally.planned else glyphs.warn
            kind = f"{tally.mass_state} {tally.excitation.words}"
            lines.append(f"  {mark} {kind:<20} {tally.accepted} of {tally.planned} accepted")
        if status.own_session:
            lines.append(f"  session file: {printable(status.own_session)}")
        return lines

    def lines_and_keys(self) -> tuple[list[str], str]:
        """Return a warning if the recording has changed, and what SPACE does."""
        if self.stage is Stage.DONE and self.outdated:
            warning = f"{self.bench_app.glyphs.warn} {OUTDATED}"
            return [warning], "SPACE = build the session file anew and identify it"
        if self.stage is Stage.DONE:
            return [], "SPACE = results"
        return [], "SPACE = build the session file and identify it"


class ReportScreen(WorkScreen):
    """Writes the report of the recording's session in a worker."""

    HELP_PAGE: ClassVar[str] = "report"
    STEP: ClassVar[BenchStep] = BenchStep.REPORT
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("w", "new_vehicle", "Next vehicle", tooltip="Begin the next vehicle's recording"),
        Binding("escape", "cancel", "Back"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._written: dict[str, Any] = {}  # files and verdict of the report

    @property
    def acts(self) -> bool:
        """True while SPACE does something: neither during the writing nor after it."""
        idle = self.stage in (Stage.IDLE, Stage.FAILED)
        return not self.session or idle or (self.outdated and self.stage is Stage.DONE)

    def show_status(self, status: Status) -> None:
        """Take the session of this recording, and leave that of the one before."""
        built = status.session.state is SessionState.READY and self.stage not in _UNDER_WAY
        if built and status.own_session != self.session:
            self.begin(Stage.IDLE, status.own_session)
        super().show_status(status)

    async def action_next(self) -> None:
        """Write the report; identify first where there is no session file."""
        if not self.session or self.outdated:
            await self.bench_app.go_to(BenchStep.IDENTIFY)
        elif self.acts:
            self.begin(Stage.WORKING, self.session)
            self._write()

    async def action_new_vehicle(self) -> None:
        """End the recording and begin the next vehicle's."""
        if await self.bench_app.ask(Start()) is not None:
            self.begin(Stage.IDLE, "")
            await self.bench_app.go_to(BenchStep.VEHICLE)

    @work(exclusive=True)
    async def _write(self) -> None:
        """Write page and PDF of the report; mark the step as done if they are of this recording."""
        page = self._page
        pdf = str(page.with_suffix(".pdf"))
        written = await self.answer_to(partial(report_session, self.session, str(page), pdf))
        if written is None:
            return
        self._written = written
        status, step = self.bench_app.status, BenchStep.REPORT
        if not self.outdated and status and not is_marked(status, step):
            await self.bench_app.ask(Mark(step.mark))
        self.draw()

    @property
    def _page(self) -> Path:
        return Path(self.session).with_suffix(".html")

    def subject_lines(self) -> list[str]:
        """Return the session file."""
        if not self.session:
            return ["no session file yet"]
        return [f"Session {printable(Path(self.session).name)}"]

    def lines_and_keys(self) -> tuple[list[str], str]:
        """Return the files that were written, and the next keys."""
        glyphs = self.bench_app.glyphs
        if not self.session:
            return [], "SPACE = step 6 Identify"
        lines, keys = [], "W = next vehicle"
        if self.outdated:
            lines, keys = [f"{glyphs.warn} {OUTDATED}", ""], "SPACE = step 6 Identify"
        elif self.stage is Stage.IDLE:
            return [f"  {printable(str(self._page))}"], "SPACE = write the report"
        if self.stage is not Stage.DONE:
            return lines, keys
        lines.append(f"{glyphs.good} WRITTEN   verdict {printable(str(self._written['verdict']))}")
        for path, size in self._written["files"].items():
            lines.append(f"  {printable(path)}   {size / 1e6:.1f} MB")
        lines.append("  The page is one file: open it in any browser, print it, send it.")
        lines.append(f"  The session itself is {printable(self.session)}")
        return lines, keys
