"""The line of a bench check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from types import MappingProxyType


class Verdict(IntEnum):
    """How a line of the check ends, the worse the higher."""

    OK = 0
    WARN = 1
    FAIL = 2


def _nothing() -> Mapping[str, float]:
    return MappingProxyType({})


@dataclass(frozen=True, slots=True)
class CheckLine:
    """One finding."""

    verdict: Verdict
    """FAIL blocks a campaign, WARN is for the operator to judge."""
    subject: str
    """``bus``, ``message X``, ``sample set X`` or ``channel X``."""
    reason: str
    """What was found, with the numbers."""
    advice: str = ""
    """What to do; empty where nothing need be done."""
    figures: Mapping[str, float] = field(default_factory=_nothing)
    """The measured numbers, SI."""
