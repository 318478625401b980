"""Reads the bytes of a log, packed with gzip or not, and counts what is lost on the way."""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from typing import BinaryIO, Protocol

from dbc.errors import printable

GZIP_MAGIC = b"\x1f\x8b"
_NOTES = 8
"""Number of notes that are kept: the first faults describe a badly damaged log well enough."""


@dataclass(frozen=True, slots=True)
class LogLoss:
    """Numbers of records that are missing or damaged in a log."""

    garbled: int = 0
    """Number of records that should be frames and cannot be read."""
    bytes_cut: int = 0
    """Number of bytes, at the end or skipped, that are not a complete record."""
    dropped: int = 0
    """Number of frames that the log itself states as lost by its recorder."""
    notes: tuple[str, ...] = ()
    """Descriptions of the first losses, with their places."""

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


class Ledger:
    """The losses of one log so far."""

    def __init__(self) -> None:
        self._counts = {"garbled": 0, "bytes_cut": 0, "dropped": 0}
        self._notes: list[str] = []

    @property
    def loss(self) -> LogLoss:
        """Losses found so far."""
        return LogLoss(**self._counts, notes=tuple(self._notes))

    def garbled(self, count: int, note: str) -> None:
        """Count records that cannot be read."""
        self._add("garbled", count, note)

    def cut(self, size: int, note: str) -> None:
        """Count bytes that are missing or not a complete record."""
        self._add("bytes_cut", size, note)

    def dropped(self, count: int, note: str) -> None:
        """Count frames that the log states as lost."""
        self._add("dropped", count, note)

    def _add(self, name: str, count: int, note: str) -> None:
        self._counts[name] += count
        if len(self._notes) < _NOTES:
            self._notes.append(printable(note))


class Readable(Protocol):
    """Bytes that are read forwards."""

    def read(self, size: int, /) -> bytes:
        """Return this number of bytes, fewer at the end."""

    def tell(self) -> int:
        """Return the number of bytes read."""


class Unpacked:
    """A file that is unpacked while it is read, if packed; it ends where it is damaged or cut.

    `file`: at its beginning.  `ledger`: collects the losses.
    """

    def __init__(self, file: BinaryIO, ledger: Ledger) -> None:
        self._ledger = ledger
        self.packed = file.read(2) == GZIP_MAGIC
        """True if it is packed."""
        file.seek(0)
        self._stream: BinaryIO | gzip.GzipFile = (
            gzip.GzipFile(fileobj=file) if self.packed else file
        )
        self._count = 0
        self._ended = False

    def read(self, size: int, /) -> bytes:
        """Return this number of bytes, fewer at the end."""
        parts: list[bytes] = []
        left = 0 if self._ended else size
        try:
            while left and (part := self._stream.read(left)):
                parts.append(part)
                left -= len(part)
        except (EOFError, gzip.BadGzipFile, zlib.error):
            self._ledger.garbled(1, "it cannot be unpacked to its end; the rest is lost")
            self._ended = True
        data = b"".join(parts)
        self._count += len(data)
        return data

    def tell(self) -> int:
        """Return the number of bytes read, unpacked."""
        return self._count
