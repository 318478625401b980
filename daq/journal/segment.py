"""Writes one file of the journal, each write synced, and holds blocks that the disk refuses.

After `Segment.write` has returned, neither a kill nor a power cut loses the blocks.  After the
first write error a file is not touched again: a repeated write in the same file leaves holes in
data that were reported as written.
"""

from __future__ import annotations

import errno
import os
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from io import FileIO
from pathlib import Path

from ..files import sync_data, sync_folder
from ..runs import Event
from .format import (
    Block,
    Gap,
    JournalHead,
    Kind,
    Summary,
    pack_block,
    pack_head,
    sealed_path,
)


class SyncedFile(FileIO):
    """A new file, without a buffer."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "xb")

    def sync(self) -> None:
        """Return when all data written are on the disk."""
        sync_data(self.fileno())


@dataclass(frozen=True, slots=True)
class Pending:
    """A block to be written.

    `number`: in the recording.  `content`: the packed frames or events.  `t_ns`: latest time stamp
    up to the block, ns.  `frames`, `first_ns`: number of its frames, and their earliest stamp.
    """

    number: int
    kind: Kind
    content: bytes
    t_ns: int
    frames: int = 0
    first_ns: int = 0
    events: tuple[Event, ...] = ()


class Segment:
    """A file of the journal.

    `file`: new and empty; closed here.  `path`: its path; deleted again if the head cannot be
    written.  After the last write it is renamed to `sealed_path`.  `number`: of its first block.
    `summary`: of its blocks on the disk.  `size`: bytes written.  Raises OSError if the head cannot
    be written.
    """

    def __init__(self, file: SyncedFile, path: Path, head: JournalHead, number: int) -> None:
        self.path, self.file, self.size = path, file, 0
        self.summary = Summary(number, number)
        self._head = head
        self._blocks = 0
        self._events: list[tuple[int, Event]] = []
        self._state = os.fstat(file.fileno())
        try:
            self._write(self._packed(Kind.HEAD, pack_head(head), number))
            file.sync()
            sync_folder(path.parent)
        except OSError:
            self.abandon()
            raise

    @property
    def is_empty(self) -> bool:
        """True if it has no block on the disk."""
        return not self._blocks

    @property
    def is_in_place(self) -> bool:
        """False if another process removed or replaced the file."""
        try:
            return os.path.samestat(self.path.stat(), self._state)
        except OSError as error:
            return error.errno not in (errno.ENOENT, errno.ENOTDIR)

    def write(self, blocks: Sequence[Pending]) -> None:
        """Write blocks through to the disk.

        Raises OSError if the write failed; then nothing else may be written to this file.
        """
        first, stop = blocks[0].number, blocks[-1].number + 1
        stored = [self._packed(block.kind, block.content, block.number) for block in blocks]
        # Number of blocks after which a segment repeats its head, about a second: then no damage to
        # the beginning of a segment that never got its end costs all of it.
        if self._blocks < 10 <= self._blocks + len(blocks):
            stored.append(self._packed(Kind.HEAD, pack_head(self._head), stop))
        self._write(b"".join(stored))
        self.file.sync()
        before = self.summary
        stamped = [block for block in blocks if block.frames]
        starts_ns = [block.first_ns for block in stamped] + [before.first_ns] * bool(before.frames)
        self.summary = Summary(
            first if self.is_empty else before.first,
            stop,
            before.frames + sum(block.frames for block in stamped),
            min(starts_ns, default=0),
            max((block.t_ns for block in stamped), default=before.last_ns),
        )
        self._blocks += len(blocks)
        self._events += ((block.number, event) for block in blocks for event in block.events)

    def finish(self) -> None:
        """Write the end, which makes the segment quick to scan, and close.

        Raises OSError if the end is not on the disk; the file is closed, and all blocks are in it.
        """
        content = pack_head(self._head, replace(self.summary, events=tuple(self._events)))
        try:
            self._write(self._packed(Kind.END, content, self.summary.stop))
            self.file.sync()
        finally:
            self._close_as_sealed()

    def abandon(self) -> None:
        """Close the file as it is; delete it if nothing in it was reported as written."""
        if self.is_empty and self.is_in_place:
            with suppress(OSError):
                self.path.unlink()
        self._close_as_sealed()

    def _close_as_sealed(self) -> None:
        in_place = self.is_in_place
        with suppress(OSError):
            self.file.close()
        self._events.clear()
        if in_place:
            with suppress(OSError):  # the next recorder will rename it
                self.path = self.path.rename(sealed_path(self.path))

    def _packed(self, kind: Kind, content: bytes, number: int) -> bytes:
        return pack_block(Block(kind, number, self._head.wall_ns, self._head.recording, content))

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:  # on an almost full disk a part is written without an error
            written = self.file.write(view)
            if not written:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self.size += written
            view = view[written:]


# Holds blocks in memory while the disk refuses them, and counts frames without room ---------------

HELD_BYTES = 32_000_000
"""Bytes of frames and events held in memory: a minute of four full buses."""
_OVERHEAD_BYTES = 400
"""Memory of a block in addition to its content, bytes."""


class Backlog:
    """A queue of blocks; the frames that do not fit are counted.

    `frames` and `dropped`: number of frames that wait, and of frames without room.  `bytes`: size
    of all blocks that wait.
    """

    def __init__(self, recording: str) -> None:
        self.dropped = self.frames = self.bytes = 0
        self._recording = recording
        self._waiting: deque[tuple[Pending, float]] = deque()
        self._gap: Gap | None = None

    def __len__(self) -> int:
        return len(self._waiting)

    def since_s(self) -> float | None:
        """Return the time at which the oldest block was added, s; None if there is none."""
        return self._waiting[0][1] if self._waiting else None

    def put(self, block: Pending, now_s: float) -> None:
        """Append a block, or count its frames as dropped."""
        # Additional bytes for events: they are few, and runs depend on them.
        room = HELD_BYTES if block.frames else HELD_BYTES + 4_000_000
        # After a drop all frames are dropped until the disk takes blocks again, so that one event
        # reports one gap.
        if self.bytes + len(block.content) > room or (self._gap is not None and block.frames):
            gap = self._gap or Gap(self._recording, block.number, block.number, 0)
            # Blocks of events between them are stored; the reader ignores this.
            self._gap = replace(gap, stop=block.number + 1, frames=gap.frames + block.frames)
            self.dropped += block.frames
            return
        self._waiting.append((block, now_s))
        self.bytes += len(block.content) + _OVERHEAD_BYTES
        self.frames += block.frames

    def first(self, size: int) -> Sequence[Pending]:
        """Return the oldest blocks, at least one and about `size` bytes, without removing them."""
        blocks: list[Pending] = []
        total = 0
        for block, _ in self._waiting:
            total += len(block.content)
            if blocks and total > size:
                break
            blocks.append(block)
        return blocks

    def remove(self, count: int) -> None:
        """Remove the oldest blocks, which are on the disk."""
        for _ in range(count):
            block, _ = self._waiting.popleft()
            self.bytes -= len(block.content) + _OVERHEAD_BYTES
            self.frames -= block.frames

    def take_gap(self) -> Gap | None:
        """Return the gap of blocks dropped since the last call, None if there is none."""
        gap, self._gap = self._gap, None
        return gap
