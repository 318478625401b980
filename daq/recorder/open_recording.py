"""Begins a recording, or resumes one that a killed recorder left open.

A recording is a campaign, or the traffic between two campaigns; all are stored in one journal.
"""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from dbc.words import counted

from ..bench.config import Bench, bench_codec, parse_bench
from ..bus.clock import Now
from ..errors import BumpbenchError
from ..journal.contents import RecordingInfo
from ..journal.folder import last_campaign, last_recording
from ..journal.format import JournalHead, session_name
from ..journal.segment import JournalFile, WriteLedger
from ..journal.writer import JournalWriter
from ..runlog.run_log import Code, RunLog, fold
from .orders import OrderError
from .recording import FaultBarrier, Recording

CreateFile = Callable[[Path], JournalFile]
OWN_BENCH = (
    "the resumed recording continues with its own bench.toml, not with the one in the file: reload "
    "to use that, or start a new recording"
)
NOT_RESUMED = "the last recording was not ended and cannot be resumed ({}): a new one is begun"

_log = logging.getLogger("recorder")


@dataclass(frozen=True, slots=True)
class OpenRecording:
    """A recording with the open journal."""

    head: JournalHead
    """Head, which is stored in every segment."""
    writer: JournalWriter
    """Writer of the journal; the next recording uses the same one."""
    ledger: WriteLedger
    """Ledger of its segments that were written by this recorder."""
    recording: Recording
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
        return (*(path for path in self.before if path.exists()), *self.ledger.paths)

    def next(
        self, bench: Bench, why: str, now: Now, barrier: FaultBarrier, *, campaign: bool
    ) -> OpenRecording:
        """End this recording, and the run that is being recorded, and begin the next one.

        `why`: the reason, for that run.  Raises InputError if bench.toml and DBC contradict each
        other, and OrderError if the disk refuses the frames that wait in memory; this recording
        then continues.
        """
        recording = Recording(bench, bench_codec(bench), self.writer, None, barrier)
        if self.writer.flush():
            self.recording.cut(why)
        if not self.writer.begin(_head(bench, self.head.software, now, campaign=campaign)):
            disk = self.writer.status
            wait = counted(disk.held_frames, "frame waits", "frames wait")
            why_not = f"the disk refuses ({disk.failed}): {wait} in memory"
            raise OrderError(f"{why_not}; make room first")
        self.writer.limits = bench.recorder
        head, ledger = self.writer.head, self.writer.ledger
        session = self.session.with_name(session_name(head.first_segment))
        return OpenRecording(head, self.writer, ledger, recording, session)


def open_journal(
    journal: Path,
    bench: Bench,
    software: str,
    now: Now,
    barrier: FaultBarrier,
    create: CreateFile,
    tail: RecordingInfo | None,
) -> OpenRecording:
    """Open the journal and begin a campaign in it, or resume the one whose state is `tail`.

    Raises InputError if bench.toml and DBC contradict each other.  Raises JournalError if the
    journal cannot be written at all.
    """
    codec = bench_codec(bench)
    head = _head(bench, software, now, campaign=True)
    if tail is not None:
        head = replace(head, recording=tail.head.recording)
    writer = JournalWriter(journal, head, bench.recorder, create, tail)
    run_log = fold(tail.events) if tail else RunLog()
    recording = Recording(bench, codec, writer, run_log, barrier)
    if tail is not None:
        recording.note(Code.RESUMED, float(tail.frames), software, now)
    before = tail.segments if tail else ()
    session = journal.parent / session_name(writer.head.first_segment)
    return OpenRecording(writer.head, writer, writer.ledger, recording, session, before)


def _head(bench: Bench, software: str, now: Now, *, campaign: bool) -> JournalHead:
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
    try:
        tail = last_recording(journal)
        if tail is None or tail.ended or not tail.head.campaign:
            return ""
        if tail.head.origin != bench.origin:
            return _not_resumed(f"its frames are {tail.head.origin}, not {bench.origin}")
        text = fold(tail.events).bench_text or tail.head.bench_text
        if tail.head.dbc_text != bench.dbc_text:
            return _not_resumed("it has another DBC")
        if text != bench.text:
            _log.warning(OWN_BENCH)
            recorded = parse_bench(text, "bench.toml in the journal", Path(), bench.dbc_text)
            bench = replace(
                recorded,
                buses=bench.buses,
                dbc_name=bench.dbc_name,
                recorder=bench.recorder,
                origin=bench.origin,
            )
    except (BumpbenchError, OSError) as error:  # the old recording is not changed
        return _not_resumed(error)
    return tail, bench


def _not_resumed(why: object) -> str:
    text = NOT_RESUMED.format(why)
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
