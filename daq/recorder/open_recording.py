"""Begins a recording, or resumes one that a killed recorder had left open."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from ..bench.config import Bench, bench_codec, parse_bench
from ..clocks import Now
from ..errors import BumpbenchError
from ..journal.built import is_outdated
from ..journal.contents import JournalTail, session_name
from ..journal.folder import last_recording, next_segment
from ..journal.format import JournalHead
from ..journal.segment import JournalFile, SyncedFile
from ..journal.writer import JournalWriter
from ..runlog.fold import fold
from ..runlog.runlog import Code, RunLog
from .fault_barrier import FaultBarrier
from .orders import OrderError
from .recording import Recording

CreateFile = Callable[[Path], JournalFile]
OWN_BENCH = (
    "the resumed recording goes on with its own bench.toml, not with the one in the file: reload "
    "to use that, or start a new recording"
)
NOT_RESUMED = "the last recording was not ended and cannot be resumed (%s): a new one is begun"

_log = logging.getLogger("recorder")


@dataclass(frozen=True, slots=True)
class OpenRecording:
    """A recording with its open journal."""

    identity: str
    """Its identity in every segment."""
    writer: JournalWriter
    recording: Recording
    session: Path
    """Its session file."""
    before: tuple[Path, ...] = ()
    """Segments written by earlier recorders."""

    @property
    def segments(self) -> tuple[Path, ...]:
        """All existing segments, in order; the oldest may have been deleted."""
        return (*(path for path in self.before if path.exists()), *self.writer.paths)

    def end(self, why: str) -> None:
        """End the recording, and the run that is being recorded.

        Raises OrderError if the disk refuses the frames that wait in memory: they would be lost.
        """
        if not self.writer.flush():
            disk = self.writer.status
            why_not = f"the disk refuses ({disk.failed}): {disk.held_frames} frames wait in memory"
            raise OrderError(f"{why_not}; make room first")
        self.recording.cut(why)
        self.writer.close(ended=True)


def begin(
    journal: Path,
    bench: Bench,
    software: str,
    now: Now,
    barrier: FaultBarrier,
    create: CreateFile = SyncedFile,
    tail: JournalTail | None = None,
) -> OpenRecording:
    """Begin a recording, or resume the one whose state is `tail`.

    Raises InputError if bench.toml and DBC do not fit together.  Raises JournalError if the journal
    cannot be written at all.
    """
    codec = bench_codec(bench)
    identity = tail.head.recording if tail else uuid.uuid4().hex
    monotonic_ns = round(now.monotonic_s * 1e9)
    first = tail.first_segment if tail else next_segment(journal)
    head = JournalHead(
        bench.text, bench.dbc_text, software, now.wall_ns, monotonic_ns, identity, first
    )
    writer = JournalWriter(journal, head, bench.recorder, create, tail)
    run_log = fold(tail.events) if tail else RunLog()
    recording = Recording(bench, codec, writer, run_log, barrier)
    if tail is not None:
        recording.note(Code.RESUMED, float(tail.frames), software, now)
    session = journal.parent / session_name(first)
    return OpenRecording(identity, writer, recording, session, tail.segments if tail else ())


def resumable(journal: Path, bench: Bench) -> tuple[JournalTail, Bench] | None:
    """Return the recording in a folder that can be resumed, and its bench; None if there is none.

    It goes on with its own bench.toml, which has the changes made during the recording, but with
    the buses and limits given now.  With another DBC it cannot be resumed.
    """
    try:
        tail = last_recording(journal)
        if tail is None or tail.ended or not tail.head.recording:
            return None
        text = fold(tail.events).bench_text or tail.head.bench_text
        if tail.head.dbc_text != bench.dbc_text:
            _log.warning(NOT_RESUMED, "it is of another DBC")
            return None
        if text != bench.text:
            _log.warning(OWN_BENCH)
            recorded = parse_bench(text, "bench.toml in the journal", Path(), bench.dbc_text)
            bench = replace(
                recorded, buses=bench.buses, dbc_name=bench.dbc_name, recorder=bench.recorder
            )
    except (BumpbenchError, OSError) as error:  # the old recording stays as it is
        _log.warning(NOT_RESUMED, error)
        return None
    return tail, bench


def unfinished(journal: Path) -> tuple[Path, JournalTail] | None:
    """Return the last recording in a folder and its session file, if that is still to be built."""
    try:
        tail = last_recording(journal)
    except OSError:
        return None
    if tail is None:
        return None
    session = journal.parent / tail.session_name
    done = session.exists() and not is_outdated(journal, tail.head.identity, tail.next_number)
    return None if done else (session, tail)
