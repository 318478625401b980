"""Reads one segment once: its head, its blocks and its end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from ..errors import InputError
from .format import (
    BENCH_NAME,
    DBC_NAME,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
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
    Kind,
    Record,
    SegmentFile,
    parse_attachment,
    parse_channel,
    parse_metadata,
    text_at,
)

_MESSAGE_BYTES = 22
"""Number of bytes of a message before its block: channel, sequence and two times, which are not
used."""


@dataclass(frozen=True, slots=True)
class CorruptBlock:
    """A record between blocks that is not a block, or a block whose content was changed."""

    text: str
    """The fault in words."""


class SegmentReader:
    """An open segment, read up to the end of its head; a context manager that closes it.

    `path`: the file.  `head`: head and number of the segment, None if it has no complete head.
    `sealed`: True after `blocks` has reached the segment's proper end.  Raises InputError as
    `SegmentFile`, and if the file was written by another program.
    """

    def __init__(self, path: Path) -> None:
        self.file = SegmentFile(path)
        self.sealed = False
        self._records = self.file.records()
        self._topics: dict[int, str] = {}
        self._found_block = False
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
        damaged = False
        message, end = int(Kind.MESSAGE), int(Kind.DATA_END)
        for record in self._records:
            kind, content = record
            if kind == end and len(content) == 4:
                self.sealed = True
                return  # the rest is an index for other tools
            if damaged:
                yield CorruptBlock("its kind was changed")
            damaged = False
            if kind == message:
                yield self._block(content)
            elif kind == Kind.METADATA:
                # If no block follows, it is the segment's own summary, and no block is lost.
                damaged = not _is_metadata(record)
            else:
                yield CorruptBlock("its kind was changed")

    def holds_blocks(self) -> bool:
        """Return whether there are blocks in a segment without a complete head."""
        return self._found_block or any(r.kind == Kind.MESSAGE for r in self._records)

    @property
    def bytes_cut(self) -> int:
        """Bytes after the last complete record; 0 if only part of the segment's end is missing."""
        file = self.file
        if self.sealed or file.read_at(file.stop, 1) in (_METADATA, _DATA_END):
            return 0
        return file.size - file.stop

    def _read_head(self) -> tuple[JournalHead, int] | None:
        metadata: dict[str, str] | None = None
        texts: dict[str, bytes] = {}
        try:
            for record in self._records:
                if record.kind == Kind.HEADER:
                    self._check_profile(text_at(record.content, 0)[0])
                elif record.kind == Kind.CHANNEL:
                    number, topic = parse_channel(record.content)
                    self._topics[number] = topic
                elif record.kind == Kind.METADATA:
                    name, entries = parse_metadata(record.content)
                    metadata = entries if name == HEAD_RECORD else metadata
                elif record.kind == Kind.ATTACHMENT:
                    name, data = parse_attachment(record.content)
                    texts[name] = data
                elif record.kind in (Kind.MESSAGE, Kind.DATA_END):
                    self._found_block = record.kind == Kind.MESSAGE
                    return None
                if metadata is not None and texts.keys() >= {BENCH_NAME, DBC_NAME}:
                    return parse_head(metadata, texts[BENCH_NAME], texts[DBC_NAME])
        except InputError:
            raise
        except (ValueError, KeyError):
            return None  # damaged
        return None

    def _check_profile(self, profile: str) -> None:
        if profile != PROFILE:
            what = "is an MCAP file of another program"
            raise InputError(str(self.file.path), what, ADVICE)

    def _block(self, content: bytes) -> FrameBlock | EventBlock | CorruptBlock:
        topic = self._topics.get(int.from_bytes(content[:2], "little"))
        message = memoryview(content)[_MESSAGE_BYTES:]
        try:
            if topic == FRAMES_TOPIC:
                return check_frames(message)
            if topic == EVENTS_TOPIC:
                return unpack_events(bytes(message))
        except ValueError as error:
            return CorruptBlock(str(error))
        return CorruptBlock("no such channel")


_METADATA, _DATA_END = bytes([Kind.METADATA]), bytes([Kind.DATA_END])


def _is_metadata(record: Record) -> bool:
    try:
        parse_metadata(record.content)
    except ValueError:
        return False
    return True
