"""What users read: errors of one line, numbers of things, times, and foreign text.

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


def counted(number: int, one: str, many: str = "") -> str:
    """Return a number with the words for what it counts, as `plural`: `1 frame`, `1,200 frames`."""
    return f"{number:,} {plural(number, one, many)}"


def plural(number: int, one: str, many: str = "") -> str:
    """Return the words for a number of things: `one` for 1, else `many`, by default one with s."""
    return one if number == 1 else many or f"{one}s"


def seconds_text(t_ns: int) -> str:
    """Return a time, ns, in seconds with nine decimals."""
    seconds, rest_ns = divmod(abs(t_ns), 1_000_000_000)
    return f"{'-' if t_ns < 0 else ''}{seconds}.{rest_ns:09d}"


def csv_text(text: str) -> str:
    """Return foreign text for a cell of CSV: no spreadsheet takes it as a formula.

    It gets an apostrophe before a character that begins a formula, unless it is a number;
    characters that control a terminal are replaced.
    """
    shown = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    if shown[:1] not in set("=+-@"):
        return shown
    try:
        float(shown)
    except ValueError:
        return f"'{shown}"
    return shown
