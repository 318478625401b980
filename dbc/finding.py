"""The noun for whatever was judged: of a database, a bench, a run, a session or a result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from .errors import printable


class Severity(IntEnum):
    """How bad a finding is, the worse the higher."""

    NOTE = 0
    """A limit that holds, or something that should merely be known."""
    WARNING = 1
    """For a person to judge."""
    ERROR = 2
    """The subject must not be used as it is."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was judged, with the figure, its limit and what to do."""

    code: str
    """The judged property: a word or two with underscores (`overload`, `chi2`, `left_out`)."""
    severity: Severity
    """How bad it is."""
    text: str
    """The finding in plain words with the numbers."""
    subject: str = ""
    """The channel, message, bus or run that it is about; may be empty."""
    advice: str = ""
    """Advice on what to do; empty where nothing need be done."""
    value: float = 0.0
    """The measured value, in `unit`."""
    limit: float = 0.0
    """Its limit, in `unit`; both are 0 where the finding rests on no single figure."""
    unit: str = ""
    """SI; empty for a ratio or a count."""
    where: str = ""
    """The place in a file, as `FILE:LINE` or a path within it; may be empty."""
    figures: Mapping[str, float] = field(default_factory=dict, hash=False)
    """Other quantities measured on its subject, by name, SI."""

    @property
    def passed(self) -> bool:
        """True if it is no error."""
        return self.severity is not Severity.ERROR

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        return printable(f"{place}{self.text}", 300)
