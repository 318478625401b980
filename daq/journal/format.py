"""Packs and unpacks the messages of the journal's MCAP files.

A journal is a sequence of segments `journal_0001.mcap`, `journal_0002.mcap`...  Each begins with a
metadata record and the texts of bench.toml and DBC as attachments, all of them twice, so that it
can be read separately, also after damage.  Every message has its number in the whole journal and a
CRC: without chunks, MCAP itself does not detect a flipped bit.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from ..bench.campaign import Origin
from ..bus.source import HopLosses
from ..runs import Event

PROFILE = "bumpbench"
FRAMES_TOPIC, EVENTS_TOPIC = "frames", "events"
HEAD_RECORD, BENCH_NAME, DBC_NAME = "bumpbench", "bench.toml", "bench.dbc"

_RECORD_CRC = "crc32"
_CAMPAIGN, _BETWEEN = "campaign", "between"
_CRC = struct.Struct("<I")
_BLOCK = struct.Struct("<QII4Q")  # number, frames, payload width, HopLosses
_FORMS = {"t_ns": "<i8", "can_id": "<u4", "flags": "<u2", "bus": "u1", "length": "u1"}
_COLUMNS = tuple((name, np.dtype(form)) for name, form in _FORMS.items())
_PAYLOADS = {width: np.dtype((np.uint8, width)) for width in (8, 64)}
_COLUMN_BYTES = sum(form.itemsize for _, form in _COLUMNS)
_BLOCK_HEAD = _CRC.size + _BLOCK.size
"""Number of bytes of a message of frames before its first column, `t_ns`."""


@dataclass(frozen=True, slots=True)
class JournalHead:
    """The beginning of every segment of a recording."""

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
    recording: str = ""
    """Identity of the recording (a uuid4 as 32 hex digits), kept when it is resumed; empty in
    journals of older versions, whose identity is made of the clocks."""
    first_segment: int = 0
    """Number of the recording's first segment.  It names the session file, also after that segment
    was deleted to make room; 0 in journals of older versions."""
    campaign: bool = True
    """False for a recording between two campaigns, which has no runs."""
    origin: str = Origin.REAL
    """Origin of the frames: a value of `Origin`."""

    @property
    def identity(self) -> str:
        """Identity of the recording, the same in all of its segments."""
        return self.recording or f"{self.wall_ns}+{self.monotonic_ns}"


def head_record(head: JournalHead, segment: int) -> dict[str, str]:
    """Return the metadata of a segment; the texts are stored as attachments."""
    record = {
        "software": head.software,
        "wall_ns": str(head.wall_ns),
        "monotonic_ns": str(head.monotonic_ns),
        "segment": str(segment),
        "recording": head.recording,
        "first_segment": str(head.first_segment),
        "span": _CAMPAIGN if head.campaign else _BETWEEN,
        "origin": head.origin,
        "bench_crc32": str(zlib.crc32(head.bench_text.encode())),
        "dbc_crc32": str(zlib.crc32(head.dbc_text.encode())),
    }
    return record | {_RECORD_CRC: str(zlib.crc32(_canonical(record)))}


def parse_head(record: dict[str, str], texts: dict[int, bytes]) -> tuple[JournalHead, int] | None:
    """Return the head and the segment number in a record of `head_record`.

    `texts`: the attachments that were read, by their CRC-32.  Returns None if one is missing.
    Raises ValueError or KeyError if the record was changed, or is from another program.
    """
    content = {name: value for name, value in record.items() if name != _RECORD_CRC}
    if len(content) < len(record) and int(record[_RECORD_CRC]) != zlib.crc32(_canonical(content)):
        raise ValueError("checksum does not fit")  # older versions wrote none
    bench_text = texts.get(int(record["bench_crc32"]))
    dbc_text = texts.get(int(record["dbc_crc32"]))
    if bench_text is None or dbc_text is None:
        return None
    head = JournalHead(
        bench_text.decode(),
        dbc_text.decode(),
        record["software"],
        int(record["wall_ns"]),
        int(record["monotonic_ns"]),
        record.get("recording", ""),
        int(record.get("first_segment", 0)),
        record.get("span", _CAMPAIGN) == _CAMPAIGN,
        record.get("origin", str(Origin.REAL)),
    )
    return head, int(record["segment"])


def pack_frames(number: int, frames: FrameBatch, losses: HopLosses) -> bytes:
    """Return the message for a block of frames and the losses counted up to it."""
    width = frames.data.shape[1]
    body = b"".join(
        [
            _BLOCK.pack(number, len(frames), width, *losses.counts),
            *(getattr(frames, name).astype(form).tobytes() for name, form in _COLUMNS),
            frames.data.tobytes(),
        ]
    )
    return _CRC.pack(zlib.crc32(body)) + body


class FrameBlock(NamedTuple):  # a frozen dataclass takes four times as long to make
    """A stored block of frames whose checksum matches."""

    number: int
    """Its number in the recording."""
    frames: int
    """Number of its frames."""
    width: int
    """Payload bytes of each frame, 8 or 64."""
    counts: tuple[int, ...]
    """The fields of `HopLosses`, counted by the process that wrote the block."""
    message: bytes | memoryview
    """The message of `pack_frames`."""

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Time stamps of the frames, ns, shape (frames,)."""
        return np.frombuffer(self.message, "<i8", self.frames, _BLOCK_HEAD)


def check_frames(message: bytes | memoryview) -> FrameBlock:
    """Return the block in a message of `pack_frames`.

    Raises ValueError if a single bit was changed.
    """
    if len(message) < _BLOCK_HEAD:
        raise ValueError("too short for a block")
    if _CRC.unpack_from(message)[0] != zlib.crc32(memoryview(message)[_CRC.size :]):
        raise ValueError("checksum does not fit")
    number, n, width, *counts = _BLOCK.unpack_from(message, _CRC.size)
    if width not in (8, 64) or len(message) != _BLOCK_HEAD + n * (_COLUMN_BYTES + width):
        raise ValueError("length does not fit the number of frames")
    return FrameBlock(number, n, width, tuple(counts), message)


def unpack_frames(blocks: Sequence[FrameBlock]) -> FrameBatch:
    """Return the frames of blocks of one width, joined: column by column, not block by block."""
    columns = {}
    before = _BLOCK_HEAD  # bytes of a block before the column; `row` bytes of it for each frame
    row = 0
    for name, form in (*_COLUMNS, ("data", _PAYLOADS[blocks[0].width])):
        size = form.itemsize
        parts = [
            block.message[before + row * block.frames : before + (row + size) * block.frames]
            for block in blocks
        ]
        columns[name] = np.frombuffer(b"".join(parts), form)
        row += size
    return FrameBatch(**columns)


def pack_events(number: int, events: Sequence[Event]) -> bytes:
    """Return the message for events: JSON, so that any MCAP tool can show it."""
    body = {"number": number, "events": [list(astuple(event)) for event in events]}
    return json.dumps({"crc32": zlib.crc32(_canonical(body)), **body}).encode()


@dataclass(frozen=True, slots=True)
class EventBlock:
    """A block of events."""

    number: int
    """Its number in the recording."""
    events: tuple[Event, ...]
    """In order."""


def unpack_events(message: bytes) -> EventBlock:
    """Return the block in a message of `pack_events`.

    Raises ValueError if it was changed.
    """
    try:
        body = json.loads(message)
        if body.pop("crc32") != zlib.crc32(_canonical(body)):
            raise ValueError("checksum does not fit")
        number, events = body["number"], tuple(Event(*fields) for fields in body["events"])
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"not the JSON of events: {error}") from error
    if not all(map(_is_event, events)) or type(number) is not int or number < 0:
        raise ValueError("not the JSON of events: a field is of another type")
    return EventBlock(number, events)


def _is_event(event: Event) -> bool:
    texts = isinstance(event.code, str) and isinstance(event.text, str)
    return texts and type(event.t_ns) is int and isinstance(event.value, int | float)


def _canonical(body: object) -> bytes:
    return json.dumps(body, sort_keys=True, separators=(",", ":")).encode()


# Defines the names of segments, which show which of them never change again -----------------------

SEALED, OPEN = "journal_*.mcap", "open_*.mcap"
"""Patterns of the names of segments that never change again, and of the one being written."""


def open_path(folder: Path, number: int) -> Path:
    """Return the path of a segment while it is written."""
    return folder / f"open_{number:04d}.mcap"


def sealed_path(path: Path) -> Path:
    """Return the path of a segment after it was written; the same path if it is sealed already."""
    number = path.name.removeprefix("open_")
    return path if number == path.name else path.with_name(f"journal_{number}")


def segment_number(path: Path) -> int:
    """Return the number in a segment's name, 0 if there is none."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0


# Defines the events that report blocks that are missing from a journal, as the recorder knows -----

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
    """Return the gap that an event reports; None if it is another event or cannot be read."""
    if event.code not in (DISK_GAP, FILE_GONE, RETENTION):
        return None
    try:
        return Gap(**json.loads(event.text))
    except (ValueError, TypeError):
        return None


def overlap(first: int, stop: int, gaps: Sequence[Gap]) -> int:
    """Return the number of block numbers of a span that are in gaps."""
    covered = 0
    for gap in sorted(gaps, key=lambda gap: gap.first):
        begin = max(first, gap.first)
        covered += max(0, min(stop, gap.stop) - begin)
        first = max(first, gap.stop)
    return covered
