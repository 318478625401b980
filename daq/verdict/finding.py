"""A finding with the advice of the table."""

from __future__ import annotations

from ..runlog.runlog import Finding
from .words import WORDS


def finding(
    code: str,
    passed: bool,
    value: float,
    limit: float,
    unit: str,
    text: str,
    subject: str = "",
    advice: str = "",
) -> Finding:
    """Return a finding; what failed carries the table's advice unless it has its own."""
    told = "" if passed else advice or WORDS[code].advice
    return Finding(code, bool(passed), subject, float(value), float(limit), unit, text, told)
