"""Packs, unpacks and finds the blocks of the journal's segments, and names the segments.

A journal is a sequence of segments `journal_0001.bbj`, `journal_0002.bbj`...; a segment is a
sequence of blocks, one every 100 ms.  Each block begins with a magic number, a checksum, its kind
and length, its running number, and the identity of its writer and its recording, so that it can be
read whatever has become of the bytes before it.  bench.toml and DBC stand in the first block of a
segment, in another a second later, and in the last one.
"""

from __future__ import annotations

import json
import os
import struct
import uuid
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, astuple, dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from ..bench.campaign import Origin
from ..bus.source import HopLosses
from ..files import open_regular
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


def content_bytes(header: bytes | memoryview) -> int | None:
    """Return the length of the content after a header; None if this is no header."""
    if len(header) < HEADER.size or header[: len(MAGIC)] != MAGIC:
        return None
    length: int = HEADER.unpack_from(header)[3]
    # Longest content of a block, bytes: a greater length is damage. The largest block of frames has
    # 6 MB, the largest DBC 5 MB.
    return length if length <= (64 << 20) else None


def unpack_block(stored: memoryview) -> Block | None:
    """Return the block in bytes from its magic number to its end; None if a bit was changed."""
    _, crc, kind, _, number, writer, identity = HEADER.unpack_from(stored)
    if zlib.crc32(stored[_CHECKED_FROM:]) != crc:
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


# Events that report what is missing ---------------------------------------------------------------

DISK_GAP = "disk_gap"
"""Code: neither the disk nor the memory had room."""
FILE_GONE = "file_gone"
"""Code: a file was deleted or replaced while it was written."""
RETENTION = "retention"
"""Code: the oldest segments were deleted on purpose to make room, which is not a loss."""
ENDED = "ended"
"""Code: the recorder ended the recording, which will not be resumed."""


@dataclass(frozen=True, slots=True)
class Gap:
    """A span of blocks that is missing from the journal.

    `recording`: identity of the recording.  `first`, `stop`: numbers of the first block and of the
    block after the last.  `frames`: number of frames in them.  `file`: name of the segment that
    contained them; empty if none did.
    """

    recording: str
    first: int
    stop: int
    frames: int
    file: str = ""


def gap_event(code: str, t_ns: int, gap: Gap) -> Event:
    """Return the event that reports a gap; its value is the number of frames."""
    return Event(t_ns, code, gap.frames, json.dumps(asdict(gap)))


def parse_gap(event: Event) -> Gap | None:
    """Return the gap that an event reports; None if it is another event."""
    if event.code not in (DISK_GAP, FILE_GONE, RETENTION):
        return None
    return Gap(**json.loads(event.text))


# Names of segments, which show which of them never change again -----------------------------------

SUFFIX = ".bbj"
SEALED, OPEN = f"journal_*{SUFFIX}", f"open_*{SUFFIX}"
"""Patterns of the names of segments that never change again, and of the one being written."""


def open_path(folder: Path, number: int) -> Path:
    """Return the path of a segment while it is written."""
    return folder / f"open_{number:04d}{SUFFIX}"


def sealed_path(path: Path) -> Path:
    """Return the path of a segment after it was written; the same path if it is sealed already."""
    number = path.name.removeprefix("open_")
    return path if number == path.name else path.with_name(f"journal_{number}")


def segment_number(path: Path) -> int:
    """Return the number in a segment's name, 0 if there is none."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0


def session_name(first_segment: int) -> str:
    """Return the name of a recording's session file, from the number of its first segment."""
    return f"session_{first_segment:04d}.h5"


# Reads one segment --------------------------------------------------------------------------------

ADVICE = "move it away, and name the recorder's own files journal_*.bbj"
_READ_BYTES = 1 << 20
"""Number of bytes read at once: more is not faster."""
_END_BYTES = (1 << 16, 1 << 24)
"""Numbers of bytes at the end of a file in which its last block is searched, the likely first."""


class Damage(NamedTuple):
    """A part of a segment that is no whole block.

    `offset`, `bytes`: where it begins, and its length.  `at_end`: True if no whole block follows.
    `kind`: in the header with which it begins; 0 if there is none.
    """

    offset: int
    bytes: int
    at_end: bool
    kind: int


class SegmentFile:
    """An open segment; a context manager that closes it.

    `size`: when it was opened, bytes; later data are not read.  `fault`: why the disk could not
    read a part of it; empty if it could.  Raises InputError if it is not a regular file or cannot
    be opened.
    """

    def __init__(self, path: Path) -> None:
        # Its writer may have finished and renamed it since it was listed.
        self.path = path if os.path.lexists(path) else sealed_path(path)
        self._fd = open_regular(self.path, ADVICE)
        self.size = os.fstat(self._fd).st_size
        self.fault = ""
        self._piece, self._from = b"", 0  # bytes of the file, and their offset

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._fd)

    def end(self) -> Block | None:
        """Return the last block of a sealed segment; None if it has no proper end."""
        for wanted in _END_BYTES:
            start = max(0, self.size - wanted)
            tail = self._bytes(start, self.size - start)
            offset = bytes(tail).rfind(MAGIC)
            if offset >= 0:
                block = self._block(start + offset)
                whole = block is not None and start + offset + _stored_bytes(block) == self.size
                return block if whole and block is not None and block.kind == Kind.END else None
        return None

    def blocks(self) -> Iterator[Block | Damage]:
        """Yield the whole blocks in order, and what is damaged before, between and after them."""
        offset = whole = 0  # where a block may begin, and where the last whole one ends
        while offset < self.size:
            block = self._block(offset)
            if block is None:
                offset = self._next_magic(offset + 1)
                continue
            if offset > whole:
                yield self._damage(whole, offset)
            offset = whole = offset + _stored_bytes(block)
            yield block
        if whole < self.size:
            yield self._damage(whole, self.size)

    def _block(self, offset: int) -> Block | None:
        header = self._bytes(offset, HEADER.size)
        length = content_bytes(header)
        if length is None or offset + HEADER.size + length > self.size:
            return None
        stored = self._bytes(offset, HEADER.size + length)
        return unpack_block(stored) if len(stored) == HEADER.size + length else None

    def _damage(self, start: int, stop: int) -> Damage:
        header = self._bytes(start, HEADER.size)
        kind = HEADER.unpack(header)[2] if content_bytes(header) is not None else 0
        return Damage(start, stop - start, stop == self.size, kind)

    def _next_magic(self, offset: int) -> int:
        """Return the offset of the next magic number; the size of the file if there is none."""
        while offset < self.size:
            if not self._from <= offset <= self._from + len(self._piece) - len(MAGIC):
                self._load(offset, _READ_BYTES)
            place = self._piece.find(MAGIC, offset - self._from)
            if place >= 0:
                return self._from + place
            offset = self._from + max(len(self._piece), _READ_BYTES) - len(MAGIC) + 1
        return self.size

    def _bytes(self, offset: int, size: int) -> memoryview:
        """Return bytes of the file; fewer at its end, or if the disk fails."""
        if not self._from <= offset <= self._from + len(self._piece) - size:
            self._load(offset, max(size, _READ_BYTES))
        return memoryview(self._piece)[offset - self._from :][:size]

    def _load(self, offset: int, size: int) -> None:
        parts = []
        self._from = offset
        while size > 0:
            try:
                os.lseek(self._fd, offset, os.SEEK_SET)  # Windows has no pread
                part = os.read(self._fd, size)
            except OSError as error:
                self.fault = f"cannot be read ({error.strerror or error})"
                break
            if not part:
                break
            parts.append(part)
            offset, size = offset + len(part), size - len(part)
        self._piece = b"".join(parts)


def _stored_bytes(block: Block) -> int:
    return HEADER.size + len(block.content)
