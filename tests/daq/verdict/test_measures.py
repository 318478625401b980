"""The measures of a run against closed forms: peaks, noise, the wave of the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Step
from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict import RunMeasure, judge
from daq.verdict.motion import body_wave, not_repeatable, waves
from daq.verdict.window import traces
from dbc.finding import Finding

from .closed_forms import (
    BODY,
    HEIGHT,
    HUB,
    OTHER,
    PITCH,
    T_S,
    TILT,
    TRAVEL,
    TURN,
    Array,
    bench_of,
    noisy,
    pulse,
    ringing,
    run_of,
    seen,
    window,
)

FRONT = (Corner.FRONT_LEFT, Corner.FRONT_RIGHT)
BOUNCE = Step(BASELINE, Excitation.BOUNCE, 1)


@pytest.mark.parametrize(
    ("frequency_hz", "damping"),
    [(1.05, 0.25), (1.6, 0.4), (0.45, 0.2), (4.6, 0.03)],
)
@pytest.mark.parametrize("channel", [TRAVEL, PITCH, BODY, HEIGHT, TURN])
def test_the_wave_of_the_body(channel: Channel, frequency_hz: float, damping: float) -> None:
    wave = body_wave(seen({channel: ringing(frequency_hz, damping)}), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(frequency_hz, rel=0.0035)
    assert wave[1] == pytest.approx(damping, abs=0.0025)


def test_the_wave_is_of_what_shows_the_body_best() -> None:
    slow, quick = ringing(0.8, 0.2), ringing(2.4, 0.1)
    order = [(TRAVEL, PITCH), (PITCH, HEIGHT), (BODY, HEIGHT), (HEIGHT, TURN)]
    for first, second in order:
        for channels in ((first, second), (second, first)):
            records = {c: slow if c is first else quick for c in channels}
            wave = body_wave(seen(records), 0.2)
            assert wave is not None
            assert wave[0] == pytest.approx(0.8, rel=0.01)
    assert body_wave(seen({HUB: slow}), 0.2) is None


@pytest.mark.parametrize(("ratio", "shows"), [(4.9, False), (5.1, True)])
def test_a_wave_is_searched_for_from_five_times_the_noise_on(ratio: float, shows: bool) -> None:
    size = float(np.max(np.abs(ringing(1.0, 0.1))))
    records = {TRAVEL: noisy(ringing(1.0, 0.1), size / ratio)}
    assert (body_wave(seen(records), 0.2) is not None) is shows


@pytest.mark.parametrize(("stop_s", "shows"), [(1.39, False), (1.42, True)])
def test_a_wave_needs_a_second_after_the_bump(stop_s: float, shows: bool) -> None:
    """The wheels come to rest 0.2 s after the bump of 0.2 s."""
    short = stop_s > T_S
    found = seen({TRAVEL: ringing(1.5, 0.1)[short]}, T_S[short])
    assert (body_wave(found, 0.2) is not None) is shows


def test_a_trace_is_the_deviation_from_rest() -> None:
    rest = np.resize([1.0, 1.0, 3.0], len(T_S))  # median 1, mean 5/3
    value = np.where(T_S < -0.0301, rest, 1.0)
    value[T_S == 0.0] = 7.0
    value[T_S == 1.0] = -8.0
    (trace,) = seen({TRAVEL: value})
    assert trace.peak == 9.0
    assert trace.moved == pytest.approx(np.sqrt(8 / 9), rel=1e-3)
    assert trace.noise == pytest.approx(2 * np.sqrt(2 / 3) / np.sqrt(2), rel=2e-3)
    assert list(trace.part(-0.001, 0.002)) == [0.0, 6.0, 0.0]
    assert replace(trace, noise=0.0).rms(0.0, 0.004) == 3.0
    assert replace(trace, noise=3.0).rms(0.0, 0.002) == 3.0
    assert replace(trace, noise=5.0).rms(0.0, 0.002) == 0.0
    assert replace(trace, noise=0.0).rms(5.0, 6.0) == 0.0


def test_a_channel_with_eight_samples_and_rest_before_the_bump_counts() -> None:
    time_s = np.array([-0.5, -0.4, -0.031, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert len(seen({TRAVEL: time_s}, time_s)) == 1
    assert len(seen({TRAVEL: time_s[1:]}, time_s[1:])) == 0
    late = np.array([-0.029, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert len(seen({TRAVEL: late}, late)) == 0
    gap = np.where(time_s == 0.2, np.nan, time_s)
    assert len(seen({TRAVEL: gap}, time_s)) == 0
    unused = Channel("unused", Quantity.UNUSED, "m", "S.u")
    assert len(seen({unused: time_s}, time_s)) == 0


def test_judge_publishes_peaks_by_kind_wave_and_purity() -> None:
    def pulse(height: float) -> Array:
        return np.where(np.isclose(T_S, 0.1), height, 0.0)

    records = {
        HUB: pulse(40.0),
        BODY: pulse(-3.0),
        TILT: pulse(99.0),
        PITCH: pulse(77.0),
        TRAVEL: pulse(0.05) + ringing(1.3, 0.2, 0.03),
        HEIGHT: pulse(-0.08),
    }
    findings, found = judge(bench_of(*records), BOUNCE, run_of(records), [])
    assert found.peaks["tilt"] == 99.0
    assert set(found.waves) == {"body", "tilt", "pitch", "travel", "height"}
    motion = findings[-1]
    assert (motion.code, motion.unit) == ("motion", "Hz")
    assert motion.value == pytest.approx(1.3, rel=0.01)
    assert motion.text.startswith("peak 40.0 m/s2, 80 mm, f 1.30 Hz, zeta 0.2")


def test_judge_names_the_purity_of_the_kind_that_was_due() -> None:
    hop = np.where((T_S > 0.0) & (T_S < 0.5), 20.0 * np.sin(20 * np.pi * T_S), 0.0)
    hubs = {
        replace(HUB, name=corner.value, corner=corner): hop * (corner in FRONT) for corner in Corner
    }
    for kind, purity in (("pitch", 1.0), ("bounce", 0.5), ("roll", 0.25)):
        step = Step(BASELINE, Excitation(kind), 1)
        findings, found = judge(bench_of(*hubs), step, run_of(hubs), [])
        assert found.wheels == (frozenset(FRONT) if kind == "pitch" else None)
        assert findings[-1].text == f"peak 20.0 m/s2, {purity:.0%} pure"
        assert findings[-1].value == 0.0


def test_nothing_to_judge_is_one_finding() -> None:
    findings, found = judge(bench_of(TRAVEL), BOUNCE, run_of({TRAVEL: T_S[:5]}, T_S[:5]), [])
    assert [f.code for f in findings] == ["stale", "no_data"]
    assert (findings[-1].passed, findings[-1].value, findings[-1].limit) == (False, 0.0, 1.0)
    assert found == RunMeasure()


"""Rest, strikes, gaps and likeness where two rules meet, by records of closed form."""


# A run compared with the accepted runs of its kind ------------------------------------------------


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
