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

from daq.control.messages import Build, SessionState, Start, Status
from daq.runs import RunStatus
from dbc import BumpbenchError, InputError, counted
from dbc.words import printable

from ...jobs.worker import Outcome, Task, answer_of, identify_session, report_session
from ..campaign import BenchStep
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


class WorkScreen(SessionScreen):
    """Shows the progress of a worker, and the action of SPACE before and after."""

    def __init__(self) -> None:
        super().__init__()
        self.stage = Stage.IDLE
        self._begun_parts: dict[str, None] = {}  # the parts that were begun, each once, in order
        self._failure: BumpbenchError | None = None  # why the work failed; else None
        self.answer_request = asyncio.Event()
        """Set to end the present work with the answer so far."""
        self._begun_s = 0.0  # monotonic time at which the work began, s
        self._progress = 0.0  # fraction of the work that is done

    @property
    def ready(self) -> bool:
        """True while `--auto` may press SPACE: it does not repeat what has failed."""
        return self.next_enabled and self.stage is not Stage.FAILED

    def compose_body(self) -> ComposeResult:
        """Compose the box."""
        with Vertical(id="work", classes="box") as box:
            box.border_title = self.help_page.capitalize()
            yield Words("due")
            yield ProgressBar(total=1.0, show_eta=False)
            yield Words("state")

    async def action_cancel(self) -> None:
        """Stop the work; where none is under way, go to the screen of the bumps."""
        if self.stage in _UNDER_WAY:
            self.workers.cancel_node(self)
            self.begin(Stage.IDLE, self.session)
        else:
            await self.bench_app.open("home")

    def begin(self, stage: Stage, session: str, *begun_parts: str) -> None:
        """Begin a stage on a session file; these parts replace what earlier work has shown."""
        self.stage, self.session, self._failure = stage, session, None
        self._begun_s, self._progress = monotonic(), 0.0
        self._begun_parts = dict.fromkeys(begun_parts)
        self._show()

    def fail(self, error: BumpbenchError) -> None:
        """End the work, and show why it failed."""
        self.stage, self._failure = Stage.FAILED, error
        self._show()

    async def answer_to(self, task: Task) -> Any:
        """Do a task in a worker and show its progress; return the answer, None after a failure."""

        def show_progress(progress: float, part: str) -> None:
            self._begun_parts[part] = None
            self._progress = max(self._progress, progress)  # two processes report in any order
            self._show()

        self.answer_request = asyncio.Event()
        try:
            name = Path(self.session).name
            answer = await answer_of(task, name, show_progress, self.answer_request)
        except BumpbenchError as error:
            self.fail(error)
            return None
        self.stage = Stage.DONE
        return answer

    def show_status(self, status: Status) -> None:
        """Show what SPACE or another key does, the state of the work, and what it is done with."""
        bar = self.query_one(ProgressBar)
        bar.display = self.stage in _UNDER_WAY
        bar.update(progress=self._progress)
        lines, next_words = self._lines_and_keys()
        text = "\n".join(["", *lines, *([""] if lines else []), *self.subject_lines(status)])
        next_line = f"{self.bench_app.glyphs.now} {next_words}"
        self.query_one("#due", Words).say(Content.styled(next_line, SPACE_INK))
        self.query_one("#state", Words).say(Content(text))

    def _lines_and_keys(self) -> tuple[list[str], str]:
        """Return what the box shows on the work, and the next keys."""
        glyphs = self.bench_app.glyphs
        if self._failure is not None:
            lines = [
                f"{glyphs.bad} FAILED  {printable(self._failure.what, 400)}",
                f"  {printable(self._failure.where)}",
                f"  What to do: {printable(self._failure.advice, 300)}",
            ]
            return lines, "SPACE = try again"
        if self.stage not in _UNDER_WAY:
            return self.idle_lines_and_keys()
        # Of the parts the newest six, as many as 24 rows have room for.
        *done_parts, present_part = [*self._begun_parts][-6:] or [""]
        lines = [f"  {glyphs.good} {printable(part)}" for part in done_parts]
        lines += [f"  {glyphs.now} {printable(present_part)}"]
        elapsed_s = monotonic() - self._begun_s
        keys = "T takes the answer so far, Esc stops" if self.has_answer else "Esc stops it"
        keys += f"; nothing is lost   {elapsed_s:.0f} s so far"
        if self._progress >= 0.1:  # before, the remaining time would jump
            keys += f", about {elapsed_s * (1.0 / self._progress - 1.0):.0f} s left"
        return lines, keys

    @property
    def has_answer(self) -> bool:
        """True while the worker has an answer, looks for more, and was not asked to stop."""
        # While the identification tries further elements, its part begins with these words.
        is_found = any(part.startswith("so far") for part in self._begun_parts)
        return self.stage is Stage.WORKING and is_found and not self.answer_request.is_set()

    @abstractmethod
    def subject_lines(self, status: Status) -> list[str]:
        """Return the lines on what the work is done with."""

    @abstractmethod
    def idle_lines_and_keys(self) -> tuple[list[str], str]:
        """Return what the box shows before the work and after it: lines, and the next keys."""


class IdentifyScreen(WorkScreen):
    """Builds the session file, identifies it in a worker, and shows the results."""

    STEP: ClassVar[BenchStep] = BenchStep.IDENTIFY
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("t", "take", "Take so far", tooltip="Take the answer so far, without elements"),
        Binding("escape", "cancel", "Back"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._outcome: Outcome | None = None
        self._ordered_ns = 0  # wall clock of the recorder when it took the order to build

    @property
    def next_enabled(self) -> bool:
        """True while SPACE does something: not during the work."""
        return self.stage not in _UNDER_WAY

    @property
    def valid_outcome(self) -> Outcome | None:
        """The result of the recording as it is now; None without one."""
        return self._outcome if self.stage is Stage.DONE and not self.outdated else None

    async def action_next(self) -> None:
        """Build and identify; show the results once they are there."""
        if self.valid_outcome is None:
            await self.build()
        else:
            await self.show_results()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show T only while there is an answer to take."""
        return self.has_answer if action == "take" else super().check_action(action, parameters)

    def action_take(self) -> None:
        """End the work with the answer so far."""
        self.answer_request.set()
        self._show()

    async def show_results(self) -> None:
        """Show the results of the identification."""
        results: Any = await self.bench_app.open("results")
        results.show_outcome(self._outcome)

    async def build(self) -> None:
        """Order the recorder to build the session file; `show_status` waits for the file."""
        reply = await self.bench_app.ask(Build())
        if reply is not None and reply.status is not None:
            self.workers.cancel_node(self)
            self._ordered_ns = reply.status.wall_ns
            self.begin(Stage.BUILDING, self.session, Stage.BUILDING)

    def show_status(self, status: Status) -> None:
        """Follow the recorder while it builds; identify the file once it is built."""
        # A status sent before the order shows the older file.
        if self.stage is Stage.BUILDING and status.wall_ns >= self._ordered_ns:
            session = status.session
            if session.state is SessionState.READY:
                self.begin(Stage.WORKING, session.path, Stage.BUILDING)
                self._identify(session.path)
            elif session.state is SessionState.FAILED:
                where, what = session.path or status.folder, session.text or "no session file"
                advice = "SPACE = try again; the journal is untouched"
                self.fail(InputError(where, what, advice))
        super().show_status(status)

    @work(exclusive=True)
    async def _identify(self, path: str) -> None:
        """Identify a session file, and show the results if this screen is still in front."""
        outcome = await self.answer_to(partial(identify_session, path))
        if outcome is None:
            return
        self._outcome = outcome
        self._show()
        if self.is_current:
            await self.show_results()
        else:
            self.bench_app.inform("identified: step 6 shows the results")

    def subject_lines(self, status: Status) -> list[str]:
        """Return the runs of the recording, and its session file."""
        glyphs = self.bench_app.glyphs
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

    def idle_lines_and_keys(self) -> tuple[list[str], str]:
        """Return a warning if the recording has changed, and what SPACE does."""
        if self.stage is Stage.DONE and self.outdated:
            warning = f"{self.bench_app.glyphs.warn} {OUTDATED}"
            return [warning], "SPACE = build the session file anew and identify it"
        if self.stage is Stage.DONE:
            return [], "SPACE = results"
        return [], "SPACE = build the session file and identify it"


class ReportScreen(WorkScreen):
    """Writes the report of the recording's session in a worker."""

    STEP: ClassVar[BenchStep] = BenchStep.REPORT
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("w", "new_vehicle", "Next vehicle", tooltip="Begin the next vehicle's recording"),
        Binding("escape", "cancel", "Back"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._written: dict[str, Any] = {}  # files and verdict of the report

    @property
    def next_enabled(self) -> bool:
        """True while SPACE does something: neither during the writing nor after it."""
        is_open = self.stage in (Stage.IDLE, Stage.FAILED)
        return is_open or (self.stage is Stage.DONE and self.outdated)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show W only while no report is written: it would count as the next vehicle's."""
        is_writing = action == "new_vehicle" and self.stage in _UNDER_WAY
        return False if is_writing else super().check_action(action, parameters)

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
        else:
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
        page, pdf = str(self._page), str(self._page.with_suffix(".pdf"))
        written = await self.answer_to(partial(report_session, self.session, page, pdf))
        if written is None:
            return
        self._written = written
        if not self.outdated:
            await self.bench_app.finish(self.STEP)
        self._show()

    @property
    def _page(self) -> Path:
        return Path(self.session).with_suffix(".html")

    def subject_lines(self, status: Status) -> list[str]:
        """Return the session file."""
        name = printable(Path(self.session).name)
        return [f"Session {name}" if self.session else "no session file yet"]

    def idle_lines_and_keys(self) -> tuple[list[str], str]:
        """Return the files that were written, and the next keys."""
        glyphs = self.bench_app.glyphs
        lines, keys = [], "W = next vehicle"
        if not self.session or self.outdated:
            keys = "SPACE = step 6 Identify"
            lines = [f"{glyphs.warn} {OUTDATED}", ""] if self.outdated else []
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
