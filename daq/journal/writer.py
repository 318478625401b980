"""Writes the journal to the disk for weeks, and survives every fault of the disk.

The journal begins and ends with the process.  Campaigns, and the times between them, are recordings
in it: one ends and the next begins between two segments, without losing a frame.

A segment ends at a given size or age, and at the first write error; the block is then written to a
new segment.  While the disk refuses everything, blocks wait in memory, and the write is repeated
each second; frames that do not fit into the memory, and those of a file that was removed, are
counted in the next block.  Only the constructor raises errors.
"""

from __future__ import annotations

import errno
import shutil
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from math import inf
from pathlib import Path
from typing import Self

from dbc.frames import FrameBatch
from dbc.words import BumpbenchError, InputError, counted

from ..bench.config import RecorderConfig
from ..bus.source import HopLosses
from ..control.messages import DiskStatus
from ..runlog import Code
from ..runs import Event
from .reader import (
    RecordingInfo,
    SegmentInfo,
    deleted_blocks,
    deleted_event,
    next_segment,
    scan,
    segments_in,
)
from .segment import (
    ENDED,
    Block,
    JournalHead,
    Kind,
    Segment,
    Summary,
    SyncedFile,
    pack_events,
    pack_frames,
    segment_number,
)

REACH_NS = 1_200_000_000_000
"""Time before and after an event of a run whose segments are kept, ns: more than the 660 s that
`[trigger]` of bench.toml allows for a run."""
HELD_BYTES = 32_000_000
"""Largest number of bytes of frames that wait in memory: a minute of four full buses."""
_RUN_CODES = frozenset(Code)  # of the events of the run log


class JournalError(BumpbenchError, OSError):
    """The journal cannot be written to its folder at all."""


class JournalWriter:
    """Writes recordings one after another; a context manager that closes the journal.

    `folder`: created if it does not exist.  Segment numbers continue those in the folder, because a
    wrong clock must not affect names.  `head`: written into every segment of the first recording,
    with the number of its first segment.  `limits`: when segments end, when old ones are deleted,
    space left free; may be changed at any time.  `resume`: state of the recording that is resumed,
    with the same `recording` as the head.  Raises JournalError if the folder cannot be written at
    all.  If the disk is full or fails, blocks wait.

    Attributes: `head`, that of the present recording; `stored_frames`, number of frames of all
    recordings that this writer has stored on the disk.
    """

    def __init__(
        self,
        folder: Path,
        head: JournalHead,
        limits: RecorderConfig | None = None,
        create: Callable[[Path], SyncedFile] = SyncedFile,
        resume: RecordingInfo | None = None,
        disk_usage: Callable[[Path], tuple[int, int, int]] = shutil.disk_usage,
    ) -> None:
        self._folder, self.limits = folder, limits or RecorderConfig()
        self._create, self._disk_usage = create, disk_usage
        first = next_segment(folder) if resume is None else resume.head.first_segment
        self._begin_counts(replace(head, first_segment=first))
        if resume is not None:
            self._number, self._t_ns = resume.next_number, resume.last_ns
            self._recorded, self._earlier = resume.frames, resume.segments
            for event in resume.events:  # the last of those on deleted blocks lists all of them
                if spans := deleted_blocks(event):
                    self._deleted = list(spans)
            self._runs_ns = [event.t_ns for event in resume.events if event.code in _RUN_CODES]
        self.stored_frames = 0
        self._segment: Segment | None = None
        self._now_s = self._opened_s = self._warned_s = 0.0
        self._checked_s = -inf
        self._failure = self._warning = ""
        self._free_bytes = self._total_bytes = 0
        self._is_full = False
        self._sizes: dict[Path, int] = {}
        """Sizes of the segments in the folder except the open one, bytes."""
        self._infos: dict[Path, SegmentInfo] = {}  # of segments that may be deleted
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._measure()
            self._sizes = {p: p.stat().st_size for p in segments_in(folder) if p.is_file()}
            if not self._is_full:
                self._segment = self._new_segment()
        except OSError as error:
            self._failure = _reason(error)
            if error.errno not in (errno.ENOSPC, errno.EIO, errno.EDQUOT):
                what = f"cannot write the journal: {self._failure}"
                raise JournalError(str(folder), what, "choose another folder") from error
            # It may work a second later, before anyone reads the status.
            self._warn(f"the first file could not be written: {self._failure}")

    def _begin_counts(self, head: JournalHead) -> None:
        """Begin to count for a recording from 0."""
        self.head = head
        self._number = self._t_ns = self._recorded = self._reported = 0
        self._losses = HopLosses()
        self._dropped = 0
        """Number of its frames without room, or in removed files; the journal has `_reported`."""
        self._waiting = deque[Block]()
        """Its blocks that the disk refuses."""
        self._waiting_bytes, self._waits_since_s = 0, 0.0
        self._runs_ns = list[int]()
        """Times of the events of its run log, ns."""
        self._written: list[Segment] = []
        """Its segments that have blocks, and were written by this writer."""
        self._earlier = tuple[Path, ...]()
        """Its segments that were written by earlier recorders."""
        self._deleted = list[tuple[int, int]]()
        """Its blocks that were deleted on purpose: first, and after the last."""

    def begin(self, head: JournalHead) -> tuple[Path, ...]:
        """End the recording and begin the next one; return the segments of the ended recording.

        If blocks of it wait in memory it continues, and nothing is returned.  `head`: of the next
        recording; the number of its first segment is set here.
        """
        if not self.flush():
            return ()
        self.append_events([Event(self._t_ns, ENDED)])
        if self._waiting:
            return ()
        self._end_segment(Segment.finish)
        ended_paths = self.paths
        self._begin_counts(replace(head, first_segment=next_segment(self._folder)))
        self._open_next()
        return ended_paths

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Store a block of frames; `status.recorded_frames` counts frames on the disk.

        `frames`: empty if there are only losses to report.  `losses`: up to this block, since this
        process began or resumed the recording.  The writer adds what it dropped to `queue_dropped`.
        """
        self._t_ns = int(frames.t_ns.max(initial=self._t_ns))
        self._losses = losses
        total_losses = losses.plus(HopLosses(queue_dropped=self._dropped))
        self._put(Kind.FRAMES, pack_frames(frames, total_losses))

    def append_events(self, events: Sequence[Event]) -> None:
        """Store events; as `append`."""
        self._runs_ns += [event.t_ns for event in events if event.code in _RUN_CODES]
        self._put(Kind.EVENTS, pack_events(events))

    def maintain(self, monotonic_s: float) -> None:
        """Check disk and files; to be called with every block, and ten times per second if idle."""
        if self._checked_s == -inf:  # the first call
            self._opened_s = self._warned_s = self._waits_since_s = monotonic_s
        self._now_s = monotonic_s
        if monotonic_s - self._checked_s >= 1.0:
            self._checked_s = monotonic_s
            self._check_disk()
            self.flush()
            self._make_room()
        self._end_if_old()

    @property
    def status(self) -> DiskStatus:
        """State of the journal and its disk at the last check."""
        return DiskStatus(
            free_bytes=self._free_bytes,
            journal_bytes=self._journal_bytes,
            recorded_frames=self._recorded,
            lag_s=self._now_s - self._waits_since_s if self._waiting else 0.0,
            held_frames=sum(block.size for block in self._waiting),
            failed=self._failure,
            dropped_frames=self._dropped,
            warning=self._warning,
            total_bytes=self._total_bytes,
        )

    @property
    def paths(self) -> tuple[Path, ...]:
        """The segments with blocks of the present recording, in order, also of earlier writers."""
        earlier = (path for path in self._earlier if path.exists())
        return (*earlier, *(segment.path for segment in self._written))

    def flush(self) -> bool:
        """Write the blocks that wait in memory; return whether all are on the disk."""
        if self._is_full or not (self._segment or self._open_next()):
            return False
        while self._waiting:
            blocks = list(islice(self._waiting, 40))  # of about 4 s, synced together
            if not self._store(blocks):
                return False
            for block in blocks:
                self._waiting.popleft()
                self._waiting_bytes -= len(block.content)
            self._end_if_old()
        if self._reported != self._dropped:
            self._reported = self._dropped
            self.append(FrameBatch.empty(), self._losses)
        return self._segment is not None and not self._waiting

    def cut(self) -> None:
        """Finish the open segment and begin the next, so that those with blocks change no more."""
        self.flush()
        if self._segment is not None and not self._segment.is_empty:
            self._end_segment(Segment.finish)
            self._open_next()

    def close(self, ended: bool = False) -> None:
        """Finish the file; the recorded data are safe also without this.

        `ended`: True if the present recording is finished; else it may be resumed.
        """
        if self._waiting:
            self.flush()
        if ended:
            self.append_events([Event(self._t_ns, ENDED)])
        self._end_segment(Segment.finish)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Blocks ------------------------------------------------------------------------------------

    def _put(self, kind: Kind, content: bytes) -> None:
        """Write a block; one that the disk refuses waits in memory, or its frames are dropped."""
        block = Block(kind, self._number, self.head.wall_ns, self.head.recording, content)
        is_next = not self._waiting
        is_stored = is_next and self._segment is not None and self._store([block])
        # The number is used in any case: a block that was tried and then dropped may nevertheless
        # be on the disk, and no other block may have its number.
        self._number += 1
        if is_stored:
            return
        # Additional bytes for events: they are few, and runs depend on them.
        limit_bytes = HELD_BYTES if kind is Kind.FRAMES else HELD_BYTES + 4_000_000
        if self._waiting_bytes + len(content) > limit_bytes:
            self._dropped += block.size
            return
        if is_next:
            self._waits_since_s = self._now_s
        self._waiting.append(block)
        self._waiting_bytes += len(content)

    def _store(self, blocks: Sequence[Block]) -> bool:
        """Write blocks into the open segment, or else a new one; return whether this succeeded."""
        for _ in range(2):
            if self._segment is None and not self._open_next():
                return False
            assert self._segment is not None
            is_first = self._segment.is_empty
            try:
                self._segment.write(blocks)
            except OSError as error:
                self._failure = _reason(error)
                self._warn(f"{self._segment.path.name}: {self._failure}; left as it was")
                self._end_segment(Segment.abandon)
                continue
            self._failure = ""
            self._written += [self._segment] if is_first else []
            frames = sum(block.size for block in blocks)
            self._recorded += frames
            self.stored_frames += frames
            return True
        return False

    # Segments ----------------------------------------------------------------------------------

    def _new_segment(self) -> Segment:
        """Create the next file, for the waiting blocks or else the next one; raises OSError."""
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"journal_{next_segment(self._folder):04d}.bbj"
        first_number = self._waiting[0].number if self._waiting else self._number
        self._opened_s = self._now_s
        return Segment(self._create(path), path, self.head, first_number)

    def _open_next(self) -> bool:
        """Open a segment, and keep the reason if it fails; return whether it succeeded."""
        try:
            self._segment, self._failure = self._new_segment(), ""
        except OSError as error:
            self._failure = _reason(error)
        return self._segment is not None

    def _end_segment(self, method: Callable[[Segment], None]) -> None:
        """End the open segment, if there is one, by a method of its class."""
        segment, self._segment = self._segment, None
        if segment is None:
            return
        try:
            method(segment)
        except OSError as error:
            self._warn(f"{segment.path.name}: {_reason(error)}; not closed properly")
        if not segment.is_empty:
            self._sizes[segment.path] = segment.size

    def _end_if_old(self) -> None:
        """End a segment that is large or old enough, and begin the next.

        One without blocks stays, so that a silent bus creates no files.
        """
        if self._segment is None or self._segment.is_empty:
            return
        age_s = self._now_s - self._opened_s
        if self._segment.size >= self.limits.segment_bytes or age_s >= self.limits.segment_s:
            self._end_segment(Segment.finish)
            self._open_next()

    # The disk ----------------------------------------------------------------------------------

    def _measure(self) -> None:
        """Measure the free space, and decide whether recording must stop.

        Raises OSError if the folder does not exist.
        """
        self._total_bytes, _, self._free_bytes = self._disk_usage(self._folder)
        # Free space, as a multiple of the reserve, from which a stopped recording continues: more
        # than that at which it stops, so that it does not stop again at once.
        reserves = 1.05 if self._is_full else 1.0
        self._is_full = self._free_bytes < reserves * self.limits.reserve_bytes

    def _check_disk(self) -> None:
        """Check that the files of the recording exist, and the free space; end warnings after 60 s.

        If the disk is full, the open segment ends and `_failure` says so.
        """
        if self._now_s - self._warned_s > 60.0:
            self._warning = ""
        newest = self._segment or (self._written[-1] if self._written else None)
        if newest is not None and not newest.is_in_place:
            self._replace_removed(newest.path.name)
        was_full = self._is_full
        try:
            self._measure()
        except OSError as error:
            self._failure = _reason(error)
            return
        if self._segment is not None:  # it can be written: only an earlier look here had failed
            self._failure = ""
        if self._is_full:
            if not was_full:
                self._end_segment(Segment.finish)
            reserve = self.limits.reserve_bytes / 1e6
            self._failure = f"the disk is full except for the reserve of {reserve:.0f} MB"

    def _replace_removed(self, name: str) -> None:
        """Report the files that another process removed, the newest of them `name`; open a new one.

        A removed folder or an unmounted disk takes all files with it.
        """
        self._end_segment(Segment.abandon)
        removed = [segment for segment in self._written if not segment.is_in_place]
        for segment in removed:
            self._written.remove(segment)
            self._sizes.pop(segment.path, None)
        frames = sum(segment.summary.frames for segment in removed)
        self._recorded -= frames
        self._dropped += frames
        count = counted(frames, "recorded frame is", "recorded frames are")
        self._warn(f"{name} was removed or replaced: {count} lost")
        self._open_next()

    def _warn(self, text: str) -> None:
        self._warning, self._warned_s = text, self._now_s

    @property
    def _journal_bytes(self) -> int:
        """Size of all segments in the folder, bytes."""
        return sum(self._sizes.values()) + (self._segment.size if self._segment else 0)

    def _make_room(self) -> None:
        """Delete the oldest segments if the journal is too large or the free space too small.

        Of the present recording, segments with an event of its run log or near one stay, and those
        of the last minutes: a bump may come, and the time before it belongs to its run.
        """
        lacking_bytes = 2 * self.limits.reserve_bytes - self._free_bytes  # recording need not stop
        excess_bytes = max(self._journal_bytes - self.limits.keep_bytes, lacking_bytes)
        needed_ns = [self._t_ns, *self._runs_ns]
        for path in sorted(self._sizes, key=segment_number):
            if excess_bytes <= 0:
                return
            try:
                info = self._infos[path] = self._infos.get(path) or scan(path)
            except InputError:  # a file of another program, or it does not exist
                self._sizes.pop(path)
                continue
            if info.recording == self.head.recording:
                first_ns = info.summary.first_ns - REACH_NS
                last_ns = info.summary.last_ns + REACH_NS
                has_run_event = any(event.code in _RUN_CODES for _, event in info.summary.events)
                if has_run_event or any(first_ns <= t_ns <= last_ns for t_ns in needed_ns):
                    continue
                self._report_deleted(info.summary)
            with suppress(OSError):
                path.unlink()
            excess_bytes -= self._sizes.pop(path)
            del self._infos[path]
            self._written = [segment for segment in self._written if segment.path != path]

    def _report_deleted(self, deleted: Summary) -> None:
        """Store which blocks of this recording were deleted: else they would look like losses."""
        first, stop = self._deleted[-1] if self._deleted else (deleted.first, deleted.first)
        if first <= deleted.first <= stop:
            self._deleted[-1:] = [(first, deleted.stop)]
        else:
            self._deleted.append((deleted.first, deleted.stop))
        self.append_events([deleted_event(self._t_ns, self._deleted, deleted.frames)])


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
