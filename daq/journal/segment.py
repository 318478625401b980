"""Writes one file of the journal: an MCAP file without chunks, each write synced.

After `Segment.write` has returned, neither a kill nor a power cut loses the blocks.  After the
first write error a file is not touched again: a repeated write in the same file leaves holes in
data that were reported as written.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import IO, Protocol, cast

from mcap.writer import IndexType, Writer

from ..files import sync_data, sync_folder
from .format import (
    BENCH_NAME,
    DBC_NAME,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    HEAD_RECORD,
    PROFILE,
    JournalHead,
    unpack_events,
)
from .names import sealed_path
from .summary import SUMMARY_RECORD, Summary, pack_summary


class JournalFile(Protocol):
    """The operations of a file that a segment uses."""

    def write(self, data: memoryview, /) -> int | None:
        """Write a part of `data` and return the number of bytes written."""

    def sync(self) -> None:
        """Return when all data written are on the disk."""

    def stat(self) -> os.stat_result:
        """Return the state of the open file."""

    def close(self) -> None:
        """Close the file."""


class SyncedFile(FileIO):
    """A new file, without a buffer."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "xb")

    def sync(self) -> None:
        """Return when all data written are on the disk."""
        sync_data(self.fileno())

    def stat(self) -> os.stat_result:
        """Return the state of the open file."""
        return os.fstat(self.fileno())


@dataclass(frozen=True, slots=True)
class Block:
    """A message to be written."""

    number: int
    """Its number in the recording."""
    topic: str
    """`FRAMES_TOPIC` or `EVENTS_TOPIC`."""
    t_ns: int
    """Latest time stamp up to the block, ns."""
    message: bytes
    """The packed message."""
    frames: int
    """Number of frames in it."""
    first_ns: int = 0
    """Earliest time stamp in it, ns; 0 without frames."""


class Segment:
    """A file of the journal.

    `file`: new and empty; closed here.  `path`: its path; deleted again if the head cannot be
    written.  After the last write it is renamed to `names.sealed_path`.  `record`: from
    `head_record`.  Raises OSError if the head cannot be written.
    """

    def __init__(
        self, file: JournalFile, path: Path, record: dict[str, str], head: JournalHead
    ) -> None:
        self.path = path
        self.file = file
        self.first: int | None = None
        self._stop = self._frames = self._first_ns = self._last_ns = 0
        self._events: list[bytes] = []
        self._stream = _Unbuffered(file)
        self._writer = Writer(
            cast(IO[bytes], self._stream), use_chunking=False, index_types=IndexType.METADATA
        )
        try:
            self._writer.start(PROFILE, head.software)
            self._channels = {
                FRAMES_TOPIC: self._writer.register_channel(FRAMES_TOPIC, "bumpbench-frames-1", 0),
                EVENTS_TOPIC: self._writer.register_channel(EVENTS_TOPIC, "json", 0),
            }
            for _ in range(2):  # one may be damaged
                self._writer.add_metadata(HEAD_RECORD, record)
                for name, text in ((BENCH_NAME, head.bench_text), (DBC_NAME, head.dbc_text)):
                    self._writer.add_attachment(0, head.wall_ns, name, "text/plain", text.encode())
            file.sync()
            sync_folder(path.parent)
        except OSError:
            self.discard()
            raise

    @property
    def size(self) -> int:
        """Number of bytes written."""
        return self._stream.size

    def write(self, blocks: Sequence[Block]) -> None:
        """Write blocks through to the disk.

        Raises OSError if the write failed; then nothing else may be written to this file.
        """
        for block in blocks:
            self._writer.add_message(
                self._channels[block.topic],
                block.t_ns,
                block.message,
                block.t_ns,
                sequence=block.number & 0xFFFF_FFFF,
            )
        self.file.sync()
        for block in blocks:
            self._note(block)

    def finish(self) -> None:
        """Write the end that MCAP tools expect, and close.

        Raises OSError if the end is not on the disk; the file is closed, and all blocks are in it.
        """
        try:
            self._writer.add_metadata(SUMMARY_RECORD, pack_summary(self._summary()))
            self._writer.finish()
            self.file.sync()
        finally:
            self._settle()

    def abandon(self) -> None:
        """Close the file as it is, and delete it if it has no block."""
        if self.first is None:
            self.discard()
        else:
            self._settle()

    def release(self) -> None:
        """Only close the file, because its name now belongs to another file."""
        with suppress(OSError):
            self.file.close()

    def _settle(self) -> None:
        """Close the file, and rename it as sealed."""
        with suppress(OSError):
            self.file.close()
        with suppress(OSError):  # the next recorder will rename it
            self.path = self.path.rename(sealed_path(self.path))

    def _note(self, block: Block) -> None:
        """Add a block that is on the disk to the summary."""
        if self.first is None:
            self.first = block.number
        self._stop = block.number + 1
        if block.topic == EVENTS_TOPIC:
            self._events.append(block.message)
        elif block.frames:
            self._frames += block.frames
            self._first_ns = min(self._first_ns or block.first_ns, block.first_ns)
            self._last_ns = max(self._last_ns, block.t_ns)

    def _summary(self) -> Summary:
        blocks = [unpack_events(message) for message in self._events]
        events = tuple((block.number, event) for block in blocks for event in block.events)
        first = self._stop if self.first is None else self.first
        return Summary(first, self._stop, self._frames, self._first_ns, self._last_ns, events)

    def discard(self) -> None:
        """Close and delete the file: nothing in it was reported as written."""
        with suppress(OSError):
            self.file.close()
        with suppress(OSError):
            self.path.unlink()


class _Unbuffered:
    """The stream of MCAP's writer, without a buffer that a later flush could lose."""

    def __init__(self, file: JournalFile) -> None:
        self._file = file
        self.size = 0

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:  # on an almost full disk a part is written without an error
            written = self._file.write(rest)
            if not written:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self.size += written
            rest = rest[written:]
        return len(data)

    def tell(self) -> int:
        return self.size
