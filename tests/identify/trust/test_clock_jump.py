"""Clocks that jump by less than a silence in every run are named before a car's elements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from daq.runs import Run, SampleGroup
from daq.sessions import Session
from dbc.finding import Severity
from identify.pipeline import identify, identify_parameters

from .campaigns import by_gate, campaign, with_runs

JUMP_S = 0.1
AT_S = 2.0
"""Half of each run; the decays begin at about 1.1 s."""


def jumped(group: SampleGroup) -> SampleGroup:
    return replace(group, time_s=group.time_s + JUMP_S * (group.time_s > AT_S))


def lost(group: SampleGroup) -> SampleGroup:
    kept = (group.time_s <= AT_S) | (group.time_s > AT_S + JUMP_S)
    values = {name: column[kept] for name, column in group.values.items()}
    quality, t_ns = group.quality[kept], group.t_ns[kept]
    return replace(group, time_s=group.time_s[kept], t_ns=t_ns, quality=quality, values=values)


def with_clock(
    change: Callable[[SampleGroup], SampleGroup], names: set[str] | None, begins: str = ""
) -> Session:
    def of_run(run: Run) -> Run:
        if not run.label.startswith(begins):
            return run
        groups = (change(g) if names is None or g.name in names else g for g in run.groups)
        return replace(run, groups=tuple(groups))

    return with_runs(campaign("linear", 1), of_run)


@pytest.mark.parametrize(("names", "told"), [(None, "all sensors"), ({"body_acc_z"}, "body_acc_z")])
def test_clocks_that_jump_in_every_run_are_named_first(names: set[str] | None, told: str) -> None:
    """A car's elements were sought for one to several minutes, and fitted to it."""
    findings = identify_parameters(with_clock(jumped, names)).quality.findings
    first = findings[0]
    assert (first.code, first.severity) == ("clocks_that_jump", Severity.ERROR)
    assert f"clocks that jump ({told} by about 0.1 s in 12 of 12 runs" in first.text


def test_a_group_whose_clock_jumps_before_the_decay_is_late_in_all_of_it() -> None:
    def early(group: SampleGroup) -> SampleGroup:
        return replace(group, time_s=group.time_s + JUMP_S * (group.time_s > 1.0))

    found = by_gate(identify_parameters(with_clock(early, {"body_acc_z"})).quality.findings)
    assert "body_acc_z by about 0.1 s" in found["clocks_that_jump"].text


def all_jump(at_s: float) -> Session:
    def change(group: SampleGroup) -> SampleGroup:
        return replace(group, time_s=group.time_s + JUMP_S * (group.time_s > at_s))

    return with_clock(change, None)


def test_clocks_that_all_jump_soon_after_the_bump_are_named_by_what_fits_after_it() -> None:
    """The bump ends at 1.2 s."""
    found = identify(all_jump(1.27))
    assert found.quality.findings[0].code == "clocks_that_jump"
    assert "all sensors by about 0.1 s in 12 of 12 runs; from there" in found.quality.reasons[0]


@pytest.mark.long
def test_a_jump_that_a_later_start_leaves_out_is_a_late_start() -> None:
    found = by_gate(identify_parameters(all_jump(1.22)).quality.findings)
    assert "late_start" in found
    assert "clocks_that_jump" not in found


def test_a_lost_piece_is_no_jump() -> None:
    found = identify_parameters(with_clock(lost, None))
    assert "clocks_that_jump" not in by_gate(found.quality.findings)
    assert found.quality.verdict == "ok"
    m_s = found.parameters["m_s"]
    whole = identify_parameters(campaign("linear", 1)).parameters["m_s"]
    assert np.isclose(m_s.value, whole.value, rtol=0.0, atol=m_s.high - m_s.value)
