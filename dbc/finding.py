"""Defines the finding: one judgement on a database, a bench, a run, a session or a result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from .words import printable


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
    """Name of the judged property: a word or two with underscores (`overload`, `chi2`,
    `left_out`)."""
    severity: Severity
    """Severity of the finding."""
    text: str
    """The finding in plain words with the numbers."""
    subject: str = ""
    """Channel, message, bus or run that the finding is about; may be empty."""
    advice: str = ""
    """Advice on what to do; empty if there is nothing to do."""
    value: float = 0.0
    """The measured value, in `unit`."""
    limit: float = 0.0
    """Limit of the value, in `unit`; `value` and `limit` are both 0 if the finding does not rest on
    a single figure."""
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
