"""Texts for users: errors of one line, findings, numbers of things, times, and foreign text.

An error is one line for a person: which file, what is wrong, what to do.  Foreign text (files,
signal names) is made printable here: no control character reaches a terminal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum


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


class Severity(IntEnum):
    """Severity of a finding; a higher value is worse."""

    NOTE = 0
    """For information only; also a limit that holds."""
    WARNING = 1
    """A person has to judge it."""
    ERROR = 2
    """The subject must not be used as it is."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was judged, with the figure, its limit and what to do."""

    code: str
    """Name of the judged property, with underscores (`overload`, `chi2`, `left_out`)."""
    severity: Severity
    text: str
    """The finding in plain words with the numbers."""
    subject: str = ""
    """Channel, message, bus or run that the finding is about; may be empty."""
    advice: str = ""
    """Advice on what to do; empty if there is nothing to do."""
    value: float = 0.0
    """The measured value, in `unit`."""
    limit: float = 0.0
    """Limit of the value, in `unit`; both are 0 if the finding does not rest on one figure."""
    unit: str = ""
    """SI unit; empty for a ratio or a count."""
    where: str = ""
    """Place in a file, as `FILE:LINE` or a path within the file; may be empty."""
    figures: Mapping[str, float] = field(default_factory=dict, hash=False)
    """Other quantities measured on the subject, by name, SI."""

    @property
    def passed(self) -> bool:
        """True if the finding is not an error."""
        return self.severity is not Severity.ERROR

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        return printable(f"{place}{self.text}", 300)


def counted(number: int, one: str, many: str = "") -> str:
    """Return a number with the words for what it counts, as `plural`: `1 frame`, `1,200 frames`."""
    return f"{number:,} {plural(number, one, many)}"


def plural(number: int, one: str, many: str = "") -> str:
    """Return the words for a number of things: `one` for 1, else `many`, by default one with s."""
    return one if number == 1 else many or f"{one}s"


def seconds_text(t_ns: int) -> str:
    """Return a time, ns, in seconds with nine decimals."""
    seconds, remaining_ns = divmod(abs(t_ns), 1_000_000_000)
    return f"{'-' if t_ns < 0 else ''}{seconds}.{remaining_ns:09d}"


def csv_text(text: str) -> str:
    """Return foreign text for a cell of CSV: no spreadsheet takes it as a formula.

    A text that begins as a formula does gets an apostrophe before it, unless it is a number.
    Characters that control a terminal are replaced.
    """
    printed = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    if printed[:1] not in set("=+-@"):
        return printed
    try:
        float(printed)
    except ValueError:
        return f"'{printed}"
    return printed
