"""One small fault in one source file."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class Mutant:
    """One replacement of a few bytes in one file."""

    path: str
    """Relative to the root of the tree, with slashes."""
    line: int
    """Where the replaced text begins, counted from 1."""
    start: int
    """Byte offset of the first replaced byte."""
    end: int
    """Byte offset after the last replaced byte."""
    text: str
    """What takes the place of these bytes."""

    @property
    def room(self) -> str:
        """Return the folder in the package, or the package for a file that lies at its root."""
        return "/".join(self.path.split("/")[:-1][:2])

    def applied(self, source: bytes) -> bytes:
        """Return the source with the fault in it."""
        return source[: self.start] + self.text.encode() + source[self.end :]

    def change(self, source: bytes) -> str:
        """Return the change in one line, as `before -> after`."""
        before = " ".join(source[self.start : self.end].decode().split())
        return f"{before or 'nothing'} -> {' '.join(self.text.split()) or 'nothing'}"
