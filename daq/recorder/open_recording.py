"""A recording being begun, or taken up again where a recorder that was killed had left it."""

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
from .fault_barrier import Guard
from .orders import OrderError
from .recording import Recording

CreateFile = Callable[[Path], JournalFile]
OWN_BENCH = (
    "the recording that is taken up again goes on with its own bench.toml, not with the one in the "
    "file: reload to take that over, or start a new recording"
)
NOT_RESUMED = "the last recording was not ended and cannot go on (%s): a new one is begun"

_log = logging.getLogger("recorder")


@dataclass(frozen=True, slots=True)
class OpenRecording:
    """An open recording."""

    identity: str
    """Its name, as in every segment."""
    writer: JournalWriter
    recorder: Recording
    """`writer`, `recorder`: where its frames go; what is done with them."""
    session: Path
    """Its session file."""
    before: tuple[Path, ...] = ()
    """Segments of recorders that had it before."""

    @property
    def segments(self) -> tuple[Path, ...]:
        """All segments that are there, in order."""
        # Room may have been made of the oldest.
        return (*(path for path in self.before if path.exists()), *self.writer.paths)

    def end(self, why: str) -> None:
        """End the recording, and the run that is being recorded.

        Raises
        ------
        OrderError
            If the disk does not take what waits in memory: it would be lost.
        """
        if not self.writer.flush():
            disk = self.writer.status
            why_not = f"the disk refuses ({disk.failed}): {disk.held_frames} frames wait in memory"
            raise OrderError(f"{why_not}; make room first")
        self.recorder.cut(why)
        self.writer.close(ended=True)


def begin(
    journal: Path,
    bench: Bench,
    software: str,
    now: Now,
    guard: Guard,
    create: CreateFile = SyncedFile,
    tail: JournalTail | None = None,
) -> OpenRecording:
    """Begin a recording, or take up the one that `tail` tells of.

    Raises
    ------
    InputError
        If bench.toml and DBC do not fit together.
    JournalError
        If there is no place for the journal.
    """
    codec = bench_codec(bench)
    identity = tail.head.recording if tail else uuid.uuid4().hex
    monotonic_ns = round(now.monotonic_s * 1e9)
    first = tail.first_segment if tail else next_segment(journal)
    head = JournalHead(
        bench.text, bench.dbc_text, software, now.wall_ns, monotonic_ns, identity, first
    )
    writer = JournalWriter(journal, head, bench.recorder, create, tail)
    book = fold(tail.events) if tail else RunLog()
    recorder = Recording(bench, codec, writer, book, guard)
    if tail is not None:
        recorder.note(Code.RESUMED, float(tail.frames), software, now)
    session = journal.parent / session_name(first)
    return OpenRecording(identity, writer, recorder, session, tail.segments if tail else ())


def resumable(journal: Path, bench: Bench) -> tuple[JournalTail, Bench] | None:
    """Return the recording in a folder that is to go on, and its bench; None if there is none.

    Its own bench.toml goes on with it, on the buses and within the limits that are given now: what
    was changed during the recording is in the recording.  With another DBC it is another recording.
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
            own = parse_bench(text, "bench.toml in the journal", Path(), bench.dbc_text)
            bench = replace(
                own, buses=bench.buses, dbc_name=bench.dbc_name, recorder=bench.recorder
            )
    except (BumpbenchError, OSError) as error:  # the old one stays as it is
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
