"""The line of a bench check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from dbc.finding import Severity

WORDS = {Severity.NOTE: "OK", Severity.WARNING: "WARN", Severity.ERROR: "FAIL"}
"""Words for the severities, as printed and as sent to the terminal."""


def _nothing() -> Mapping[str, float]:
    return MappingProxyType({})


@dataclass(frozen=True, slots=True)
class CheckLine:
    """One finding, with all that was measured of its subject."""

    verdict: Severity
    """An error blocks a campaign, a warning is for the operator to judge."""
    subject: str
    """``bus``, ``message X``, ``sample set X`` or ``channel X``."""
    reason: str
    """The observation, with its numbers."""
    advice: str = ""
    """The remedy; empty where nothing need be done."""
    figures: Mapping[str, float] = field(default_factory=_nothing)
    """The measured numbers, SI."""

    @property
    def word(self) -> str:
        """OK, WARN or FAIL."""
        return WORDS[self.verdict]
