"""Reads one segment once: its head, its blocks and its end, also past damaged records."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

from ..errors import InputError
from .format import (
    HEAD_RECORD,
    PROFILE,
    EventBlock,
    FrameBlock,
    JournalHead,
    check_frames,
    parse_head,
    unpack_events,
)
from .records import (
    ADVICE,
    MAGIC,
    Kind,
    Record,
    SegmentFile,
    differ_by_a_byte,
    parse_attachment,
    parse_metadata,
)

_MESSAGE_BYTES = 22
"""Number of bytes of a message before its block: channel, sequence and two times, which are not
used."""
_EVENTS_BEGIN = b'{"crc32":'
"""Beginning of the message of `pack_events`."""


@dataclass(frozen=True, slots=True)
class CorruptBlock:
    """A record between blocks that is not a block, or a block whose content was changed."""

    text: str
    """The fault in words."""


class _Metadata(NamedTuple):
    name: str
    entries: dict[str, str]


class _Text(NamedTuple):
    """The content of an attachment."""

    data: bytes


_BLOCKS = (FrameBlock, EventBlock, CorruptBlock)
_Item = FrameBlock | EventBlock | CorruptBlock | _Metadata | _Text


class SegmentReader:
    """An open segment, read up to the end of its head; a context manager that closes it.

    `path`: the file.  `head`: head and number of the segment, None if it has no complete head.
    `sealed`: True after `blocks` has reached the segment's proper end.  Raises InputError as
    `SegmentFile`, and if the file was written by another program.
    """

    def __init__(self, path: Path) -> None:
        self.file = SegmentFile(path)
        self.sealed = False
        self._items = self._read_items()
        try:
            self.head = self._read_head()
        except InputError:
            self.file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def blocks(self) -> Iterator[FrameBlock | EventBlock | CorruptBlock]:
        """Yield the blocks between head and end in order; to be called once, if there is a head.

        A segment that was not sealed ends with its last complete block.
        """
        for item in self._items:
            if isinstance(item, _BLOCKS):
                yield item

    def holds_blocks(self) -> bool:
        """Return whether there are blocks in a segment without a complete head."""
        candidates = self.file.candidates(len(MAGIC))
        return any(each.kind == Kind.MESSAGE and _is_whole(each) for _, each in candidates)

    @property
    def bytes_cut(self) -> int:
        """Bytes after the last complete record; 0 if only part of the segment's end is missing."""
        file = self.file
        if self.sealed or file.read_at(file.stop, 1) in (_METADATA, _DATA_END):
            return 0
        return file.size - file.stop

    def _read_head(self) -> tuple[JournalHead, int] | None:
        """Return the first head that is whole, made of the parts of both copies if need be."""
        records: list[dict[str, str]] = []
        texts: dict[int, bytes] = {}
        for item in self._items:
            if isinstance(item, _Metadata) and item.name == HEAD_RECORD:
                records.append(item.entries)
            elif isinstance(item, _Text):
                texts[zlib.crc32(item.data)] = item.data
            elif isinstance(item, FrameBlock | EventBlock):
                return None
            for record in records:
                try:
                    if head := parse_head(record, texts):
                        return head
                except (ValueError, KeyError):
                    continue  # damaged
        return None

    def _read_items(self) -> Iterator[_Item]:
        """Yield what each record holds; after damage, from the next record that is whole.

        The length of a damaged record cannot be believed.
        """
        file, start = self.file, len(MAGIC)  # `start`: where the last record that is whole ends
        following: int | None = start
        end = int(Kind.DATA_END)  # comparing with a Kind takes longer
        while following is not None:
            begin, fault, kind = following, "", -1
            for record in file.records(following):
                kind = record.kind
                if kind == end and len(record.content) == 4 and begin == start:
                    self.sealed = True
                    return  # the rest is an index for other tools
                if start == len(MAGIC) and kind in (Kind.HEADER, Kind.CHANNEL):
                    self._check_profile(record)
                    begin = file.stop
                    continue
                try:
                    item = _parsed(record)
                except ValueError as error:
                    fault = str(error)
                    break
                begin = start = file.stop
                yield item
            if not fault and file.why_stopped != "torn":
                return
            stop, why_stopped = file.stop, file.why_stopped
            following = next(
                (at for at, each in file.candidates(start + 1) if _is_whole(each)), None
            )
            if following is not None:
                start = following
                yield CorruptBlock(fault or why_stopped)
            elif fault:
                # If no block follows, metadata are the segment's own summary: no block is lost.
                if kind != Kind.METADATA:
                    yield CorruptBlock(fault)
                last = next(file.records(stop), None)
                self.sealed = last is not None and last.kind == end
                file.stop = stop

    def _check_profile(self, header: Record) -> None:
        """Raise InputError at the header of another program's file."""
        profile = header.content[4 : 4 + len(PROFILE)]
        if header.kind == Kind.HEADER and not differ_by_a_byte(profile, PROFILE.encode()):
            what = "is an MCAP file of another program"
            raise InputError(str(self.file.path), what, ADVICE)


_METADATA, _DATA_END = bytes([Kind.METADATA]), bytes([Kind.DATA_END])


def _parsed(record: Record) -> FrameBlock | EventBlock | _Metadata | _Text:
    """Return what a record between the header and the end holds.

    Raises ValueError if it was changed.
    """
    kind, content = record
    if kind == Kind.MESSAGE:
        if content.startswith(_EVENTS_BEGIN, _MESSAGE_BYTES):
            return unpack_events(content[_MESSAGE_BYTES:])
        return check_frames(memoryview(content)[_MESSAGE_BYTES:])
    try:
        if kind == Kind.METADATA:
            return _Metadata(*parse_metadata(content))
        if kind == Kind.ATTACHMENT:
            return _Text(parse_attachment(content)[1])
    except ValueError:
        pass
    raise ValueError("its kind was changed")


def _is_whole(record: Record) -> bool:
    try:
        _parsed(record)
    except ValueError:
        return False
    return True
