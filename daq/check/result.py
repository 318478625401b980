"""Makes the lines of a bench check: findings, with words for severities, and open questions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from dbc.errors import printable
from dbc.finding import Finding, Severity

WORDS = {Severity.NOTE: "OK", Severity.WARNING: "WARN", Severity.ERROR: "FAIL"}
"""Words for the severities, printed and sent to the terminal."""
ASK = "# ASK: "
"""Beginning of a mark of `daq.check.propose`, on a separate line or after a value."""


def judged(code: str, severity: Severity, text: str, advice: str = "") -> Finding:
    """Return a finding whose subject is stated later (`about`)."""
    return Finding(code, severity, text, advice=advice)


def ok(code: str, text: str) -> Finding:
    """Return a finding that is not a fault."""
    return judged(code, Severity.NOTE, text)


def warn(code: str, text: str, advice: str) -> Finding:
    """Return a finding for the operator to judge."""
    return judged(code, Severity.WARNING, text, advice)


def fail(code: str, text: str, advice: str) -> Finding:
    """Return a finding that blocks a campaign."""
    return judged(code, Severity.ERROR, text, advice)


def about(
    subject: str, findings: Iterable[Finding], figures: Mapping[str, float] | None = None
) -> list[Finding]:
    """Return findings on one subject (``bus``, ``message X``, ``channel X``) with its figures."""
    return [replace(each, subject=subject, figures=figures or {}) for each in findings]


def open_questions(text: str, name: str = "bench.toml") -> list[Finding]:
    """Return a warning for each mark that is still in a bench.toml or channel map of this name."""
    advice = "find the answer, correct the lines next to the mark if necessary, and delete the mark"
    return [
        Finding(
            "ask",
            Severity.WARNING,
            f"asks: {printable(line.partition(ASK)[2], 160)}",
            f"{name}:{number}",
            advice,
        )
        for number, line in enumerate(text.splitlines(), start=1)
        if ASK in line
    ]
