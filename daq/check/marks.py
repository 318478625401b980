"""Questions that a proposal left in bench.toml: the check asks them until they are answered."""

from __future__ import annotations

from dbc.errors import printable
from dbc.finding import Finding, Severity

ASK = "# ASK: "
"""Begins a mark of `daq.check.propose` in a line of its own, or behind a value."""


def open_questions(text: str, name: str = "bench.toml") -> list[Finding]:
    """Return a warning for each mark that is still in a bench.toml or channel map of this name."""
    advice = "find out, correct the lines beside it if need be, and delete the mark"
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
