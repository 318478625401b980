"""Finds the content of a journal segment without reading its frames."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, DataEnd, Header, Message, Metadata
from mcap.stream_reader import StreamReader

from ..errors import InputError
from ..runs import Event
from .format import (
    BENCH_NAME,
    BLOCK_HEAD,
    DBC_NAME,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    HEAD_RECORD,
    PROFILE,
    JournalHead,
    block_head,
    first_stamp,
    parse_head,
    unpack_events,
    unpack_frames,
)
from .summary import Summary, read_summary

LARGEST_RECORD_BYTES = 256 << 20
"""Longest record, bytes: a greater length comes from a torn or foreign file."""

_MAGIC = b"\x89MCAP0\r\n"
_MAGIC_BYTES = len(_MAGIC)
_RECORD = struct.Struct("<BQ")  # kind, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, time, time
_CHANNEL, _MESSAGE_KIND, _DATA_END = 0x04, 0x05, 0x0F
_CREDIBLE_STEP = 1 << 24
"""Largest credible step of the block number, some ten days of blocks: more is a flipped bit."""


@dataclass(frozen=True, slots=True)
class SegmentInfo:
    """A segment, without its frames."""

    path: Path
    """The file."""
    recording: str
    """Identity of the recording that it belongs to."""
    number: int
    """Number of the segment in its folder."""
    first_segment: int
    """Number of the first segment of its recording."""
    bytes: int
    """Size of the file."""
    first: int
    """Number of the first block."""
    stop: int
    """Number of the block after the last; equal to `first` if there is none."""
    frames: int
    """Number of frames in all its blocks."""
    first_ns: int
    """Time stamp of the first frame; 0 if there is none."""
    last_ns: int
    """Latest time stamp; 0 if there is none."""
    events: tuple[tuple[int, Event], ...]
    """In order, each with the number of its block."""
    sealed: bool
    """True if it has its proper end."""


def read_head(path: Path) -> tuple[JournalHead, int] | None:
    """Return head and segment number, None if the file has no complete head.

    A crash may leave a new file with zeros in place of its head.

    Raises InputError if the file cannot be read or is not a journal.
    """
    metadata: dict[str, str] | None = None
    texts: dict[str, bytes] = {}
    try:
        with path.open("rb") as file:
            start = file.read(_MAGIC_BYTES)
            if len(start) == _MAGIC_BYTES and any(start) and start != _MAGIC:
                raise InputError(str(path), "is not a journal", "name the files journal_*.mcap")
            file.seek(0)
            for record in StreamReader(file, record_size_limit=LARGEST_RECORD_BYTES).records:
                if isinstance(record, Header) and record.profile != PROFILE:
                    what = "is an MCAP file of another program"
                    raise InputError(str(path), what, "name the files journal_*.mcap")
                if isinstance(record, Metadata) and record.name == HEAD_RECORD:
                    metadata = record.metadata
                elif isinstance(record, Attachment):
                    texts[record.name] = record.data
                if metadata is not None and texts.keys() >= {BENCH_NAME, DBC_NAME}:
                    return parse_head(metadata, texts[BENCH_NAME], texts[DBC_NAME])
                if isinstance(record, Message | DataEnd):
                    break
    except InputError:
        raise
    except OSError as error:
        raise InputError(
            str(path), error.strerror or str(error), "name the files journal_*.mcap"
        ) from error
    except Exception:  # torn bytes raise any exception of the parser
        return None
    return None


def holds_blocks(path: Path) -> bool:
    """Return whether there are blocks in a file, also if its head cannot be read."""
    with path.open("rb") as file:
        records = _records(file.fileno(), path.stat().st_size)
        return any(kind == _MESSAGE_KIND for kind, _, _ in records)


def scan(path: Path) -> SegmentInfo | None:
    """Return the content of a segment, None if it ends before its head does.

    A segment with its proper end has a summary, which makes this fast at any size.

    Raises InputError as `read_head`.
    """
    found = read_head(path)
    if found is None:
        return None
    head, segment = found
    with path.open("rb") as file:
        size = path.stat().st_size
        summary = read_summary(file.fileno(), size)
        sealed = summary is not None
        if summary is None:
            summary, sealed = _walk(file.fileno(), size)
    return SegmentInfo(
        path, head.identity, segment, head.first_segment or segment, size, summary.first,
        summary.stop, summary.frames, summary.first_ns, summary.last_ns, summary.events, sealed,
    )  # fmt: skip


def _walk(fd: int, size: int) -> tuple[Summary, bool]:
    """Return the content of a file without a summary, and whether it has its end.

    Only events and the last block are checked for flipped bits: a crash damages no others.
    """
    topics: dict[int, str] = {}
    first = stop = None
    frames = first_ns = last_ns = 0
    events: list[tuple[int, Event]] = []
    sealed = False
    for kind, offset, length in _records(fd, size):
        if kind == _DATA_END:
            sealed = True
        elif kind == _CHANNEL:
            channel, name = _channel(os.pread(fd, length, offset))
            topics[channel] = name
        if kind != _MESSAGE_KIND or length < _MESSAGE.size:
            continue
        body, inner = offset + _MESSAGE.size, length - _MESSAGE.size
        channel, _, latest_ns, _ = _MESSAGE.unpack(os.pread(fd, _MESSAGE.size, offset))
        count = 0
        block: tuple[Event, ...] = ()
        try:
            if topics.get(channel) == FRAMES_TOPIC:
                number, count = block_head(os.pread(fd, BLOCK_HEAD, body))
                if offset + length == size:
                    unpack_frames(os.pread(fd, inner, body))
            elif topics.get(channel) == EVENTS_TOPIC:
                number, block = unpack_events(os.pread(fd, inner, body))
            else:
                continue
        except (ValueError, struct.error):
            continue
        if stop is not None and not 0 <= number - stop < _CREDIBLE_STEP:
            continue
        first, stop = (number if first is None else first), number + 1
        frames += count
        events += ((number, event) for event in block)
        if count:
            if not first_ns:
                first_ns = first_stamp(os.pread(fd, BLOCK_HEAD + 8, body))
            last_ns = max(last_ns, latest_ns)
    summary = Summary(first or 0, stop or 0, frames, first_ns, last_ns, tuple(events))
    return summary, sealed


def _records(fd: int, size: int) -> Iterator[tuple[int, int, int]]:
    """Yield kind, offset and length of every whole record up to the end of the data."""
    at = _MAGIC_BYTES
    while at + _RECORD.size <= size:
        kind, length = _RECORD.unpack(os.pread(fd, _RECORD.size, at))
        at += _RECORD.size
        if at + length > size:
            return
        if kind == 0:
            return  # a hole
        yield kind, at, length
        if kind == _DATA_END:
            return
        at += length


def _channel(record: bytes) -> tuple[int, str]:
    number, _, length = struct.unpack_from("<HHI", record)
    return number, record[8 : 8 + length].decode(errors="replace")
