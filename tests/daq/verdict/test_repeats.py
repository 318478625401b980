"""Runs of a kind compared: one with those accepted, and all where there are more than planned."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict import RunMeasure
from daq.verdict.repeats import left_out, not_repeatable, roughness, waves
from daq.verdict.window import traces
from dbc.finding import Finding

from .. import spoiled_campaigns
from ..spoiled_campaigns import BUMP_S, bench, campaign
from .closed_forms import BODY, HUB, OTHER, T_S, TRAVEL, Array, pulse, seen, window


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


def rough_of(value: Array) -> float:
    bench, run = window({BODY: value})
    return roughness(traces(bench.channels, run))["body"]


@pytest.mark.parametrize(
    ("start_s", "stop_s", "rough"),
    [(-1.0, 0.044, False), (-1.0, 0.058, True), (0.542, 2.5, True), (0.556, 2.5, False)],
)
def test_a_sensor_is_rough_from_50_ms_to_550_ms_after_the_bump(
    start_s: float, stop_s: float, rough: bool
) -> None:
    value = np.where((start_s < T_S) & (stop_s > T_S), np.where(np.arange(len(T_S)) % 2, 1, -1), 0)
    assert (rough_of(value.astype(float)) > 0.01) is rough


"""The runs of a kind that belong together, where there are more than planned."""
CHANNELS = (
    Channel("body", Quantity.BODY_ACCELERATION, "m/s2", "B.a"),
    Channel("travel", Quantity.SUSPENSION_TRAVEL, "m", "S.t", corner=Corner.FRONT_LEFT),
)
COURSE_S = np.arange(0.1, 1.5, 0.02)


def _run(size: float = 1.0, bend: float = 0.0, **changed: Any) -> RunMeasure:
    wave = size * (
        np.exp(-2.0 * COURSE_S) * (np.cos(8.8 * COURSE_S) + bend * np.sin(20.0 * COURSE_S))
    )
    found = RunMeasure(
        peaks={"body": 3.0 * size, "travel": 0.05 * size},
        waves={"body": wave, "travel": 0.01 * wave},
        levels={"travel": 0.2},
        roughness={"body": 0.03, "travel": 0.0002},
        frequency_hz=1.4,
    )
    return replace(found, **changed)


def _left_out(odd: RunMeasure, others: int = 4, planned: int = 3) -> dict[str, str]:
    measures = {f"run_{k}": _run() for k in range(others)}
    return left_out(CHANNELS, BUMP_S, {**measures, "odd": odd}, planned)


@pytest.mark.parametrize(
    ("planned", "others", "out"), [(3, 3, True), (4, 3, False), (2, 3, True), (1, 2, False)]
)
def test_never_fewer_stay_than_planned_nor_than_three(planned: int, others: int, out: bool) -> None:
    assert (set(_left_out(_run(bend=0.5), others, planned)) == {"odd"}) is out


def test_height_and_timing_of_a_bump_do_not_matter() -> None:
    late = np.exp(-2.0 * (COURSE_S - 0.01)) * np.cos(8.8 * (COURSE_S - 0.01))
    assert _left_out(_run(1.3)) == {}
    assert _left_out(_run(waves={"body": late, "travel": 0.01 * late})) == {}


@pytest.mark.parametrize(("halves", "out"), [(9, True), (10, False)])
def test_a_course_is_the_mean_and_nine_cosines(halves: int, out: bool) -> None:
    """Cosines of so many half periods over the 70 means are at right angles to each other."""
    cosine = np.cos(np.pi * halves * (np.arange(70) + 0.5) / 70)
    wave = np.exp(-2.0 * COURSE_S) * np.cos(8.8 * COURSE_S) + 0.01 * cosine
    runs = {str(k): _run() for k in range(4)}
    runs["odd"] = _run(waves={"body": wave, "travel": 0.01 * wave})
    assert (set(left_out(CHANNELS, 0.0, runs, 3)) == {"odd"}) is out


@pytest.mark.parametrize(
    ("odd", "text"),
    [
        (_run(levels={"travel": 0.2016}), "travel 1.6 mm higher before the bump"),
        (_run(levels={"travel": 0.2014}), ""),
        (_run(bend=0.10), "course of body 8% off"),
        (_run(bend=0.0125), "course of body 1% off"),
        (_run(bend=0.0105), ""),
        (_run(peaks={"body": 3.34, "travel": 0.05}), "peak of body 1.11 times the others'"),
        (_run(peaks={"body": 3.29, "travel": 0.05}), ""),
        (_run(roughness={"body": 0.0575, "travel": 0.0002}), "body 1.8 times as rough"),
        (_run(roughness={"body": 0.0565, "travel": 0.0002}), ""),
        (_run(levels={"travel": 0.21}, frequency_hz=1.47), ", frequency +5%"),
    ],
)
def test_what_a_run_differs_in_is_said(odd: RunMeasure, text: str) -> None:
    found = _left_out(odd)
    assert bool(found) is bool(text)
    assert text in found.get("odd", ""), found


def test_runs_without_measures_are_left_alone() -> None:
    assert _left_out(RunMeasure()) == {}
    assert left_out(CHANNELS, BUMP_S, {"none": RunMeasure()}, 1) == {}
    assert left_out(CHANNELS, BUMP_S, {}, 1) == {}
    assert _left_out(RunMeasure(peaks={"body": 3.0})) == {}


def test_a_simulated_kind_loses_its_spoiled_run_and_no_other() -> None:
    kind = (BASELINE, Excitation.ROLL)
    described = bench()
    found = campaign(5, described, repeats=4, spoiled=1, kinds=[kind])
    labels = [run.label for run in found.session.runs]
    assert all(f.passed for findings in found.findings for f in findings)
    out = left_out(described.channels, BUMP_S, found.of(kind), 3)
    assert set(out) == {labels[i] for i in found.spoiled}


def test_a_first_run_with_a_hand_on_the_car_is_found_by_those_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(spoiled_campaigns, "SPOILS", ("hand on the car",))
    kind = (BASELINE, Excitation.BOUNCE)
    found = campaign(1000, bench(), repeats=5, spoiled=1, kinds=[kind])
    assert list(found.spoiled) == [0]
    passed = [all(f.passed for f in findings) for findings in found.findings]
    assert passed == [True, False, True, True, True]
    first = found.session.runs[0].label
    assert set(left_out(bench().channels, BUMP_S, found.of(kind), 3)) == {first}


@pytest.mark.parametrize(("level_m", "out"), [(0.2115, False), (0.2125, True)])
def test_a_level_is_odd_from_three_times_the_usual_difference_on(level_m: float, out: bool) -> None:
    """Their median is 0.203, from which they differ by 3, 1, 7 and 0 mm: the limit is at 9 mm."""
    levels = dict(zip("abcde", (0.200, 0.204, 0.196, 0.203, level_m), strict=True))
    runs = {label: _run(levels={"travel": level}) for label, level in levels.items()}
    assert set(left_out(CHANNELS, BUMP_S, runs, 3)) == ({"e"} if out else set())


@pytest.mark.parametrize(
    ("peak", "out"), [(3.31, False), (3.32, True), (2.72, False), (2.71, True)]
)
def test_peaks_are_compared_as_they_are_where_no_run_has_a_course(peak: float, out: bool) -> None:
    """A logarithm of 0.1 either way: 3 times 1.105, or 3 / 1.105."""
    runs = {str(k): _run(waves={}) for k in range(4)}
    runs["odd"] = _run(waves={}, peaks={"body": peak, "travel": 0.05})
    assert (set(left_out(CHANNELS, BUMP_S, runs, 3)) == {"odd"}) is out


OTHER_TRAVEL = Channel("other", Quantity.SUSPENSION_TRAVEL, "m", "S.o", corner=Corner.FRONT_RIGHT)
PITCH_RATE = Channel("pitch", Quantity.PITCH_RATE, "rad/s", "B.p")
ROLL_RATE = Channel("roll", Quantity.ROLL_RATE, "rad/s", "B.r")


@pytest.mark.parametrize(
    ("large", "small", "size", "out"),
    [("travel", "other", 0.31, True), ("travel", "other", 0.3, False),
     ("pitch", "roll", 0.29, False), ("pitch", "body", 0.29, True)],
)  # fmt: skip
def test_peaks_count_from_three_tenths_of_the_largest_of_their_kind_on(
    large: str, small: str, size: float, out: bool
) -> None:
    """Half as high as usual; the rates of pitch and roll are of one kind."""
    runs = {str(k): RunMeasure(peaks={large: 1.0, small: size}) for k in range(4)}
    runs["odd"] = RunMeasure(peaks={large: 1.0, small: size / 2})
    found = left_out((*CHANNELS, OTHER_TRAVEL, PITCH_RATE, ROLL_RATE), BUMP_S, runs, 3)
    assert (set(found) == {"odd"}) is out


@pytest.mark.parametrize(("first", "out"), [(0, False), (5, False), (11, True), (40, True)])
def test_a_course_counts_from_80_ms_after_the_bump_on(first: int, out: bool) -> None:
    """Means are every 20 ms from 0.1 s on, and the bump takes 0.2 s: the tenth is at 0.28 s."""
    usual = _run()
    jump = np.where((np.arange(70) >= first) & (np.arange(70) < first + 4), 0.2, 0.0)
    odd = _run(waves={name: wave + jump * (name == "body") for name, wave in usual.waves.items()})
    runs = {**{str(k): usual for k in range(4)}, "odd": odd}
    assert (set(left_out(CHANNELS, 0.2, runs, 3)) == {"odd"}) is out


def test_runs_are_left_out_one_by_one_from_the_oddest_on() -> None:
    levels = {"a": 0.2, "b": 0.2, "c": 0.2, "d": 0.2, "far": 0.23, "near": 0.21}
    runs = {label: _run(levels={"travel": level}) for label, level in levels.items()}
    assert list(left_out(CHANNELS, BUMP_S, runs, 3)) == ["far", "near"]
    assert list(left_out(CHANNELS, BUMP_S, runs, 5)) == ["far"]
