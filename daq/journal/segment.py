"""Writes and reads one segment of the journal: a file of blocks, each write synced.

A journal is a sequence of segments `journal_0001.bbj`, `journal_0002.bbj`...; a segment is a
sequence of blocks, one every 100 ms.  Each block begins with a magic number, a checksum, its kind
and length, its running number, and the identity of its writer and its recording, so that it can be
read whatever has become of the bytes before it.  bench.toml and DBC stand in the first block of a
segment, in another a second later, and in the last one.

After `Segment.write` has returned, neither a kill nor a power cut loses the blocks.  After the
first write error a file is not touched again: a repeated write in the same file leaves holes in
data that were reported as written.
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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch
from dbc.words import InputError, counted

from ..bench.campaign import Origin
from ..bus.source import HopLosses
from ..files import sync_data, sync_folder
from ..runs import Event

# Blocks -------------------------------------------------------------------------------------------

MAGIC = b"\xb5BUMP\r\n\x01"
"""The first bytes of each block."""
HEADER = struct.Struct("<8sIIIQQ16s")
"""Magic, CRC-32 of all that follows it, kind, length of the content in bytes, number, writer,
recording."""
_CHECKED_FROM = 12
"""Position in a block from which its checksum is calculated, bytes."""
_FRAMES = struct.Struct("<II4Q")  # frames, payload width, HopLosses
_FORMS = {"t_ns": "<i8", "can_id": "<u4", "flags": "<u2", "bus": "u1", "length": "u1"}
_COLUMNS = tuple((name, np.dtype(form)) for name, form in _FORMS.items())
_PAYLOADS = {width: np.dtype((np.uint8, width)) for width in (8, 64)}


class Kind(IntEnum):
    """Kinds of blocks."""

    HEAD = 1
    """The content that a segment needs to be read: a `JournalHead`."""
    FRAMES = 2
    EVENTS = 3
    END = 4
    """The head again and a summary of the segment, whose last block it is."""


class Block(NamedTuple):  # a frozen dataclass takes four times as long to make
    """A block whose checksum matches.

    `number`: in the recording; of a head or an end that of the next block.  `writer`: the process
    that wrote it, as `JournalHead.wall_ns`.  `recording`: its identity.  `content`: the bytes after
    the header.
    """

    kind: int
    number: int
    writer: int
    recording: str
    content: bytes | memoryview


def pack_block(block: Block) -> bytes:
    """Return a block as it is stored."""
    identity = bytes.fromhex(block.recording)
    header = HEADER.pack(
        MAGIC, 0, block.kind, len(block.content), block.number, block.writer, identity
    )
    crc = zlib.crc32(block.content, zlib.crc32(header[_CHECKED_FROM:]))
    return b"".join((MAGIC, crc.to_bytes(4, "little"), header[_CHECKED_FROM:], block.content))


def block_at(data: memoryview, offset: int) -> Block | None:
    """Return the block that begins at an offset; None if none does, or a bit of it was changed."""
    header = data[offset : offset + HEADER.size]
    if len(header) < HEADER.size or header[: len(MAGIC)] != MAGIC:
        return None
    _, crc, kind, length, number, writer, identity = HEADER.unpack(header)
    stored = data[offset : offset + HEADER.size + length]
    if len(stored) < HEADER.size + length or zlib.crc32(stored[_CHECKED_FROM:]) != crc:
        return None
    return Block(kind, number, writer, identity.hex(), stored[HEADER.size :])


# Contents of blocks -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class JournalHead:
    """The facts on a recording that each of its segments states.

    `bench_text`, `dbc_text`: bench.toml and DBC in full.  `software`: name and version of the
    writer.  `wall_ns`, `monotonic_ns`: the host's clocks, read together when the recording was
    begun or resumed.  `recording`: its identity, 32 hexadecimal digits, kept when it is resumed.
    `first_segment`: number of its first segment, which names the session file, also after that
    segment was deleted.  `campaign`: False for a recording between two campaigns, which has no
    runs.  `origin`: of the frames, a value of `Origin`.
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


def pack_head(head: JournalHead, summary: Summary | None = None) -> bytes:
    """Return the content of a block of kind HEAD or, with a summary, END."""
    if summary is None:
        return json.dumps(asdict(head)).encode()
    events = [[number, *astuple(event)] for number, event in summary.events]
    return json.dumps({**asdict(head), "summary": {**asdict(summary), "events": events}}).encode()


def unpack_head(content: bytes | memoryview) -> tuple[JournalHead, Summary | None]:
    """Return the head in a block of kind HEAD or END, and the summary of the latter."""
    fields = json.loads(bytes(content))
    summary = fields.pop("summary", None)
    if summary is not None:
        events = tuple((number, Event(*event)) for number, *event in summary.pop("events"))
        summary = Summary(**summary, events=events)
    return JournalHead(**fields), summary


def pack_events(events: Sequence[Event]) -> bytes:
    """Return the content of a block of kind EVENTS."""
    return json.dumps([astuple(event) for event in events]).encode()


def unpack_events(content: bytes | memoryview) -> tuple[Event, ...]:
    """Return the events in a block of kind EVENTS."""
    return tuple(Event(*fields) for fields in json.loads(bytes(content)))


def pack_frames(frames: FrameBatch, losses: HopLosses) -> bytes:
    """Return the content of a block of kind FRAMES; `losses`: counted up to it."""
    return b"".join(
        [
            _FRAMES.pack(len(frames), frames.data.shape[1], *losses),
            *(getattr(frames, name).astype(form).tobytes() for name, form in _COLUMNS),
            frames.data.tobytes(),
        ]
    )


class JournalBlock(NamedTuple):
    """A block of a recording as read: `size` frames, unpacked only on access, or `events`.

    `losses`: counted up to the block.  `content`: from `pack_frames`; empty if it holds events.
    """

    losses: HopLosses
    size: int = 0
    content: bytes | memoryview = b""
    events: tuple[Event, ...] = ()

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Time stamps of the frames, ns, shape (size,)."""
        if not self.size:
            return np.zeros(0, np.int64)
        return np.frombuffer(self.content, "<i8", self.size, _FRAMES.size)

    @property
    def frames(self) -> FrameBatch:
        """The frames."""
        if not self.size:
            return FrameBatch.empty()
        width = _FRAMES.unpack_from(self.content)[1]
        columns, begin = {}, _FRAMES.size
        for name, form in (*_COLUMNS, ("data", _PAYLOADS[width])):
            # A copy is aligned, and does not keep the whole piece of the file in memory.
            columns[name] = np.frombuffer(self.content, form, self.size, begin).copy()
            begin += form.itemsize * self.size
        return FrameBatch(**columns)


def unpack_frames(content: bytes | memoryview) -> JournalBlock:
    """Return a block of kind FRAMES, with the losses counted by the process that wrote it."""
    size, _, *counts = _FRAMES.unpack_from(content)
    return JournalBlock(HopLosses(*counts), size, content)


# Names of segments --------------------------------------------------------------------------------

ENDED = "ended"
"""Code of the event with which the recorder ends a recording, which will not be resumed."""
PATTERNS = ("journal_*.bbj", "open_*.bbj")
"""Patterns of the names of segments; until November 2026 that being written was an open one."""


def segment_path(folder: Path, number: int) -> Path:
    """Return the path of a segment."""
    return folder / f"journal_{number:04d}.bbj"


def segment_number(path: Path) -> int:
    """Return the number in a segment's name, 0 if there is none."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0


def session_name(first_segment: int) -> str:
    """Return the name of a recording's session file, from the number of its first segment."""
    return f"session_{first_segment:04d}.h5"


# Writes one segment -------------------------------------------------------------------------------


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
    written.  `number`: of its first block.  `summary`: of its blocks on the disk.  `size`: bytes
    written.  Raises OSError if the head cannot be written.
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
        self._events.clear()

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


# Reads one segment --------------------------------------------------------------------------------

ADVICE = "move it away, and name the recorder's own files journal_*.bbj"


class SegmentContent(NamedTuple):
    """The readable part of a segment.

    `blocks`: the whole ones, in order.  `torn_bytes`, `torn_text`: number of bytes after them that
    are no whole block, and what they are in words; 0 and empty also if they were a head or an end,
    with which nothing is lost.
    """

    blocks: tuple[Block, ...]
    torn_bytes: int
    torn_text: str


def read_segment(path: Path) -> SegmentContent:
    """Return the content of a segment as it is now; its writer may go on.

    Raises InputError if it is not a regular file or cannot be opened.
    """
    data = _last_bytes(path)
    view, blocks = memoryview(data), []
    offset = end = 0  # where a block may begin, and where the last whole one ends
    while 0 <= offset < len(data):
        block = block_at(view, offset)
        if block is None:
            offset = data.find(MAGIC, offset + 1)
        else:
            offset = end = offset + _stored_bytes(block)
            blocks.append(block)
    torn = len(data) - end
    is_headed = torn >= HEADER.size and data.startswith(MAGIC, end)
    if not torn or (is_headed and HEADER.unpack_from(data, end)[2] in (Kind.HEAD, Kind.END)):
        return SegmentContent(tuple(blocks), 0, "")
    text = f"{path.name}: {counted(torn, 'byte')} from byte {end} are no whole block"
    return SegmentContent(tuple(blocks), torn, text)


def last_block(path: Path) -> Block | None:
    """Return the block with which a sealed segment ends; None if it has no proper end.

    Raises InputError as `read_segment`.
    """
    for wanted in (1 << 16, 1 << 24):  # most ends are short
        data = _last_bytes(path, wanted)
        offset = data.rfind(MAGIC)
        if offset >= 0:
            block = block_at(memoryview(data), offset)
            is_end = block is not None and block.kind == Kind.END
            if block is None or not is_end or offset + _stored_bytes(block) != len(data):
                return None
            return block
    return None


def _last_bytes(path: Path, wanted: int | None = None) -> bytes:
    """Return the last bytes of a file; None: all."""
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            file.seek(0 if wanted is None else max(size - wanted, 0))
            return file.read()
    except OSError as error:
        what = f"cannot be read ({error.strerror or error})"
        raise InputError(str(path), what, ADVICE) from error


def _stored_bytes(block: Block) -> int:
    return HEADER.size + len(block.content)
