"""Where in a file something is: `FILE:LINE` of a position in its text."""

from __future__ import annotations

import re
from bisect import bisect_left
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Source:
    """A file's name and where its lines end."""

    name: str
    """For messages."""
    line_ends: list[int]
    """Positions of the line feeds."""

    @classmethod
    def of(cls, text: str, name: str) -> Source:
        """Return the source that `text` is."""
        return cls(name, [found.start() for found in re.finditer("\n", text)])

    def at(self, position: int) -> str:
        """Return `name:line` of a position."""
        return f"{self.name}:{bisect_left(self.line_ends, position) + 1}"
