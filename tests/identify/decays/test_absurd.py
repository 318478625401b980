"""Values that no sensor shows are missing, and named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import Run, RunStatus, SampleGroup
from daq.sessions import Session
from identify.decays.absurd import Absurd, absurd, readable_session
from identify.decays.usable import usable
from identify.pipeline import identify_parameters
from identify.trust.shortcomings import unused_findings

from ..stress import stress_session

Values = NDArray[np.float64]
SPOILT = "baseline_bounce_2"
NAME = "body_acc_z"


def spoilt(session: Session, change: Callable[[Values], Values], run: str = SPOILT) -> Session:
    """Change the values of a channel in the runs whose label begins so."""

    def of_group(group: SampleGroup) -> SampleGroup:
        if NAME not in group.values:
            return group
        return replace(group, values={**group.values, NAME: change(group.values[NAME].copy())})

    def of_run(one: Run) -> Run:
        hit = one.label.startswith(run)
        return replace(one, groups=tuple(map(of_group, one.groups))) if hit else one

    return replace(session, runs=tuple(map(of_run, session.runs)))


def one_sample(value: float) -> Callable[[Values], Values]:
    def change(values: Values) -> Values:
        values[400] = value
        return values

    return change


@pytest.fixture(scope="module")
def campaign() -> Session:
    return stress_session("linear", 1)


@pytest.mark.parametrize("value", [1e200, -1e308, np.inf, -np.inf, 1.1e6])
def test_a_sample_that_no_sensor_shows_is_missing(campaign: Session, value: float) -> None:
    bad = spoilt(campaign, one_sample(value))
    assert list(absurd(bad)) == [Absurd(NAME, SPOILT, 1, value)]
    run = next(run for run in readable_session(bad).runs if run.label == SPOILT)
    (found,) = (group.values[NAME] for group in run.groups if NAME in group.values)
    assert np.flatnonzero(np.isnan(found)).tolist() == [400]


@pytest.mark.parametrize("value", [0.9e6, -0.9e6, np.nan, 1e-9])
def test_a_large_a_small_and_a_missing_sample_stay(campaign: Session, value: float) -> None:
    session = spoilt(campaign, one_sample(value))
    assert list(absurd(session)) == []
    same = readable_session(session)
    assert all(a is b for a, b in zip(same.runs, session.runs, strict=True)), "nothing is copied"


def test_what_is_not_used_may_show_anything(campaign: Session) -> None:
    bad = spoilt(campaign, one_sample(np.inf))
    runs = tuple(replace(run, status=RunStatus.REJECTED) for run in bad.runs)
    assert list(absurd(replace(bad, runs=runs))) == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("where", "change", "code"),
    [
        (SPOILT, one_sample(1e200), "lost_samples"),
        (SPOILT, lambda v: np.full_like(v, 1e308), "missing_channels"),
        ("", lambda v: v * 1e200, "missing_channels"),
        ("", lambda v: np.where(v > 0, 1e-310, 0.0), "dead_channels"),
    ],
    ids=["sample", "run", "channel", "denormals"],
)
def test_a_vehicle_is_identified_beside_them(
    campaign: Session, where: str, change: Callable[[Values], Values], code: str
) -> None:
    """It ended with a warning of NumPy or an OverflowError, or took minutes."""
    found = identify_parameters(spoilt(campaign, change, where))
    codes = [finding.code for finding in found.quality.findings]
    assert code in codes
    assert ("absurd_values" in codes) == (code != "dead_channels")
    assert found.quality.verdict != "refused"
    m_s = found.parameters["m_s"]
    assert m_s.low < identify_parameters(campaign).parameters["m_s"].value < m_s.high


def test_they_are_named_with_their_number_and_the_first(campaign: Session) -> None:
    bad = spoilt(campaign, one_sample(1e200))
    (finding,) = unused_findings(bad, usable(bad))
    assert finding.code == "absurd_values"
    assert "body_acc_z in baseline_bounce_2 (1: 1e+200 m/s2)" in finding.text
