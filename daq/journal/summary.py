"""Writes and reads the last record of a sealed segment, a summary of its content.

A restarted recorder needs the state of its recording, which has a hundred gigabytes after some
weeks: reading all of it takes minutes, reading the summaries takes almost no time.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Sequence
from dataclasses import astuple, dataclass

from ..runs import Event
from .records import MAGIC, Kind, SegmentFile, parse_metadata

SUMMARY_RECORD = "bumpbench_summary"

_RECORD = struct.Struct("<BQ")  # kind, length
_FOOTER = struct.Struct("<BQQQI8s")  # kind, length, start of MCAP's index, offsets, CRC, magic
_INDEX = struct.Struct("<QQI")  # offset, length, length of the name
_FOOTER_KIND, _INDEX_KIND = 0x02, 0x0D
_LARGEST_BYTES = 1 << 16
"""Largest summary section of MCAP that is read, bytes: in a file without chunks it has channels,
statistics and two index entries."""


@dataclass(frozen=True, slots=True)
class Summary:
    """The content of a segment; the fields are those of `SegmentInfo`."""

    first: int
    stop: int
    frames: int
    first_ns: int
    last_ns: int
    events: tuple[tuple[int, Event], ...]
    """Events in order, each with the number of its block."""


def pack_summary(summary: Summary) -> dict[str, str]:
    """Return the metadata of a summary."""
    events = [[number, *astuple(event)] for number, event in summary.events]
    numbers = [summary.first, summary.stop, summary.frames, summary.first_ns, summary.last_ns]
    text = json.dumps([*numbers, events], separators=(",", ":"))
    return {"contents": text, "crc32": str(zlib.crc32(text.encode()))}


def read_summary(file: SegmentFile) -> Summary | None:
    """Return the summary of a segment, None if it has no proper end or was written without one."""
    try:
        tail = file.read_at(file.size - _FOOTER.size, _FOOTER.size)
        kind, length, start, _, _, magic = _FOOTER.unpack(tail)
        if (kind, length, magic) != (_FOOTER_KIND, 20, MAGIC) or not 0 < start < file.size:
            return None
        index = file.read_at(start, min(file.size - _FOOTER.size - start, _LARGEST_BYTES))
        for offset in _metadata_offsets(index):
            kind, length = _RECORD.unpack(file.read_at(offset, _RECORD.size))
            if kind != Kind.METADATA or offset + length > start:
                return None
            content = file.read_at(offset + _RECORD.size, length)
            return _parsed(parse_metadata(content)[1])
    except Exception:  # a foreign or damaged file is read in full
        return None
    return None


def _metadata_offsets(index: bytes) -> Sequence[int]:
    """Return the offsets of the summary records in MCAP's index of metadata."""
    found = []
    at = 0
    while at + _RECORD.size <= len(index):
        kind, length = _RECORD.unpack_from(index, at)
        at += _RECORD.size
        if kind == _INDEX_KIND:
            offset, _, name_bytes = _INDEX.unpack_from(index, at)
            name = index[at + _INDEX.size : at + _INDEX.size + name_bytes]
            if name == SUMMARY_RECORD.encode():
                found.append(offset)
        at += length
    return found


def _parsed(record: dict[str, str]) -> Summary | None:
    text = record["contents"]
    if zlib.crc32(text.encode()) != int(record["crc32"]):
        return None
    first, stop, frames, first_ns, last_ns, events = json.loads(text)
    numbered = tuple((number, Event(*fields)) for number, *fields in events)
    return Summary(first, stop, frames, first_ns, last_ns, numbered)
