"""Reads the records of a segment from its beginning to its end, in large blocks.

A segment is an MCAP file without chunks: a magic number, then records of kind, length and content.
Reading stops at the first incomplete record and at a hole, which a crash leaves instead of data
that were not synced; `candidates` finds where to go on after damage.  The memory needed is that of
one block or one record.
"""

from __future__ import annotations

import json
import os
import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple, Self

from ..errors import InputError
from ..files import open_regular
from ..runs import Event
from .format import sealed_path

ADVICE = "move it away, and name the recorder's own files journal_*.mcap"
MAGIC = b"\x89MCAP0\r\n"
LARGEST_RECORD_BYTES = 64 << 20
"""Longest record, bytes: a greater length means a damaged or foreign file.  The largest block of
frames has 6 MB, the largest DBC 5 MB."""
_BLOCK_BYTES = 1 << 20
"""Number of bytes read at once: more is not faster."""
_HEAD_BYTES = 1 << 16
"""Number of bytes read first: they contain the head of nearly every segment, and often only the
head is needed."""
_RECORD = struct.Struct("<BQ")  # kind, length
_CHUNK = struct.Struct("<QQQI")  # start, stop, size, checksum of its messages
_TEXT, _LONG = struct.Struct("<I"), struct.Struct("<Q")
_START_BYTES = 64
"""Number of bytes in which `_START` recognises a record, at most."""
_START = re.compile(  # in a message the two times are equal
    rb"(?=(?:\x05.{3}[\0-\4]\0{4}[\1\2]\0.{4}(.{8})\1"
    rb"|\x09.{3}[\0-\4]\0{4}.{16}(?:\x0a\0\0\0bench\.toml|\x09\0\0\0bench\.dbc)"
    rb"|\x0c.{3}[\0-\4]\0{4}(?:\x09\0\0\0bumpbench|\x11\0\0\0bumpbench_summary)))",
    re.DOTALL,
)
"""Beginning of a message, an attachment or a metadata record of the recorder."""


_CHUNK_KIND = 0x06


class Kind(IntEnum):
    """Kinds of records in a segment, and the chunk, which it never has."""

    HEADER = 0x01
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = _CHUNK_KIND
    ATTACHMENT = 0x09
    METADATA = 0x0C
    DATA_END = 0x0F


class Record(NamedTuple):  # a frozen dataclass takes four times as long to make
    """A complete record of a file."""

    kind: int
    """Kind of the record, a `Kind` or, in a damaged file, any other number."""
    content: bytes
    """All bytes after the length of the record."""


class SegmentFile:
    """An open segment; a context manager that closes it.

    Raises InputError if it is not a regular file, cannot be opened, or does not begin like MCAP.
    """

    def __init__(self, path: Path) -> None:
        # Its writer may have finished and renamed it since it was listed.
        self.path = path if os.path.lexists(path) else sealed_path(path)
        self._fd = open_regular(self.path, ADVICE)
        self.size = os.fstat(self._fd).st_size
        """Size when it was opened, bytes; data written later are not read."""
        self.stop = 0
        """Offset after the last complete record that was read."""
        self.why_stopped = ""
        """Reason why `records` ended before the end of the file; empty if it did not."""
        start = self.read_at(0, len(MAGIC))
        # A crash may leave a new file with zeros instead of its beginning, or damage may hit it.
        known = start in (MAGIC, bytes(len(MAGIC))) or b"bumpbench" in self.read_at(0, _HEAD_BYTES)
        if len(start) == len(MAGIC) and not known:
            self.close()
            raise InputError(str(path), "is not a journal", ADVICE)

    def read_at(self, offset: int, size: int) -> bytes:
        """Return up to `size` bytes from `offset`; fewer at the end or if the disk fails."""
        parts = []
        while size > 0:
            try:
                os.lseek(self._fd, offset, os.SEEK_SET)  # Windows has no pread
                part = os.read(self._fd, size)
            except OSError as error:
                self.why_stopped = f"cannot be read ({error.strerror or error})"
                break
            if not part:
                break
            parts.append(part)
            offset, size = offset + len(part), size - len(part)
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def records(self, start: int = len(MAGIC)) -> Iterator[Record]:
        """Yield the complete records from an offset, until the file ends or no record follows.

        Raises InputError at a chunk: the recorder never writes one, and a small chunk may unpack to
        gigabytes.
        """
        at = self.stop = start
        block, first, last = b"", at, at  # bytes of the file, and their offsets
        size, head_bytes, unpack_head = self.size, _RECORD.size, _RECORD.unpack_from
        while at < size:
            content = at + head_bytes
            if content > last:
                wanted = _BLOCK_BYTES if block else _HEAD_BYTES
                block, first = self.read_at(at, wanted), at
                last = min(first + len(block), size)
            if content > last:
                self.why_stopped = self.why_stopped or "torn"
                return
            kind, length = unpack_head(block, at - first)
            stop = content + length
            if kind == length == 0:
                self.why_stopped = f"are a hole: zeros from byte {at}"
                return
            if length > LARGEST_RECORD_BYTES or stop > size:
                self.why_stopped = "torn"
                return
            if stop <= last:
                record = Record(kind, block[content - first : stop - first])
            else:
                record = Record(kind, self.read_at(content, length))
                if len(record.content) < length:
                    self.why_stopped = self.why_stopped or "torn"
                    return
            if kind == _CHUNK_KIND and _is_chunk(record.content):
                what = "has MCAP chunks, which the recorder never writes"
                raise InputError(str(self.path), what, ADVICE)
            at = self.stop = stop
            yield record
        self.why_stopped = ""

    def candidates(self, start: int) -> Iterator[tuple[int, Record]]:
        """Yield the offset of everything from `start` on that looks like a record, and the record.

        Only a checksum shows whether it is one.
        """
        for first in range(start, self.size, _BLOCK_BYTES):
            block = self.read_at(first, _BLOCK_BYTES + _START_BYTES)
            for match in _START.finditer(block):
                kind, length = _RECORD.unpack_from(block, match.start())
                at = first + match.start()
                if match.start() < _BLOCK_BYTES and at + _RECORD.size + length <= self.size:
                    yield at, Record(kind, self.read_at(at + _RECORD.size, length))

    def close(self) -> None:
        """Close the file."""
        os.close(self._fd)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def text_at(content: bytes, at: int) -> tuple[str, int]:
    """Return a text that is stored after its length, and the offset after it.

    Raises ValueError if it does not fit into the content.
    """
    (length,) = _unpack(_TEXT, content, at)
    at += _TEXT.size
    if at + length > len(content):
        raise ValueError("a text is cut off")
    return content[at : at + length].decode(), at + length


def parse_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Return name and entries of a metadata record.

    Raises ValueError if it is not one, or has data after its entries.
    """
    name, at = text_at(content, 0)
    (length,) = _unpack(_TEXT, content, at)
    at += _TEXT.size
    if at + length != len(content):
        raise ValueError("the entries do not fill the record")
    entries = {}
    while at < len(content):
        key, at = text_at(content, at)
        entries[key], at = text_at(content, at)
    return name, entries


def parse_attachment(content: bytes) -> tuple[str, bytes]:
    """Return name and data of an attachment record.

    Raises ValueError if it is not one.
    """
    name, at = text_at(content, 16)  # after two time stamps
    _, at = text_at(content, at)
    (length,) = _unpack(_LONG, content, at)
    at += _LONG.size
    if at + length + 4 != len(content):  # a checksum follows
        raise ValueError("the data do not fill the record")
    return name, content[at : at + length]


def differ_by_a_byte(found: bytes, expected: bytes) -> bool:
    """Return whether bytes are the expected ones, or one of them was damaged."""
    if len(found) != len(expected):
        return False
    return sum(a != b for a, b in zip(found, expected, strict=True)) <= 1


def _is_chunk(content: bytes) -> bool:
    """Return whether this is really a chunk, and not a block whose kind was changed by damage."""
    try:
        _, at = text_at(content, _CHUNK.size)
        (length,) = _unpack(_LONG, content, at)
    except ValueError:
        return False
    return at + _LONG.size + int(length) == len(content)


def _unpack(form: struct.Struct, content: bytes, at: int) -> tuple[int, ...]:
    if at + form.size > len(content):
        raise ValueError("a record is cut off")
    return form.unpack_from(content, at)


# Writes and reads the last record of a sealed segment, a summary of its content -------------------
#
# A restarted recorder needs the state of its recording, which has a hundred gigabytes after some
# weeks: reading all of it takes minutes, reading the summaries takes almost no time.

SUMMARY_RECORD = "bumpbench_summary"

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
