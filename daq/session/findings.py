"""What a check of a session file finds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from ..errors import printable


class Severity(StrEnum):
    """How bad a finding is."""

    ERROR = "error"
    """The file is invalid: it breaks the schema, or contradicts itself."""
    WARNING = "warning"
    """It can be used, but something in it is hard to believe."""
    NOTE = "note"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is to be said of a session file."""

    severity: Severity
    """How bad it is."""
    where: str
    """Path in the file."""
    what: str
    """What is wrong, in one line."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "where", printable(self.where))
        object.__setattr__(self, "what", printable(self.what, 400))
