"""The root of every error that Bumpbench raises on purpose.

An error is one line for a person: which file, what is wrong, what to do.  Foreign text (file
content, signal names) is made printable in this module, so that no control character reaches a
terminal.
"""

from __future__ import annotations


def printable(text: str, limit: int = 160) -> str:
    """Return `text` on one line without control characters, at most `limit` characters long."""
    safe = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return safe if len(safe) <= limit else safe[: limit - 3] + "..."


class BumpbenchError(Exception):
    """One line: where (a file, `FILE:LINE`, a bus, an option), what is wrong, and advice."""

    def __init__(self, where: str, what: str, advice: str) -> None:
        self.where = printable(where)
        self.what = printable(what, 400)
        self.advice = printable(advice, 300)
        super().__init__(f"{self.where}: {self.what} ({self.advice})")

    def __reduce__(self) -> tuple[type[BumpbenchError], tuple[str, str, str]]:
        """Pickle all three parts, so that an error can pass from a worker process to its parent."""
        return type(self), (self.where, self.what, self.advice)


class InputError(BumpbenchError, ValueError):
    """A file, configuration or argument that cannot be used."""
