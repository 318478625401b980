"""The write-ahead journal: every frame is on the disk before anything else is done with it.

One message a block, `fdatasync` after each: when `Journal.append` returns, neither a kill nor a
power cut takes the block away.  After the first write error a file is not touched again: retrying
in place leaves holes in what was reported as written.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import RawIOBase
from pathlib import Path
from typing import IO, Self, cast

from mcap.writer import IndexType, Writer

from dbc.errors import BumpbenchError
from dbc.frames import FrameBatch

from .journal_format import (
    BENCH_NAME,
    DBC_NAME,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    HEAD_RECORD,
    PROFILE,
    JournalHead,
    head_record,
    pack_events,
    pack_frames,
)
from .runs import Event
from .source import HopLosses


class JournalError(BumpbenchError, OSError):
    """The journal cannot be written, not even into a new file."""


def create_file(path: Path) -> RawIOBase:
    """Create a file that is not there yet, without a buffer in between."""
    return cast(RawIOBase, path.open("xb", buffering=0))


class Journal:
    """A recording being written; a context manager that closes it.

    Parameters
    ----------
    folder : Path
        Created if need be.  Segments are numbered on from those that are in it: a clock that is
        wrong must not decide over names.
    head : JournalHead
        Goes into every segment.
    create : callable
        Creates a file for writing.

    Raises
    ------
    JournalError
        If the first segment cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        head: JournalHead,
        create: Callable[[Path], RawIOBase] = create_file,
    ) -> None:
        self._folder = folder
        self._head = head
        self._create = create
        self._paths: list[Path] = []
        self._number = 0
        self._t_ns = 0
        self._segment: _Segment | None = self._new_segment()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The segments written so far, in order."""
        return tuple(self._paths)

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Store a block of frames; on return it is on the disk.

        Parameters
        ----------
        frames : FrameBatch
            May be empty, if there are only losses to tell of.
        losses : HopLosses
            Cumulative counts up to this block.

        Raises
        ------
        JournalError
            If it can be stored neither in the open file nor in a new one.
        """
        if len(frames):
            self._t_ns = max(self._t_ns, int(frames.t_ns.max()))
        self._store(FRAMES_TOPIC, pack_frames(self._number, frames, losses))

    def append_events(self, events: Sequence[Event]) -> None:
        """Store events; as `append`."""
        self._store(EVENTS_TOPIC, pack_events(self._number, events))

    def close(self) -> None:
        """Finish the file.  All that was stored is safe without this."""
        if self._segment is not None:
            self._segment.finish()
            self._segment = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _store(self, topic: str, message: bytes) -> None:
        if self._segment is None:
            raise JournalError(str(self._folder), "is closed", "start a new recording")
        try:
            self._segment.write(topic, self._number, self._t_ns, message)
        except OSError:
            self._segment.abandon()
            self._segment = None
            self._segment = self._new_segment()
            try:
                self._segment.write(topic, self._number, self._t_ns, message)
            except OSError as error:
                self._segment.abandon()
                self._segment = None
                raise self._full(error) from error
        self._number += 1

    def _new_segment(self) -> _Segment:
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            taken = [p.stem.rpartition("_")[2] for p in self._folder.glob("journal_*.mcap")]
            n = 1 + max((int(t) for t in taken if t.isdecimal()), default=0)
            path = self._folder / f"journal_{n:04d}.mcap"
            segment = _Segment(self._create(path), path, head_record(self._head, n), self._head)
        except OSError as error:
            raise self._full(error) from error
        self._paths.append(path)
        return segment

    def _full(self, error: OSError) -> JournalError:
        return JournalError(
            str(self._folder),
            f"cannot write the journal: {error.strerror or error}; "
            f"{self._number} blocks in {len(self._paths)} files are safe",
            "make room or choose another folder, then start again",
        )


class _Segment:
    """One file of the journal."""

    def __init__(
        self, file: RawIOBase, path: Path, record: dict[str, str], head: JournalHead
    ) -> None:
        self._file = file
        stream = cast(IO[bytes], _Unbuffered(file))
        self._writer = Writer(stream, use_chunking=False, index_types=IndexType.NONE)
        try:
            self._writer.start(PROFILE, head.software)
            self._channels = {
                FRAMES_TOPIC: self._writer.register_channel(FRAMES_TOPIC, "bumpbench-frames-1", 0),
                EVENTS_TOPIC: self._writer.register_channel(EVENTS_TOPIC, "json", 0),
            }
            self._writer.add_metadata(HEAD_RECORD, record)
            for name, text in ((BENCH_NAME, head.bench_text), (DBC_NAME, head.dbc_text)):
                self._writer.add_attachment(0, head.wall_ns, name, "text/plain", text.encode())
            os.fdatasync(file.fileno())
            _sync_folder(path.parent)
        except OSError:
            self.abandon()
            with suppress(OSError):
                path.unlink()  # there is nothing in it
            raise

    def write(self, topic: str, number: int, t_ns: int, message: bytes) -> None:
        """Write a message through to the disk."""
        self._writer.add_message(
            self._channels[topic], t_ns, message, t_ns, sequence=number & 0xFFFF_FFFF
        )
        os.fdatasync(self._file.fileno())

    def finish(self) -> None:
        """Write the end that MCAP tools expect, and close."""
        with suppress(OSError):  # the end may be missing; nothing else must be done to this file
            self._writer.finish()  # type: ignore[no-untyped-call]
            os.fdatasync(self._file.fileno())
        self.abandon()

    def abandon(self) -> None:
        """Close the file as it is."""
        with suppress(OSError):
            self._file.close()


class _Unbuffered:
    """What MCAP's writer needs of a stream, with nothing kept back for a later flush to lose."""

    def __init__(self, file: RawIOBase) -> None:
        self._file = file

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:  # a disk that is nearly full takes a part and reports no error
            rest = rest[self._file.write(rest) or 0 :]
        return len(data)

    def tell(self) -> int:
        return self._file.tell()


def _sync_folder(folder: Path) -> None:
    """Make the name of a new file survive a power cut."""
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
