"""Keeps a recording on the disk for weeks, whatever the disk does.

Segments end by size and by age, and at the first write error: the block goes into a new one.  While
the disk refuses altogether, blocks wait in memory and are tried again each second; what does not
fit there is counted and told by an event.  Nothing here raises once the keeper stands.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Self

from dbc.errors import BumpbenchError
from dbc.frames import FrameBatch

from ..bench.config import RecorderConfig
from ..bus.source import HopLosses
from ..control.messages import DiskStatus
from ..runs import Event
from .backlog import Backlog
from .contents import JournalTail
from .disk_space import Room, place_of, room_on, taken_away, too_little
from .folder import next_segment, segment_number
from .format import EVENTS_TOPIC, FRAMES_TOPIC, JournalHead, head_record, pack_events, pack_frames
from .gaps import DISK_GAP, ENDED, FILE_GONE, gap_event
from .retention import Retention, parting_events
from .segment import Block, JournalFile, Segment, SyncedFile
from .write_ledger import Written

TURN_S = 1.0
"""The disk is looked at, and tried again, so often."""
_LOOK_BYTES = 16_000_000
"""After so many bytes room is asked for earlier than that."""
_BATCH_BYTES = 4_000_000
"""Blocks that waited are synced together up to this size."""
_REMEMBERED_S = 60.0
"""A file that failed or was taken away is warned of for so long."""
_MAY_PASS = (errno.ENOSPC, errno.EIO, errno.EDQUOT)


class JournalError(BumpbenchError, OSError):
    """There is no place for the journal where it was to be."""


class JournalWriter:
    """A recording being written; a context manager that closes it.

    Parameters
    ----------
    folder : Path
        Created if need be.  Segments are numbered on from those that are in it: a clock that is
        wrong must not decide over names.
    head : JournalHead
        Goes into every segment.  With `resume`, its `recording` is that of the tail.
    limits : RecorderConfig
        When segments end, what is deleted, what is left free; may be set anew at any time.
    create : callable
        Creates a file for writing.
    resume : JournalTail, optional
        The recording goes on there.
    room : callable
        Asks for the room on the disk of a folder.

    Raises
    ------
    JournalError
        If the folder cannot be written at all.  A disk that is full, or that fails, is waited for.
    """

    def __init__(
        self,
        folder: Path,
        head: JournalHead,
        limits: RecorderConfig = RecorderConfig(),  # noqa: B008 - frozen
        create: Callable[[Path], JournalFile] = SyncedFile,
        resume: JournalTail | None = None,
        room: Callable[[Path], Room] = room_on,
    ) -> None:
        self._folder, self._head, self.limits = folder, head, limits
        self._create, self._room_on = create, room
        self._number = resume.next_number if resume else 0
        self._t_ns = resume.t_ns if resume else 0
        self._recorded = resume.frames if resume else 0
        self._backlog = Backlog(head.identity)
        self._written = Written(head.identity)
        self._segment: Segment | None = None
        self._now_s: float | None = None
        self._turn_s = self._opened_s = self._warned_s = 0.0
        self._failed = self._trouble = self._kept_text = ""
        self._stopped = False
        self._looked_at = 0
        self._free = Room(0, 0)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._place = place_of(folder)
            self._free = room(folder)
            self._retention = Retention(folder, head.identity)
            self._stopped = too_little(self._free, limits, stopped=False)
            if not self._stopped:
                self._segment = self._new_segment()
        except OSError as error:
            if error.errno not in _MAY_PASS:
                raise JournalError(
                    str(folder),
                    f"cannot write the journal: {error.strerror or error}",
                    "choose another folder",
                ) from error
            self._failed = _told(error)

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Store a block of frames; `status.recorded_frames` tells what is on the disk.

        Parameters
        ----------
        frames : FrameBatch
            May be empty, if there are only losses to tell of.
        losses : HopLosses
            Cumulative counts of this process up to this block.  What the keeper itself had to
            drop is added to `queue_dropped` in the journal.
        """
        if len(frames):
            self._t_ns = max(self._t_ns, int(frames.t_ns.max()))
        own = replace(losses, queue_dropped=losses.queue_dropped + self._backlog.dropped)
        self._take(FRAMES_TOPIC, pack_frames(self._number, frames, own), len(frames))

    def append_events(self, events: Sequence[Event]) -> None:
        """Store events; as `append`."""
        self._take(EVENTS_TOPIC, pack_events(self._number, events), 0)

    def tend(self, monotonic_s: float) -> None:
        """Look after disk and files; to be called with every block, and ten times a second if idle.

        Parameters
        ----------
        monotonic_s : float
            Monotonic clock, s.
        """
        if self._now_s is None:
            self._opened_s = monotonic_s
            self._turn_s = monotonic_s - TURN_S
        self._now_s = monotonic_s
        if monotonic_s - self._turn_s >= TURN_S:
            self._turn_s = monotonic_s
            self._look()
            if self._segment is None and not self._stopped:
                self._open_next()
            self._drain()
            self._make_room()
        elif self._size - self._looked_at > _LOOK_BYTES:
            self._look()
        self._rotate()

    @property
    def status(self) -> DiskStatus:
        """How the disk does, as of the last turn."""
        since_s = self._backlog.since_s()
        return DiskStatus(
            free_bytes=self._free.free,
            journal_bytes=self._retention.bytes + self._size,
            recorded_frames=self._recorded,
            lag_s=0.0 if since_s is None else (self._now_s or 0.0) - since_s,
            held_frames=self._backlog.frames,
            failed=self._failed,
            dropped_frames=self._backlog.dropped,
            warning="; ".join(text for text in (self._trouble, self._kept_text) if text),
            total_bytes=self._free.total,
        )

    @property
    def paths(self) -> tuple[Path, ...]:
        """The segments in which this keeper has blocks, in order."""
        return tuple(sorted(self._written.paths, key=segment_number))

    def flush(self) -> bool:
        """Write what waits in memory; return whether all is on the disk."""
        if self._segment is None and not self._stopped:
            self._open_next()
        self._drain()
        return self._segment is not None and not len(self._backlog)

    def cut(self) -> None:
        """Finish the open segment and go on in the next: others may read all up to here."""
        self.flush()
        if self._segment is not None and self._segment.first is not None:
            self._seal()
            self._open_next()

    def close(self, ended: bool = False) -> None:
        """Finish the file.  All that was recorded is safe without this.

        Parameters
        ----------
        ended : bool
            Whether the recording is over; if not, it may be taken up again.
        """
        if len(self._backlog):
            self.flush()
        if ended:
            self.append_events([Event(self._t_ns, ENDED)])
        self._seal()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- blocks ---------------------------------------------------------------------------------

    def _take(self, topic: str, message: bytes, frames: int) -> None:
        # The number is given away here: a block that was tried and then dropped may be on the
        # disk after all, and no other must bear its number.
        block = Block(self._number, topic, self._t_ns, message, frames)
        self._number += 1
        if self._segment is not None and not len(self._backlog) and self._store([block]):
            return
        self._backlog.put(block, self._now_s or 0.0)

    def _store(self, blocks: Sequence[Block]) -> bool:
        """Write blocks into the open segment, or else into a new one; whether that worked."""
        for _ in range(2):
            if self._segment is None and not self._open_next():
                return False
            assert self._segment is not None
            try:
                self._segment.write(blocks)
            except OSError as error:
                self._failed = _told(error)
                self._warn(f"{self._segment.path.name}: {_told(error)}; left as it was")
                self._leave(Segment.abandon)
                continue
            self._failed = ""
            self._recorded += self._written.note(self._segment.path, blocks)
            return True
        return False

    def _drain(self) -> None:
        """Write what waits, as far as the disk takes it."""
        if self._stopped:
            return
        while len(self._backlog) and self._segment is not None:
            blocks = self._backlog.first(_BATCH_BYTES)
            if not self._store(blocks):
                return
            self._backlog.remove(len(blocks))
            self._rotate()
        if not len(self._backlog) and (gap := self._backlog.take_gap()):
            self.append_events([gap_event(DISK_GAP, self._t_ns, gap)])

    # -- segments -------------------------------------------------------------------------------

    @property
    def _size(self) -> int:
        return self._segment.size if self._segment else 0

    def _new_segment(self) -> Segment:
        self._folder.mkdir(parents=True, exist_ok=True)
        self._place = place_of(self._folder)
        number = next_segment(self._folder)
        path = self._folder / f"journal_{number:04d}.mcap"
        segment = Segment(self._create(path), path, head_record(self._head, number), self._head)
        self._opened_s, self._looked_at = self._now_s or 0.0, 0
        return segment

    def _open_next(self) -> bool:
        try:
            self._segment = self._new_segment()
        except OSError as error:
            self._failed = _told(error)
            return False
        self._failed = ""
        return True

    def _leave(self, how: Callable[[Segment], None]) -> None:
        """Be done with the open segment."""
        segment, self._segment = self._segment, None
        if segment is not None:
            if segment.first is not None:
                self._retention.add(segment.path, segment.size)
            how(segment)

    def _seal(self) -> None:
        name = self._segment.path.name if self._segment else ""
        try:
            self._leave(Segment.finish)
        except OSError as error:
            self._warn(f"{name}: {_told(error)}; not closed properly")

    def _rotate(self) -> None:
        segment, limits = self._segment, self.limits
        if segment is None or segment.first is None:
            return  # a silent bus makes no files
        age_s = (self._now_s or 0.0) - self._opened_s
        if segment.size >= limits.segment_bytes or age_s >= limits.segment_s:
            self._seal()
            self._open_next()

    # -- the disk -------------------------------------------------------------------------------

    def _look(self) -> None:
        """Ask for room, and whether folder and file are still ours."""
        self._looked_at = self._size
        now_s = self._now_s or 0.0
        if self._trouble and now_s - self._warned_s > _REMEMBERED_S:
            self._trouble = ""
        self._look_for_file()
        try:
            self._free = self._room_on(self._folder)
        except OSError as error:
            self._failed = _told(error)
            return
        stopped = too_little(self._free, self.limits, self._stopped)
        if stopped and not self._stopped:
            self._seal()
        self._stopped = stopped
        if stopped:
            reserve = self.limits.reserve_bytes / 1e6
            self._failed = f"the disk is full but for the reserve of {reserve:.0f} MB"

    def _look_for_file(self) -> None:
        segment = self._segment
        text = ""
        if place_of(self._folder) != self._place:
            text = f"folder {self._folder.name} was taken away or its disk unmounted"
        elif segment is not None:
            try:
                text = taken_away(segment.path, segment.file.stat(), segment.size)
            except OSError as error:
                text = f"cannot be asked for: {_told(error)}"
            text = f"{segment.path.name} {text}" if text else ""
        if not text:
            return
        replaced = segment.path if segment is not None and "replaced" in text else None
        self._leave(Segment.forsake)
        gone = self._written.take_gone(replaced)
        for path in gone:
            self._retention.forget(path)
        frames = sum(gap.frames for gap in gone.values())
        self._recorded -= frames
        self._warn(f"{text}: {frames} recorded frames are gone")
        told = [gap_event(FILE_GONE, self._t_ns, gap) for gap in gone.values()]
        if self._open_next() and told:
            self.append_events(told)

    def _warn(self, text: str) -> None:
        self._warned_s = self._now_s or 0.0
        self._trouble = text

    def _make_room(self) -> None:
        """Delete what may go, if there is too much or too little room."""
        reserve = self.limits.reserve_bytes
        excess = self._retention.bytes + self._size - self.limits.keep_bytes
        if self._free.free < 2 * reserve:
            excess = max(excess, 2 * reserve - self._free.free)
        if excess <= 0:
            self._kept_text = ""
            return
        going = self._retention.choose(excess, self._t_ns)
        if going is None:
            return  # still looking through the old segments
        for info in going:
            self.append_events(parting_events(info, self._head.identity, self._t_ns))
            self._retention.delete(info)
            self._written.forget(info.path)
        self._kept_text = (
            ""
            if going
            else f"the journal has {self._retention.bytes / 1e9:.2f} GB and none of it may be "
            "deleted: its runs are in no session file yet"
        )


def _told(error: OSError) -> str:
    return error.strerror or str(error)
