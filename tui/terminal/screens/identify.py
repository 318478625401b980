"""Step 6: from the recording to parameters, with progress; then on to the results."""

from __future__ import annotations

from contextlib import aclosing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding, BindingType

from daq import Status
from daq.control import Build, SessionState
from daq.errors import printable
from daq.runlog import LoggedStatus
from dbc import counted

from ...jobs.lines import Done, IdentifyTask, Trouble
from ...jobs.outcome import Outcome, parse_outcome
from ...jobs.worker import lines_of
from ..background import begin
from ..state.long_work import LongWork, Stage, after, work_text
from ..state.steps import BenchStep
from .work import OUTDATED, WorkScreen

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
                        self._kept[key] = parse_outcome(line.body)
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
