"""Resumes the recording that a killed recorder left open, and builds session files."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import uuid
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from dbc.words import BumpbenchError, printable

from ..bench.config import Bench, parse_bench
from ..bus.source import Now
from ..control.messages import SessionState, SessionStatus
from ..journal.reader import RecordingInfo, last_campaign, last_recording
from ..journal.segment import JournalHead, Segment
from ..runlog import fold
from ..session.build import DONE, DONE_WITH_LOSS
from .recording import Recording

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
            _log.warning(
                "the resumed recording continues with its own bench.toml, not with the one in the "
                "file: start a new campaign to use that"
            )
            return tail, replace(
                recorded,
                buses=bench.buses,
                dbc_name=bench.dbc_name,
                recorder=bench.recorder,
                origin=bench.origin,
            )
    except (BumpbenchError, OSError) as error:  # the old recording is not changed
        why = error
    text = f"the last recording was not ended and cannot be resumed ({why}): a new one is begun"
    _log.warning("%s", text)
    return text


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


# Builds session files, each in a process ----------------------------------------------------------


class Derivation:
    """Builds session files, one after another; HDF5 never runs within the recorder."""

    def __init__(self) -> None:
        self.status = SessionStatus()
        """State of the session file that was ordered last."""
        self._builder = ThreadPoolExecutor(1, "derivation")
        self._jobs: dict[Path, Future[None]] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._is_closed = False

    def begin(self, target: Path, segments: Sequence[Path], recording: str, revision: int) -> None:
        """Start building the session file of a recording; never raises.

        `recording`: its identity.  `revision`: present revision of its run log.
        """
        building = SessionStatus(SessionState.BUILDING, str(target), "", recording, revision)
        if target in self._jobs:
            self._jobs[target].cancel()  # if it waits: the new one has all runs
        self.status = building
        job = self._builder.submit(self._build, building, tuple(segments))
        unfinished = {path: one for path, one in self._jobs.items() if not one.done()}
        self._jobs = {**unfinished, target: job}

    def close(self) -> None:
        """End the process; a session file is complete or absent, and can be built again later."""
        self._is_closed = True
        self._builder.shutdown(wait=False, cancel_futures=True)
        process = self._process
        if process is not None and process.poll() is None:
            process.terminate()
            try:
                process.wait(1.0)
            except subprocess.TimeoutExpired:
                process.kill()
        self._builder.shutdown()

    def _build(self, building: SessionStatus, segments: Sequence[Path]) -> None:
        state, text = self._outcome(building.path, segments)
        if self.status is building:  # else the next one is being built
            self.status = replace(building, state=state, text=text)

    def _outcome(self, target: str, segments: Sequence[Path]) -> tuple[SessionState, str]:
        """Build a session file; return its state, and the reason of a failure or the losses."""
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "daq.session.build", target, *map(str, segments)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                process_group=0,  # not affected by Ctrl-C at the terminal
            )
        except OSError as error:
            return SessionState.FAILED, error.strerror or str(error)
        self._process = process
        if self._is_closed:
            process.terminate()
        try:
            # Building a session file takes seconds; after an hour it counts as hung.
            output, _ = process.communicate(timeout=3600.0)
        except subprocess.TimeoutExpired:
            process.kill()  # if it waits for a hung disk it may end later
            return SessionState.FAILED, "it took too long and was ended: check the disk"
        lines = output.decode("utf-8", "replace").splitlines()
        last, text = lines[-1] if lines else "", ""
        with suppress(ValueError, AttributeError):  # its JSON line has an error, or losses
            result = json.loads(last)
            text = printable(str(result.get("error") or result.get("loss") or ""), 400)
        if process.returncode in (DONE, DONE_WITH_LOSS):
            return SessionState.READY, text
        failure = printable(f"ended with code {process.returncode}: {last}")
        return SessionState.FAILED, text or failure
