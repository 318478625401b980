"""Converts a position in the text of a file to `FILE:LINE`."""

from __future__ import annotations

import re
from bisect import bisect_left
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Source:
    """The name of a file and the ends of its lines."""

    name: str
    """Name of the file, for messages."""
    line_ends: list[int]
    """Positions of the line feeds."""

    @classmethod
    def of(cls, text: str, name: str) -> Source:
        """Return the source for `text`."""
        return cls(name, [found.start() for found in re.finditer("\n", text)])

    def at(self, position: int) -> str:
        """Return `name:line` of a position."""
        return f"{self.name}:{bisect_left(self.line_ends, position) + 1}"
