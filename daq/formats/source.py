"""Reads the bytes of a log, packed with gzip or not, and counts what is lost on the way."""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass, field
from typing import BinaryIO, Protocol

import numpy as np

from dbc.errors import printable
from dbc.frames import FrameBatch, FrameFlag
from dbc.words import counted

LATEST_NS = 4_102_444_800 * 10**9
"""The year 2100, ns since 1970: a later stamp is not in the unit of the format."""
LONGEST_NS = 10**18
"""Longest time since the start of a log, ns: 31 years.  A longer one is a date."""
_PIECE_BYTES = 1 << 24
"""Most bytes that are asked for at once: Python makes room for all of them before it reads."""
_MOST_NOTES = 8
"""Number of notes that are kept: the first faults describe a badly damaged log well enough."""


@dataclass(slots=True)
class LogLoss:
    """Numbers of records that are missing or damaged in a log, counted while it is read."""

    garbled: int = 0
    """Number of records that should be frames and cannot be read."""
    bytes_cut: int = 0
    """Number of bytes, at the end or skipped, that are not a complete record."""
    dropped: int = 0
    """Number of frames that the log itself states as lost by its recorder."""
    notes: list[str] = field(default_factory=list)
    """Descriptions of the first losses, with their places."""

    def add(self, note: str, *, garbled: int = 0, bytes_cut: int = 0, dropped: int = 0) -> None:
        """Count a loss and note it."""
        self.garbled += garbled
        self.bytes_cut += bytes_cut
        self.dropped += dropped
        if len(self.notes) < _MOST_NOTES:
            self.notes.append(printable(note))

    @property
    def any(self) -> bool:
        """True if any data are missing."""
        return bool(self.garbled or self.bytes_cut or self.dropped)

    @property
    def text(self) -> str:
        """Counts and notes on one line; empty if nothing is missing."""
        counts = [
            (self.garbled, "records unreadable"),
            (self.bytes_cut, "bytes cut off"),
            (self.dropped, "frames lost by its recorder"),
        ]
        parts = [f"{number} {what}" for number, what in counts if number]
        return "; ".join([", ".join(parts), *self.notes]) if parts else ""


def possible_frames(frames: FrameBatch, loss: LogLoss) -> FrameBatch:
    """Return the frames whose identifier fits its bits: 29 of an extended or error frame, else 11.

    No bus carries another frame, so it is left out and counted, and the rest of the log is read.
    """
    long = frames.flags & (FrameFlag.EXTENDED | FrameFlag.ERROR) != 0
    wrong = np.flatnonzero(frames.can_id >= np.where(long, 1 << 29, 1 << 11))
    if not len(wrong):
        return frames
    first = wrong[0]
    n, when = len(wrong), np.datetime64(int(frames.t_ns[first]), "ns")
    what = f"0x{int(frames.can_id[first]):X} with {29 if long[first] else 11} bits at {when}Z"
    have = counted(n, "frame has", "frames have")
    loss.add(f"{have} an impossible identifier, the first {what}", garbled=n)
    return frames.select(np.delete(np.arange(len(frames)), wrong))


class Readable(Protocol):
    """Bytes that are read forwards."""

    def read(self, size: int, /) -> bytes:
        """Return this number of bytes, fewer at the end."""

    def tell(self) -> int:
        """Return the number of bytes read."""


class Unpacked:
    """A file that is unpacked while it is read, if packed; it ends where it is damaged or cut.

    `file`: at its beginning.  `loss`: collects the losses.
    """

    def __init__(self, file: BinaryIO, loss: LogLoss) -> None:
        self._loss = loss
        self.packed = file.read(2) == b"\x1f\x8b"
        """True if it is packed."""
        file.seek(0)
        # A read of many bytes that fails would lose those before the damage: `read1` takes few.
        self._read = gzip.GzipFile(fileobj=file).read1 if self.packed else file.read
        self._count = 0
        self._ended = False

    def read(self, size: int, /) -> bytes:
        """Return this number of bytes, fewer at the end."""
        parts: list[bytes] = []
        missing = 0 if self._ended else size
        try:
            while missing and (part := self._read(min(missing, _PIECE_BYTES))):
                parts.append(part)
                missing -= len(part)
        except (EOFError, gzip.BadGzipFile, zlib.error):
            self._loss.add("it cannot be unpacked to its end; the rest is lost", garbled=1)
            self._ended = True
        data = b"".join(parts)
        self._count += len(data)
        return data

    def tell(self) -> int:
        """Return the number of bytes read, unpacked."""
        return self._count
