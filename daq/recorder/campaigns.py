"""Resumes the recording that a killed recorder left open, and builds session files."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from dbc.words import BumpbenchError, printable

from ..bench.config import Bench, parse_bench
from ..bus.source import Now
from ..control.messages import SessionState, SessionStatus
from ..journal.format import JournalHead
from ..journal.reader import RecordingInfo, last_campaign, last_recording
from ..journal.segment import Segment
from ..runlog import fold
from ..session.build import DONE, DONE_WITH_LOSS
from .recording import Recording

OWN_BENCH = (
    "the resumed recording continues with its own bench.toml, not with the one in the file: reload "
    "to use that, or start a new recording"
)
NOT_RESUMED = "the last recording was not ended and cannot be resumed ({}): a new one is begun"

_log = logging.getLogger("recorder")


@dataclass(frozen=True, slots=True)
class OpenRecording:
    """A recording in the journal: a campaign, or the traffic between two campaigns."""

    recording: Recording
    head: JournalHead
    written: list[Segment]
    """Its segments that were written by this recorder."""
    session: Path
    """Path of its session file, if it is a campaign."""
    before: tuple[Path, ...] = ()
    """Segments written by earlier recorders."""

    @property
    def campaign(self) -> str:
        """Identity of the campaign; empty between two campaigns."""
        return self.head.recording if self.head.campaign else ""

    @property
    def segments(self) -> tuple[Path, ...]:
        """All existing segments, in order; the oldest may have been deleted."""
        return (
            *(path for path in self.before if path.exists()),
            *(segment.path for segment in self.written),
        )


def new_head(bench: Bench, software: str, now: Now, *, campaign: bool) -> JournalHead:
    """Return the head of a new recording."""
    return JournalHead(
        bench.text,
        bench.dbc_text,
        software,
        now.wall_ns,
        round(now.monotonic_s * 1e9),
        uuid.uuid4().hex,
        campaign=campaign,
        origin=bench.origin,
    )


def resumable(journal: Path, bench: Bench) -> tuple[RecordingInfo, Bench] | str:
    """Return the campaign in a folder that can be resumed, and its bench.

    It continues with its own bench.toml, which has the changes made during the recording, but with
    the buses and limits given now.  With another DBC it cannot be resumed.  If a campaign cannot be
    resumed, the reason is logged and returned; it is empty if there is none.
    """
    why: object = ""
    try:
        tail = last_recording(journal)
        if tail is None or tail.ended or not tail.head.campaign:
            return ""
        text = fold(tail.events).bench_text or tail.head.bench_text
        if tail.head.origin != bench.origin:
            why = f"its frames are {tail.head.origin}, not {bench.origin}"
        elif tail.head.dbc_text != bench.dbc_text:
            why = "it has another DBC"
        elif text == bench.text:
            return tail, bench
        else:
            recorded = parse_bench(text, "bench.toml in the journal", Path(), bench.dbc_text)
            _log.warning(OWN_BENCH)
            return tail, replace(
                recorded,
                buses=bench.buses,
                dbc_name=bench.dbc_name,
                recorder=bench.recorder,
                origin=bench.origin,
            )
    except (BumpbenchError, OSError) as error:  # the old recording is not changed
        why = error
    _log.warning("%s", NOT_RESUMED.format(why))
    return NOT_RESUMED.format(why)


def unfinished(journal: Path) -> tuple[Path, RecordingInfo] | None:
    """Return the last campaign in a folder and its session file, if that must still be built."""
    try:
        tail = last_campaign(journal)
        if tail is None:
            return None
        session = journal.parent / tail.session_name
        newest_s = max(path.stat().st_mtime for path in tail.segments)
        done = session.exists() and session.stat().st_mtime >= newest_s
    except OSError:
        return None
    return None if done else (session, tail)


# Builds session files, each in a process that is started and polled -------------------------------


@dataclass(frozen=True, slots=True)
class _Job:
    target: Path
    segments: tuple[Path, ...]
    building: SessionStatus


class Derivation:
    """Builds session files, one after another; HDF5 never runs within the recorder."""

    def __init__(self) -> None:
        self._jobs: list[_Job] = []  # the first one has the process
        self._process: subprocess.Popen[bytes] | None = None
        self._deadline_s: float  # of the process, since it was started
        self.status = SessionStatus()

    def begin(self, target: Path, segments: Sequence[Path], recording: str, revision: int) -> None:
        """Start building the session file of a recording; never raises.

        `recording`: its identity.  `revision`: present revision of its run log.
        """
        self.status = SessionStatus(SessionState.BUILDING, str(target), "", recording, revision)
        running = self._jobs[:1] if self._process is not None else []
        # A waiting job for the same file is superseded: the new one has all runs.
        waiting = [job for job in self._jobs[len(running) :] if job.target != target]
        self._jobs = [*running, *waiting, _Job(target, tuple(segments), self.status)]
        self.poll()

    def poll(self) -> None:
        """Handle processes that have ended or hang; to be called with every block."""
        if self._process is not None:
            if self._process.poll() is not None:
                self._finish(self._process)
            elif time.monotonic() > self._deadline_s:
                self._process.kill()  # if it waits for a hung disk it may end later
                self._report(SessionState.FAILED, "it took too long and was ended: check the disk")
        while self._process is None and self._jobs:
            self._start(self._jobs[0])

    def close(self) -> None:
        """End the process; a session file is complete or absent, and can be built again later."""
        del self._jobs[1:]
        if self._process is not None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)  # then it is killed
            if self._process.poll() is None:
                self._process.kill()
                self._process.wait()
            self._finish(self._process)

    def _start(self, job: _Job) -> None:
        # Building a session file takes seconds; after an hour it counts as hung.
        self._deadline_s = time.monotonic() + 3600.0
        builder = [sys.executable, "-m", "daq.session.build"]
        try:
            self._process = subprocess.Popen(
                [*builder, str(job.target), *map(str, job.segments)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,  # its output fits a pipe: read at the end
                stderr=subprocess.STDOUT,
                process_group=0,  # not affected by Ctrl-C at the terminal
            )
        except OSError as error:
            self._report(SessionState.FAILED, error.strerror or str(error))
            del self._jobs[0]

    def _finish(self, process: subprocess.Popen[bytes]) -> None:
        lines = process.communicate()[0].decode("utf-8", "replace").splitlines()
        last, text = lines[-1] if lines else "", ""
        with suppress(ValueError, AttributeError):  # its JSON line has an error, or losses
            result = json.loads(last)
            text = printable(str(result.get("error") or result.get("loss") or ""), 400)
        if process.returncode in (DONE, DONE_WITH_LOSS):
            self._report(SessionState.READY, text)
        elif time.monotonic() <= self._deadline_s:  # else it is reported already
            failure = printable(f"ended with code {process.returncode}: {last}")
            self._report(SessionState.FAILED, text or failure)
        self._process = None
        del self._jobs[0]

    def _report(self, state: SessionState, text: str) -> None:
        if len(self._jobs) == 1:  # else the next one is being built
            self.status = replace(self._jobs[0].building, state=state, text=text)
