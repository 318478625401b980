"""A run compared with the accepted runs of its kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.vehicle import Corner
from daq.verdict import RunMeasure
from daq.verdict.motion import not_repeatable, waves
from daq.verdict.window import traces
from dbc.finding import Finding

from .closed_forms import HUB, OTHER, T_S, TRAVEL, Array, pulse, seen, window


def test_the_course_is_the_mean_of_60_ms_every_20_ms() -> None:
    time_s = T_S + 0.0005  # no sample on the edge of a mean
    square = np.where(T_S >= 0.0, time_s**2, 0.0)
    found = waves(seen({TRAVEL: square, HUB: square}, time_s))
    assert list(found) == ["travel"]
    centre_s = 0.1 + 0.02 * np.arange(70)
    assert len(found["travel"]) == 70
    # The mean of t^2 over a width w about c is c^2 + w^2 / 12.
    assert found["travel"] == pytest.approx(centre_s**2 + 0.06**2 / 12, abs=1e-6)


def measure(peak: float, wave: Array | None = None) -> RunMeasure:
    return RunMeasure(
        peaks={"travel": peak}, waves={"travel": np.array([3.0, 4.0]) if wave is None else wave}
    )


def test_a_run_is_compared_with_the_median_of_those_before() -> None:
    records = {TRAVEL: np.where(np.isclose(T_S, 0.1), 1.0, 0.0)}
    before = [measure(0.5), measure(2.0), measure(8.0)]
    by_peak, *course = not_repeatable(seen(records), measure(1.0), before)
    assert (by_peak.value, by_peak.limit, by_peak.subject) == (0.5, 1 / 1.4, "travel")
    assert not by_peak.passed
    assert course == []  # all alike
    by_peak, _ = not_repeatable(seen(records), measure(2.5, np.array([4.0, -3.0])), before)
    assert (by_peak.value, by_peak.limit) == (1.25, 1.4)
    assert list(not_repeatable(seen(records), measure(1.0), [])) == []
    (by_peak,) = not_repeatable(seen(records), measure(2.0), before)
    assert (by_peak.passed, by_peak.value, by_peak.subject) == (True, 1.0, "")


@pytest.mark.parametrize(
    ("accepted", "unlike", "like"),
    [
        ([2.0], [], None),
        ([2.0], [1.0], (1, 1)),  # one of each: the accepted one may be the odd one
        ([2.0, 1.1], [1.0], (2, 1)),
        ([2.0, 2.1], [1.0], None),
        ([2.0, 2.1], [1.0, 1.1], (2, 2)),
        ([2.0], [0.1], None),
    ],
)
def test_a_first_run_that_is_odd_does_not_reject_all_others(
    accepted: list[float], unlike: list[float], like: tuple[int, int] | None
) -> None:
    """`like`: of all others those like this one, and of the accepted ones those unlike it."""
    records = {TRAVEL: np.where(np.isclose(T_S, 0.1), 1.0, 0.0)}
    before, doubted = ([measure(peak) for peak in peaks] for peaks in (accepted, unlike))
    found = list(not_repeatable(seen(records), measure(1.0), before, doubted))
    assert all(finding.passed for finding in found) is (like is not None)
    if like:
        assert (found[0].value, found[0].limit) == like


def test_a_course_at_right_angles_is_not_alike() -> None:
    records = {TRAVEL: np.where(np.isclose(T_S, 0.1), 1.0, 0.0)}
    _, course = not_repeatable(seen(records), measure(1.0, np.array([4.0, -3.0])), [measure(1.0)])
    assert course.value == pytest.approx(0.0)
    assert (course.limit, course.passed) == (0.85, False)
    still = measure(1.0, np.zeros(2))
    _, course = not_repeatable(seen(records), still, [measure(1.0)])
    assert (course.value, course.passed) == (0.0, False)
    unknown = RunMeasure(peaks={"travel": 1.0})
    for own, before in ((unknown, measure(1.0)), (measure(1.0, np.array([4.0, -3.0])), unknown)):
        assert len(list(not_repeatable(seen(records), own, [before]))) == 1


"""Rest, strikes, gaps and likeness where two rules meet, by records of closed form."""


def compared(peaks: dict[str, float], before: dict[str, float]) -> Finding:
    records = {TRAVEL: pulse(peaks["travel"]), OTHER: pulse(peaks["other"])}
    finding, *_ = not_repeatable(seen(records), RunMeasure(peaks=peaks), [RunMeasure(peaks=before)])
    return finding


@pytest.mark.parametrize(
    ("travel", "other", "subject", "limit", "passed"),
    [(0.5, 1.9, "travel", 1 / 1.4, False), (0.6, 1.5, "travel", 1 / 1.4, False),
     (0.7, 1.5, "other", 1.4, False), (0.8, 1.2, "travel", 1 / 1.4, True),
     (0.9, 1.2, "other", 1.4, True), (1.0, 1.4, "other", 1.4, True)],
)  # fmt: skip
def test_half_and_twice_the_size_are_equally_far_from_equal(
    travel: float, other: float, subject: str, limit: float, passed: bool
) -> None:
    finding = compared({"travel": travel, "other": other}, {"travel": 1.0, "other": 1.0})
    assert (finding.passed, finding.subject) == (passed, subject)
    assert finding.limit == pytest.approx(limit)


def test_a_channel_that_stands_still_in_one_run_alone_differs_without_bounds() -> None:
    dead = compared({"travel": 0.0, "other": 1.0}, {"travel": 1.0, "other": 1.0})
    alive = compared({"travel": 1.0, "other": 1.0}, {"travel": 0.0, "other": 1.0})
    assert (dead.passed, alive.passed) == (False, False)
    assert (dead.value, alive.value) == pytest.approx((1e-12, 1e12))


"""Every limit of the verdict from both sides, by records of closed form with a known property."""


def run_like(peak: float, like: float = 1.0, small: float = 0.0) -> RunMeasure:
    """Return a run whose wave has the correlation `like` with that of `run_like(1.0)`."""
    wave = np.array([like, np.sqrt(1.0 - like**2)])
    return RunMeasure(peaks={"travel": peak, "small": small}, waves={"travel": wave})


SMALL = replace(TRAVEL, name="small", corner=Corner.FRONT_RIGHT)


@pytest.mark.parametrize(
    ("peak", "passed"), [(1.39, True), (1.41, False), (1 / 1.39, True), (1 / 1.41, False)]
)
def test_a_peak_may_differ_by_the_factor_1_4(peak: float, passed: bool) -> None:
    bench, run = window({TRAVEL: pulse(peak), SMALL: pulse(0.0)})
    shown = traces(bench.channels, run)
    findings = list(not_repeatable(shown, run_like(peak), [run_like(1.0)]))
    assert findings[0].passed is passed


@pytest.mark.parametrize(("like", "passed"), [(0.84, False), (0.86, True)])
def test_a_course_is_85_percent_alike(like: float, passed: bool) -> None:
    bench, run = window({TRAVEL: pulse(1.0), SMALL: pulse(0.0)})
    shown = traces(bench.channels, run)
    by_peak, by_course = not_repeatable(shown, run_like(1.0, like), [run_like(1.0)])
    assert by_peak.passed
    assert by_course.passed is passed


@pytest.mark.parametrize(("size", "counts"), [(0.29, False), (0.31, True)])
def test_a_channel_counts_from_three_tenths_of_the_largest_on(size: float, counts: bool) -> None:
    bench, run = window({TRAVEL: pulse(1.0), SMALL: pulse(size)})
    shown = traces(bench.channels, run)
    findings = list(not_repeatable(shown, run_like(1.0, small=size), [run_like(1.0, small=0.1)]))
    assert findings[0].passed is not counts
