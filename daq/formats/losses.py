"""Counts the data that a reader could not read, and reports them at the end."""

from __future__ import annotations

from dataclasses import dataclass

from dbc.errors import printable

_NOTES = 8
"""Number of notes that are kept: the first faults describe a badly damaged log well enough."""


@dataclass(frozen=True, slots=True)
class LogLoss:
    """Numbers of records that are missing or damaged in a log."""

    garbled: int
    """Number of records that should be frames and cannot be read."""
    bytes_cut: int
    """Number of bytes, at the end or skipped, that are not a complete record."""
    notes: tuple[str, ...]
    """Descriptions of the first losses, with their places."""

    @property
    def any(self) -> bool:
        """True if any logged data are missing."""
        return bool(self.garbled or self.bytes_cut)

    @property
    def text(self) -> str:
        """Counts and notes on one line; empty if nothing is missing."""
        counts = [(self.garbled, "records unreadable"), (self.bytes_cut, "bytes cut off")]
        parts = [f"{number} {what}" for number, what in counts if number]
        return "; ".join([", ".join(parts), *self.notes]) if parts else ""


class Ledger:
    """The losses of one log so far."""

    def __init__(self) -> None:
        self._garbled = 0
        self._bytes_cut = 0
        self._notes: list[str] = []

    @property
    def loss(self) -> LogLoss:
        """Losses found so far."""
        return LogLoss(self._garbled, self._bytes_cut, tuple(self._notes))

    def garbled(self, count: int, note: str) -> None:
        """Count records that cannot be read."""
        self._garbled += count
        self._note(note)

    def cut(self, size: int, note: str) -> None:
        """Count bytes that are missing or not a complete record."""
        self._bytes_cut += size
        self._note(note)

    def _note(self, note: str) -> None:
        if len(self._notes) < _NOTES:
            self._notes.append(printable(note))
