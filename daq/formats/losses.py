"""Counts what a reader could not read, and reports it at the end."""

from __future__ import annotations

from dataclasses import dataclass

from dbc.errors import printable

_NOTES = 8
"""A log that is damaged all over is described well enough by its first faults."""


@dataclass(frozen=True, slots=True)
class LogLoss:
    """Records that a log should hold and does not."""

    garbled: int
    """Records that should be frames and cannot be read."""
    bytes_cut: int
    """Bytes at the end, or passed over, that are no whole record."""
    notes: tuple[str, ...]
    """The first of them in words, with their places."""

    @property
    def any(self) -> bool:
        """True if something that was logged is missing."""
        return bool(self.garbled or self.bytes_cut)

    @property
    def text(self) -> str:
        """Counts and notes on one line; empty if nothing is missing."""
        counts = [(self.garbled, "records unreadable"), (self.bytes_cut, "bytes cut off")]
        parts = [f"{number} {what}" for number, what in counts if number]
        return "; ".join([", ".join(parts), *self.notes]) if parts else ""


class Ledger:
    """The running account of one log."""

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
        """Count bytes that are missing or no whole record."""
        self._bytes_cut += size
        self._note(note)

    def _note(self, note: str) -> None:
        if len(self._notes) < _NOTES:
            self._notes.append(printable(note))
