"""Finds the questions that a proposal left in bench.toml; the check repeats them until answered."""

from __future__ import annotations

from dbc.errors import printable
from dbc.finding import Finding, Severity

ASK = "# ASK: "
"""Beginning of a mark of `daq.check.propose`, on a separate line or after a value."""


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
