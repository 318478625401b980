"""Writes and reads one segment of the journal: a file of blocks, each write synced.

A journal is a sequence of segments `journal_0001.bbj`, `journal_0002.bbj`...; a segment is a
sequence of blocks, one every 100 ms.  Each block begins with a magic number, a checksum, its kind
and length, its running number, and the identity of its writer and its recording, so that it can be
read whatever has become of the bytes before it.  bench.toml and DBC stand in the first block of a
segment, in another a second later, and in the last one.

After `Segment.write` has returned, neither a kill nor a power cut loses the blocks.  After the
first write error a file is not touched again: a repeated write would leave holes in it.
"""

from __future__ import annotations

import errno
import json
import os
import struct
import uuid
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, astuple, dataclass, field, replace
from enum import IntEnum
from io import FileIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch
from dbc.words import InputError

from ..bench.campaign import Origin
from ..bus.source import HopLosses
from ..files import sync_data, sync_folder
from ..runs import Event

# Blocks -------------------------------------------------------------------------------------------

MAGIC = b"\xb5BUMP\r\n\x01"
"""The first bytes of each block."""
HEADER = struct.Struct("<8sIIIQQ16s")
"""Magic, CRC-32 of all after it, kind, bytes of the content, number, writer, recording."""
_CHECKED_FROM = 12
"""Position in a block from which its checksum is calculated, bytes."""
_FRAMES = struct.Struct("<II4Q")
"""Number of frames, width of their payloads in bytes, `HopLosses`."""
_COLUMNS = {"t_ns": "<i8", "can_id": "<u4", "flags": "<u2", "bus": "u1", "length": "u1"}
"""Types of the columns of frames, in the order in which they follow that; then the payloads."""


class Kind(IntEnum):
    """Kinds of blocks."""

    HEAD = 1
    """The content that a segment needs to be read: a `JournalHead`."""
    FRAMES = 2
    EVENTS = 3
    END = 4
    """The head again and a summary of the segment, whose last block it is."""


@dataclass(frozen=True, slots=True)
class JournalHead:
    """The facts on a recording that each of its segments states.

    `bench_text`, `dbc_text`: bench.toml and DBC in full.  `software`: name and version of the
    writer.  `wall_ns`, `monotonic_ns`: the host's clocks, read together when the recording was
    begun or resumed.  `recording`: its identity, 32 hexadecimal digits, kept when it is resumed.
    `first_segment`: number of its first segment, also after that was deleted.  `campaign`: False
    for a recording between two campaigns, which has no runs.  `origin`: an `Origin`, of the frames.
    """

    bench_text: str
    dbc_text: str
    software: str
    wall_ns: int
    monotonic_ns: int
    recording: str = field(default_factory=lambda: uuid.uuid4().hex)
    first_segment: int = 1
    campaign: bool = True
    origin: str = Origin.REAL

    @property
    def session_name(self) -> str:
        """Name of the recording's session file."""
        return f"session_{self.first_segment:04d}.h5"


@dataclass(frozen=True, slots=True)
class Summary:
    """The content of a segment, without its frames.

    `first`, `stop`: number of its first block, and of the block after its last.  `frames`: number
    of frames.  `first_ns`, `last_ns`: earliest and latest time stamp, ns; 0 without frames.
    `events`: in order, each with the number of its block.
    """

    first: int
    stop: int
    frames: int = 0
    first_ns: int = 0
    last_ns: int = 0
    events: tuple[tuple[int, Event], ...] = ()

    def extended(self, blocks: Sequence[Block]) -> Summary:
        """Return the summary with more blocks of frames or events, in order; as it is if none."""
        if not blocks:
            return self
        span_ns = np.array([self.first_ns, self.last_ns] if self.frames else [], np.int64)
        stamps_ns = np.concatenate([span_ns, *(block.t_ns for block in blocks)])
        return Summary(
            first=self.first if self.stop > self.first else blocks[0].number,
            stop=blocks[-1].number + 1,
            frames=self.frames + sum(block.size for block in blocks),
            first_ns=int(stamps_ns.min()) if len(stamps_ns) else 0,
            last_ns=int(stamps_ns.max()) if len(stamps_ns) else 0,
            events=(*self.events, *((b.number, event) for b in blocks for event in b.events)),
        )


class Block(NamedTuple):  # a frozen dataclass takes four times as long to make
    """A block whose checksum matches.

    `number`: in the recording; of a head or an end that of the next block.  `writer`: the process
    that wrote it, as `JournalHead.wall_ns`.  `recording`: its identity.  `content`: without header.
    """

    kind: int
    number: int
    writer: int
    recording: str
    content: bytes | memoryview

    @property
    def stored(self) -> bytes:
        """The block as it is stored."""
        identity = bytes.fromhex(self.recording)
        header_fields = self.kind, len(self.content), self.number, self.writer, identity
        header = HEADER.pack(MAGIC, 0, *header_fields)[_CHECKED_FROM:]
        crc = zlib.crc32(self.content, zlib.crc32(header))
        return b"".join((MAGIC, crc.to_bytes(4, "little"), header, self.content))

    @property
    def size(self) -> int:
        """Number of its frames."""
        return int(_FRAMES.unpack_from(self.content)[0]) if self.kind == Kind.FRAMES else 0

    @property
    def losses(self) -> HopLosses:
        """Losses that the process which wrote this block of frames has counted up to it."""
        return HopLosses(*_FRAMES.unpack_from(self.content)[2:])

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Time stamps of its frames, ns, shape (size,)."""
        if not self.size:
            return np.zeros(0, np.int64)
        return np.frombuffer(self.content, "<i8", self.size, _FRAMES.size)

    @property
    def frames(self) -> FrameBatch:
        """Its frames, unpacked at each access."""
        if not self.size:
            return FrameBatch.empty()
        n_frames, width, *_ = _FRAMES.unpack_from(self.content)
        columns, offset = {}, _FRAMES.size
        for name, dtype in {**_COLUMNS, "data": f"({width},)u1"}.items():
            # A copy is aligned, and does not keep the whole piece of the file in memory.
            columns[name] = np.frombuffer(self.content, dtype, n_frames, offset).copy()
            offset += columns[name].nbytes
        return FrameBatch(**columns)

    @property
    def events(self) -> tuple[Event, ...]:
        """Its events."""
        if self.kind != Kind.EVENTS:
            return ()
        return tuple(Event(*fields) for fields in json.loads(bytes(self.content)))

    @property
    def head(self) -> tuple[JournalHead, Summary]:
        """The head in a block of kind HEAD or END, and the summary in the latter."""
        fields = json.loads(bytes(self.content))
        summary = fields.pop("summary", {"first": self.number, "stop": self.number, "events": ()})
        events = tuple((number, Event(*event)) for number, *event in summary.pop("events"))
        return JournalHead(**fields), Summary(**summary, events=events)


# Reads one segment --------------------------------------------------------------------------------

ADVICE = "move it away, and name the recorder's own files journal_*.bbj"


def segment_number(path: Path) -> int:
    """Return the number in a segment's name, 0 if there is none."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0


def read_segment(path: Path) -> tuple[list[Block], int]:
    """Return the whole blocks of a segment as it is now, and the number of bytes after them.

    That number is 0 if those bytes begin a head or an end, with which nothing is lost.  Raises
    InputError if the file cannot be read.
    """
    data = _last_bytes(path)
    view, blocks = memoryview(data), []
    offset = whole_bytes = 0  # where a block may begin; size up to the end of the last whole one
    while 0 <= offset < len(data):
        block = _block_at(view, offset)
        if block is None:
            offset = data.find(MAGIC, offset + 1)
        else:
            offset = whole_bytes = offset + HEADER.size + len(block.content)
            blocks.append(block)
    torn_bytes = len(data) - whole_bytes
    begins_block = torn_bytes >= HEADER.size and data.startswith(MAGIC, whole_bytes)
    if begins_block and HEADER.unpack_from(data, whole_bytes)[2] in (Kind.HEAD, Kind.END):
        torn_bytes = 0
    return blocks, torn_bytes


def _block_at(data: memoryview, offset: int) -> Block | None:
    """Return the block that begins at an offset; None if none does, or a bit of it was changed."""
    header = data[offset : offset + HEADER.size]
    if len(header) < HEADER.size or header[: len(MAGIC)] != MAGIC:
        return None
    _, crc, kind, length, number, writer, identity = HEADER.unpack(header)
    stored = data[offset : offset + HEADER.size + length]
    if len(stored) < HEADER.size + length or zlib.crc32(stored[_CHECKED_FROM:]) != crc:
        return None
    return Block(kind, number, writer, identity.hex(), stored[HEADER.size :])


def end_of(path: Path) -> Block | None:
    """Return the block with which a sealed segment ends; None if it has no proper end."""
    for n_bytes in (1 << 16, 1 << 24):  # most ends are short
        data = _last_bytes(path, n_bytes)
        offset = data.rfind(MAGIC)
        if offset >= 0:
            block = _block_at(memoryview(data), offset)
            if block is None or block.kind != Kind.END:
                return None
            stop = offset + HEADER.size + len(block.content)
            return block if stop == len(data) else None
    return None


def _last_bytes(path: Path, n_bytes: int | None = None) -> bytes:
    """Return the last bytes of a file; None: all."""
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            file.seek(0 if n_bytes is None else max(size - n_bytes, 0))
            return file.read()
    except OSError as error:
        what = f"cannot be read ({error.strerror or error})"
        raise InputError(str(path), what, ADVICE) from error


# Writes one segment -------------------------------------------------------------------------------

ENDED = "ended"
"""Code of the event with which the recorder ends a recording, which will not be resumed."""


def pack_events(events: Sequence[Event]) -> bytes:
    """Return the content of a block of kind EVENTS."""
    return json.dumps([astuple(event) for event in events]).encode()


def pack_frames(frames: FrameBatch, losses: HopLosses) -> bytes:
    """Return the content of a block of kind FRAMES; `losses`: counted up to it."""
    columns = (getattr(frames, name).astype(dtype).tobytes() for name, dtype in _COLUMNS.items())
    sizes = _FRAMES.pack(len(frames), frames.data.shape[1], *losses)
    return b"".join((sizes, *columns, frames.data.tobytes()))


class SyncedFile(FileIO):
    """A new file, without a buffer."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "xb")

    def sync(self) -> None:
        """Return when all data written are on the disk."""
        sync_data(self.fileno())


class Segment:
    """A file of the journal.

    `file`: new and empty; closed here.  `path`: its path; deleted again if the head cannot be
    written.  `number`: of its first block.  `summary`: of its blocks on the disk.  `size`: bytes
    written.  Raises OSError if the head cannot be written.
    """

    def __init__(self, file: SyncedFile, path: Path, head: JournalHead, number: int) -> None:
        self.path, self.file, self.size = path, file, 0
        self.summary = Summary(number, number)
        self._head = head
        self._identity = os.fstat(file.fileno())
        try:
            self._write([self._head_block(Kind.HEAD, number)])
            sync_folder(path.parent)
        except OSError:
            self.abandon()
            raise

    @property
    def is_empty(self) -> bool:
        """True if it has no block on the disk."""
        return self.summary.stop == self.summary.first

    @property
    def is_in_place(self) -> bool:
        """False if another process removed or replaced the file."""
        try:
            return os.path.samestat(self.path.stat(), self._identity)
        except OSError as error:
            return error.errno not in (errno.ENOENT, errno.ENOTDIR)

    def write(self, blocks: Sequence[Block]) -> None:
        """Write blocks through to the disk.

        Raises OSError if the write failed; then nothing else may be written to this file.
        """
        old, new = self.summary, self.summary.extended(blocks)
        # The head is repeated after 10 blocks, about a second: then no damage to the beginning of a
        # segment that never got its end costs all of it.
        if old.stop - old.first < 10 <= new.stop - new.first:
            blocks = [*blocks, self._head_block(Kind.HEAD, new.stop)]
        self._write(blocks)
        self.summary = new

    def finish(self) -> None:
        """Write the end, which makes the segment quick to scan, and close.

        Raises OSError if the end is not on the disk; the file is closed, and all blocks are in it.
        """
        events = [[number, *astuple(event)] for number, event in self.summary.events]
        summary = {**asdict(replace(self.summary, events=())), "events": events}
        try:
            self._write([self._head_block(Kind.END, self.summary.stop, summary=summary)])
        finally:
            self._close()

    def abandon(self) -> None:
        """Close the file as it is; delete it if nothing in it was reported as written."""
        if self.is_empty and self.is_in_place:
            with suppress(OSError):
                self.path.unlink()
        self._close()

    def _close(self) -> None:
        with suppress(OSError):
            self.file.close()
        self.summary = replace(self.summary, events=())  # a recorder keeps thousands of segments

    def _head_block(self, kind: Kind, number: int, **more: Any) -> Block:
        """Return a block with the head, and more fields; `number`: of the block after it."""
        content = json.dumps({**asdict(self._head), **more}).encode()
        return Block(kind, number, self._head.wall_ns, self._head.recording, content)

    def _write(self, blocks: Sequence[Block]) -> None:
        """Return when blocks are on the disk; raises OSError."""
        view = memoryview(b"".join(block.stored for block in blocks))
        while view:  # on an almost full disk a part is written without an error
            written = self.file.write(view)
            if not written:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self.size += written
            view = view[written:]
        self.file.sync()
