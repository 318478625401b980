"""Packs and unpacks the blocks of the journal's segments, and names the segments.

A journal is a sequence of segments `journal_0001.bbj`, `journal_0002.bbj`...; a segment is a
sequence of blocks, one every 100 ms.  Each block begins with a magic number, a checksum, its kind
and length, its running number, and the identity of its writer and its recording, so that it can be
read whatever has become of the bytes before it.  bench.toml and DBC stand in the first block of a
segment, in another a second later, and in the last one.
"""

from __future__ import annotations

import json
import struct
import uuid
import zlib
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from ..bench.campaign import Origin
from ..bus.source import HopLosses
from ..runs import Event

# Blocks -------------------------------------------------------------------------------------------

MAGIC = b"\xb5BUMP\r\n\x01"
"""The first bytes of each block."""
HEADER = struct.Struct("<8sIIIQQ16s")
"""Magic, CRC-32 of all that follows it, kind, length of the content in bytes, number, writer,
recording."""
_CHECKED_FROM = 12
"""Position in a block from which its checksum is calculated, bytes."""
LARGEST_BYTES = 64 << 20
"""Longest content of a block, bytes: a greater length is damage.  The largest block of frames has
6 MB, the largest DBC 5 MB."""
_FRAMES = struct.Struct("<II4Q")  # frames, payload width, HopLosses
_FORMS = {"t_ns": "<i8", "can_id": "<u4", "flags": "<u2", "bus": "u1", "length": "u1"}
_COLUMNS = tuple((name, np.dtype(form)) for name, form in _FORMS.items())
_PAYLOADS = {width: np.dtype((np.uint8, width)) for width in (8, 64)}
_FRAME_BYTES = sum(form.itemsize for _, form in _COLUMNS)


class Kind(IntEnum):
    """Kinds of blocks."""

    HEAD = 1
    """What a segment needs to be read: a `JournalHead`."""
    FRAMES = 2
    EVENTS = 3
    END = 4
    """The head again and a summary of the segment, whose last block it is."""


class Block(NamedTuple):  # a frozen dataclass takes four times as long to make
    """A block whose checksum matches."""

    kind: int
    number: int
    """Its number in the recording; of a head or an end that of the next block."""
    writer: int
    """The process that wrote it: `JournalHead.wall_ns`."""
    recording: str
    """Identity of the recording."""
    content: bytes | memoryview
    """The bytes after the header."""


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
    return length if length <= LARGEST_BYTES else None


def unpack_block(stored: memoryview) -> Block | None:
    """Return the block in bytes from its magic number to its end; None if a bit was changed."""
    _, crc, kind, _, number, writer, identity = HEADER.unpack_from(stored)
    if zlib.crc32(stored[_CHECKED_FROM:]) != crc:
        return None
    return Block(kind, number, writer, identity.hex(), stored[HEADER.size :])


# Contents of blocks -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class JournalHead:
    """What every segment of a recording says about it."""

    bench_text: str
    """bench.toml in full."""
    dbc_text: str
    """The DBC in full."""
    software: str
    """Name and version of the writer."""
    wall_ns: int
    """The host's wall-clock time when the recording was begun or resumed, ns."""
    monotonic_ns: int
    """The host's monotonic time, read together with `wall_ns`, ns."""
    recording: str = field(default_factory=lambda: uuid.uuid4().hex)
    """Identity of the recording, 32 hexadecimal digits, kept when it is resumed."""
    first_segment: int = 1
    """Number of the recording's first segment.  It names the session file, also after that segment
    was deleted to make room."""
    campaign: bool = True
    """False for a recording between two campaigns, which has no runs."""
    origin: str = Origin.REAL
    """Origin of the frames: a value of `Origin`."""


@dataclass(frozen=True, slots=True)
class Summary:
    """The content of a segment, without its frames."""

    first: int
    """Number of the first block."""
    stop: int
    """Number of the block after the last; equal to `first` if there is none."""
    frames: int = 0
    """Number of frames in all its blocks."""
    first_ns: int = 0
    """Earliest time stamp, ns; 0 if there is none."""
    last_ns: int = 0
    """Latest time stamp, ns; 0 if there is none."""
    events: tuple[tuple[int, Event], ...] = ()
    """Events in order, each with the number of its block."""


def pack_head(head: JournalHead) -> bytes:
    """Return the content of a block of kind HEAD."""
    return json.dumps(asdict(head)).encode()


def pack_end(head: JournalHead, summary: Summary) -> bytes:
    """Return the content of a block of kind END."""
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
            _FRAMES.pack(len(frames), frames.data.shape[1], *losses.counts),
            *(getattr(frames, name).astype(form).tobytes() for name, form in _COLUMNS),
            frames.data.tobytes(),
        ]
    )


class StoredFrames(NamedTuple):
    """The frames of a block, which are unpacked only on access."""

    size: int
    """Number of its frames."""
    losses: HopLosses
    """Losses counted up to it by the process that wrote it."""
    content: bytes | memoryview
    """From `pack_frames`."""

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Time stamps of the frames, ns, shape (size,)."""
        return np.frombuffer(self.content, "<i8", self.size, _FRAMES.size)

    @property
    def frames(self) -> FrameBatch:
        """The frames."""
        width = _FRAMES.unpack_from(self.content)[1]
        columns, begin = {}, _FRAMES.size
        for name, form in (*_COLUMNS, ("data", _PAYLOADS[width])):
            # A copy is aligned, and does not keep the whole piece of the file in memory.
            columns[name] = np.frombuffer(self.content, form, self.size, begin).copy()
            begin += form.itemsize * self.size
        return FrameBatch(**columns)


def stored_frames(content: bytes | memoryview) -> StoredFrames:
    """Return the frames in a block of kind FRAMES."""
    size, _, *counts = _FRAMES.unpack_from(content)
    return StoredFrames(size, HopLosses(*counts), content)


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
    """A span of blocks that is missing from the journal."""

    recording: str
    """Identity of the recording of these blocks."""
    first: int
    """Number of the first block."""
    stop: int
    """Number of the block after the last."""
    frames: int
    """Number of frames in these blocks."""
    file: str = ""
    """Name of the segment that contained them; empty if none did."""


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
