"""Hostile logs: damaged at random, cut off, foreign."""

from __future__ import annotations

from .mutations import campaign


def test_mutants_of_every_format_are_read_or_refused_in_one_line() -> None:
    outcome = campaign(8)
    assert not outcome.faults
    assert outcome.ends["read with losses"] > 8
    assert outcome.ends["refused"] > 0
