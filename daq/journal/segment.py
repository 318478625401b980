"""Writes one file of the journal: an MCAP file without chunks, each write synced.

After `Segment.write` has returned, neither a kill nor a power cut loses the blocks.  After the
first write error a file is not touched again: a repeated write in the same file leaves holes in
data that were reported as written.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from io import FileIO
from pathlib import Path
from typing import IO, Protocol, cast

from mcap.writer import IndexType, Writer

from ..bench.config import RecorderConfig
from ..files import sync_data, sync_folder
from .format import (
    BENCH_NAME,
    DBC_NAME,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    HEAD_RECORD,
    PROFILE,
    Gap,
    JournalHead,
    sealed_path,
    segment_number,
    unpack_events,
)
from .records import SUMMARY_RECORD, Summary, pack_summary


class JournalFile(Protocol):
    """The operations of a file that a segment uses."""

    def write(self, data: memoryview, /) -> int | None:
        """Write a part of `data` and return the number of bytes written."""

    def sync(self) -> None:
        """Return when all data written are on the disk."""

    def stat(self) -> os.stat_result:
        """Return the state of the open file."""

    def close(self) -> None:
        """Close the file."""


class SyncedFile(FileIO):
    """A new file, without a buffer."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "xb")

    def sync(self) -> None:
        """Return when all data written are on the disk."""
        sync_data(self.fileno())

    def stat(self) -> os.stat_result:
        """Return the state of the open file."""
        return os.fstat(self.fileno())


@dataclass(frozen=True, slots=True)
class Block:
    """A message to be written."""

    number: int
    """Its number in the recording."""
    topic: str
    """`FRAMES_TOPIC` or `EVENTS_TOPIC`."""
    t_ns: int
    """Latest time stamp up to the block, ns."""
    message: bytes
    """The packed message."""
    frames: int
    """Number of frames in it."""
    first_ns: int = 0
    """Earliest time stamp in it, ns; 0 without frames."""


class Segment:
    """A file of the journal.

    `file`: new and empty; closed here.  `path`: its path; deleted again if the head cannot be
    written.  After the last write it is renamed to `names.sealed_path`.  `record`: from
    `head_record`.  Raises OSError if the head cannot be written.
    """

    def __init__(
        self, file: JournalFile, path: Path, record: dict[str, str], head: JournalHead
    ) -> None:
        self.path = path
        self.file = file
        self.first: int | None = None
        self._stop = self._frames = self._first_ns = self._last_ns = 0
        self._events: list[bytes] = []
        self._stream = _Unbuffered(file)
        self._writer = Writer(
            cast(IO[bytes], self._stream), use_chunking=False, index_types=IndexType.METADATA
        )
        try:
            self._writer.start(PROFILE, head.software)
            self._channels = {
                FRAMES_TOPIC: self._writer.register_channel(FRAMES_TOPIC, "bumpbench-frames-1", 0),
                EVENTS_TOPIC: self._writer.register_channel(EVENTS_TOPIC, "json", 0),
            }
            for _ in range(2):  # one may be damaged
                self._writer.add_metadata(HEAD_RECORD, record)
                for name, text in ((BENCH_NAME, head.bench_text), (DBC_NAME, head.dbc_text)):
                    self._writer.add_attachment(0, head.wall_ns, name, "text/plain", text.encode())
            file.sync()
            sync_folder(path.parent)
        except OSError:
            self.discard()
            raise

    @property
    def size(self) -> int:
        """Number of bytes written."""
        return self._stream.size

    def write(self, blocks: Sequence[Block]) -> None:
        """Write blocks through to the disk.

        Raises OSError if the write failed; then nothing else may be written to this file.
        """
        for block in blocks:
            self._writer.add_message(
                self._channels[block.topic],
                block.t_ns,
                block.message,
                block.t_ns,
                sequence=block.number & 0xFFFF_FFFF,
            )
        self.file.sync()
        for block in blocks:
            self._note(block)

    def finish(self) -> None:
        """Write the end that MCAP tools expect, and close.

        Raises OSError if the end is not on the disk; the file is closed, and all blocks are in it.
        """
        try:
            self._writer.add_metadata(SUMMARY_RECORD, pack_summary(self._summary()))
            self._writer.finish()
            self.file.sync()
        finally:
            self._settle()

    def abandon(self) -> None:
        """Close the file as it is, and delete it if it has no block."""
        if self.first is None:
            self.discard()
        else:
            self._settle()

    def release(self) -> None:
        """Only close the file, because its name now belongs to another file."""
        with suppress(OSError):
            self.file.close()

    def _settle(self) -> None:
        """Close the file, and rename it as sealed."""
        with suppress(OSError):
            self.file.close()
        with suppress(OSError):  # the next recorder will rename it
            self.path = self.path.rename(sealed_path(self.path))

    def _note(self, block: Block) -> None:
        """Add a block that is on the disk to the summary."""
        if self.first is None:
            self.first = block.number
        self._stop = block.number + 1
        if block.topic == EVENTS_TOPIC:
            self._events.append(block.message)
        elif block.frames:
            self._frames += block.frames
            self._first_ns = min(self._first_ns or block.first_ns, block.first_ns)
            self._last_ns = max(self._last_ns, block.t_ns)

    def _summary(self) -> Summary:
        blocks = [unpack_events(message) for message in self._events]
        events = tuple((block.number, event) for block in blocks for event in block.events)
        first = self._stop if self.first is None else self.first
        return Summary(first, self._stop, self._frames, self._first_ns, self._last_ns, events)

    def discard(self) -> None:
        """Close and delete the file: nothing in it was reported as written."""
        with suppress(OSError):
            self.file.close()
        with suppress(OSError):
            self.path.unlink()


class _Unbuffered:
    """The stream of MCAP's writer, without a buffer that a later flush could lose."""

    def __init__(self, file: JournalFile) -> None:
        self._file = file
        self.size = 0

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:  # on an almost full disk a part is written without an error
            written = self._file.write(rest)
            if not written:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self.size += written
            rest = rest[written:]
        return len(data)

    def tell(self) -> int:
        return self.size


# Checks about once per second the free space on the disk and that the open file still exists ------

LOW_RESERVES = 10
"""Free space, as a multiple of the reserve, below which there is a warning."""
LOW_SHARE = 0.1
"""Free share of the disk below which there is also a warning."""
_RESUME_RESERVES = 1.05
"""Free space, as a multiple of the reserve, from which a stopped recording continues: more than
that at which it stops, so that it does not stop again at once."""


@dataclass(frozen=True, slots=True)
class Room:
    """Space on a disk, bytes."""

    free: int
    total: int


def room_on(folder: Path) -> Room:
    """Return the space on the disk of a folder.

    Raises OSError if the folder does not exist.
    """
    usage = shutil.disk_usage(folder)
    return Room(usage.free, usage.total)


def too_little(room: Room, limits: RecorderConfig, stopped: bool) -> bool:
    """Return whether recording must stop; `stopped`: True if it has already stopped."""
    reserves = _RESUME_RESERVES if stopped else 1.0
    return room.free < reserves * limits.reserve_bytes


def low_text(room: Room, limits: RecorderConfig) -> str:
    """Return a warning if there is little space, else an empty text."""
    if room.free < LOW_RESERVES * limits.reserve_bytes or room.free < LOW_SHARE * room.total:
        return (
            f"{room.free / 1e6:,.0f} MB ({room.free / max(room.total, 1):.0%}) left on the disk; "
            f"recording stops at {limits.reserve_bytes / 1e6:,.0f} MB"
        )
    return ""


def place_of(folder: Path) -> tuple[int, int] | None:
    """Return the identity of a folder: its disk and its number on it; None if it is gone."""
    try:
        found = folder.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def taken_away(path: Path, opened: os.stat_result, size: int) -> str:
    """Return what another process did to the open file, in words; empty if nothing.

    `opened`: state of the open file.  `size`: bytes written to it.
    """
    try:
        named = path.stat()
    except OSError:
        return "was deleted"
    if opened.st_nlink == 0 or (named.st_dev, named.st_ino) != (opened.st_dev, opened.st_ino):
        return "was replaced by another file"
    return "was truncated" if opened.st_size < size else ""


class DiskWatch:
    """Watches the disk of a journal: its space, and that folder and open file still exist.

    `room`: last measured space.  `stopped`: True while there is too little space to record.
    """

    def __init__(self, folder: Path, room_on: Callable[[Path], Room]) -> None:
        self.room = Room(0, 0)
        self.stopped = False
        self._folder = folder
        self._room_on = room_on
        self._place: tuple[int, int] | None = None

    def settle(self) -> None:
        """Take the folder that now has the name as the folder of the journal."""
        self._place = place_of(self._folder)

    def measure(self, limits: RecorderConfig) -> None:
        """Measure the space, and decide whether recording must stop.

        Raises OSError if the folder does not exist.
        """
        self.room = self._room_on(self._folder)
        self.stopped = too_little(self.room, limits, self.stopped)

    def taken_text(self, segment: Segment | None) -> str:
        """Return what another process did to folder or open segment, in words; empty if nothing."""
        if place_of(self._folder) != self._place:
            return f"folder {self._folder.name} was removed or its disk was unmounted"
        if segment is None:
            return ""
        try:
            text = taken_away(segment.path, segment.file.stat(), segment.size)
        except OSError as error:
            text = f"cannot be checked: {error.strerror or error}"
        return f"{segment.path.name} {text}" if text else ""


# Holds blocks in memory while the disk refuses them, and counts frames without room ---------------

HELD_BYTES = 32_000_000
"""Bytes of frames and events held in memory: a minute of four full buses."""
EVENT_BYTES = 4_000_000
"""Additional bytes for events: they are few, and runs depend on them."""
_OVERHEAD_BYTES = 400
"""Memory of a block in addition to its message, bytes."""


@dataclass(frozen=True, slots=True)
class _Held:
    block: Block
    since_s: float


class Backlog:
    """A queue of blocks; the frames that do not fit are counted.

    `frames` and `dropped`: number of frames that wait, and of frames without room.
    """

    def __init__(self, recording: str) -> None:
        self.dropped = 0
        self.frames = 0
        self._recording = recording
        self._held: deque[_Held] = deque()
        self._bytes = 0
        self._gap: Gap | None = None

    def __len__(self) -> int:
        return len(self._held)

    @property
    def bytes(self) -> int:
        """Size of all blocks that wait, bytes."""
        return self._bytes

    def since_s(self) -> float | None:
        """Return the time at which the oldest block was added, s; None if there is none."""
        return self._held[0].since_s if self._held else None

    def put(self, block: Block, now_s: float) -> None:
        """Append a block, or count its frames as dropped."""
        room = HELD_BYTES if block.frames else HELD_BYTES + EVENT_BYTES
        # After a drop all frames are dropped until the disk takes blocks again, so that one event
        # reports one gap.
        if self._bytes + len(block.message) > room or (self._gap is not None and block.frames):
            gap = self._gap or Gap(self._recording, block.number, block.number, 0)
            # Blocks of events between them are stored; the reader ignores this.
            self._gap = replace(gap, stop=block.number + 1, frames=gap.frames + block.frames)
            self.dropped += block.frames
            return
        self._held.append(_Held(block, now_s))
        self._bytes += len(block.message) + _OVERHEAD_BYTES
        self.frames += block.frames

    def first(self, size: int) -> Sequence[Block]:
        """Return the oldest blocks, at least one and about `size` bytes, without removing them."""
        blocks: list[Block] = []
        total = 0
        for held in self._held:
            if blocks and total + len(held.block.message) > size:
                break
            blocks.append(held.block)
            total += len(held.block.message)
        return blocks

    def remove(self, count: int) -> None:
        """Remove the oldest blocks, which are on the disk."""
        for _ in range(count):
            block = self._held.popleft().block
            self._bytes -= len(block.message) + _OVERHEAD_BYTES
            self.frames -= block.frames

    def take_gap(self) -> Gap | None:
        """Return the gap of blocks dropped since the last call, None if there is none."""
        gap, self._gap = self._gap, None
        return gap


# Records the blocks in each file, so that the loss of a file is reported exactly ------------------


class WriteLedger:
    """The blocks of a recording that are on the disk, by segment."""

    def __init__(self, recording: str) -> None:
        self._recording = recording
        self._spans: dict[Path, Gap] = {}

    @property
    def paths(self) -> tuple[Path, ...]:
        """The segments that have blocks, in order."""
        return tuple(sorted(self._spans, key=segment_number))

    def note(self, path: Path, blocks: Sequence[Block]) -> int:
        """Add blocks that are on the disk; return their number of frames."""
        frames = sum(block.frames for block in blocks)
        before = self._spans.get(path)
        first = before.first if before else blocks[0].number
        total = frames + (before.frames if before else 0)
        self._spans[path] = Gap(self._recording, first, blocks[-1].number + 1, total, path.name)
        return frames

    def rename(self, path: Path, now: Path) -> None:
        """Note that a segment has another name."""
        if path in self._spans:
            self._spans[now] = replace(self._spans.pop(path), file=now.name)

    def forget(self, path: Path) -> None:
        """Remove a segment that was deleted on purpose."""
        self._spans.pop(path, None)

    def take_gone(self, also: Path | None) -> dict[Path, Gap]:
        """Remove the segments that no longer exist; return their gaps by path.

        `also`: a segment that was replaced by another file.
        """
        gone = [path for path in self._spans if path == also or not path.is_file()]
        return {path: self._spans.pop(path) for path in gone}
