"""What is said about a DBC: which messages were left out, and what is odd in the others."""

from __future__ import annotations

from dataclasses import dataclass

from .errors import printable


@dataclass(frozen=True, slots=True)
class Remark:
    """One thing about one message."""

    where: str
    """`FILE:LINE`."""
    name: str
    """The message, as far as the text tells it."""
    reason: str
    """What is wrong or odd."""

    def __str__(self) -> str:
        return printable(f"{self.where}: {self.name} {self.reason}", 300)
