"""Rest, size, strikes, decay, wave and likeness of runs, by records of closed form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Method, Step
from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict.checks import (
    double_bump,
    not_at_rest,
    not_decayed,
    rest_changed,
    too_strong,
    too_weak,
)
from daq.verdict.judge import body_wave, judge, not_repeatable, slow_motion
from daq.verdict.window import RunMeasure, traces
from dbc.words import Finding

from .closed_forms import (
    BEFORE,
    BODY,
    HEIGHT,
    HUB,
    OTHER,
    PITCH,
    ROLL,
    T_S,
    TILT,
    TRAVEL,
    TURN,
    TURNS,
    Array,
    Check,
    bench_of,
    found,
    noisy,
    one,
    pulse,
    ringing,
    run_of,
    seen,
    window,
)


@pytest.mark.parametrize(("rms", "passed"), [(0.029, True), (0.031, False)])
def test_at_rest_is_three_percent_of_the_peak(rms: float, passed: bool) -> None:
    whole = np.sin(2 * np.pi * T_S / 0.97) * (T_S < -0.0301)  # one period
    value = np.sqrt(2.0) * rms * whole + pulse(1.0)
    assert one(not_at_rest, {TRAVEL: value}).passed is passed


@pytest.mark.parametrize(("slow_rms", "passed"), [(0.40, True), (0.43, False)])
def test_at_rest_is_three_times_the_noise(slow_rms: float, passed: bool) -> None:
    """Samples at +0.1 and -0.1 in turn look like white noise of 0.1 sqrt(2): the limit is 0.424."""
    before = T_S < -0.0301
    alternating = np.where(np.arange(len(T_S)) % 2, 0.1, -0.1)
    slow = np.sqrt(2.0) * slow_rms * np.sin(2 * np.pi * T_S / 0.97)
    finding = one(not_at_rest, {TRAVEL: (alternating + slow) * before + pulse(1.0)})
    assert finding.limit == pytest.approx(0.424, abs=0.005)
    assert finding.value == pytest.approx(np.hypot(slow_rms, 0.1), abs=0.005)
    assert finding.passed is passed


@pytest.mark.parametrize(("peak", "passed"), [(5.95, False), (6.0, True)])
def test_a_bump_reaches_twice_the_level_of_the_trigger(peak: float, passed: bool) -> None:
    assert one(too_weak, {HUB: pulse(peak)}).passed is passed  # the trigger is set to 3 m/s2


@pytest.mark.parametrize(("peak", "passed"), [(9.9, False), (10.1, True)])
def test_a_bump_is_ten_times_the_noise(peak: float, passed: bool) -> None:
    """Samples at 0, 1, 0 and -1 in turn differ by 1 each: white noise of sqrt(1/2) does, too."""
    noise = np.sqrt(0.5)
    turn = np.resize([0.0, 1.0, 0.0, -1.0], len(T_S))
    value = np.where(T_S < -0.0301, turn, 0.0) + pulse(peak * noise)
    finding = one(too_weak, {TRAVEL: value})
    assert finding.passed is passed
    assert finding.value == pytest.approx(peak, rel=0.003)


@pytest.mark.parametrize(("travel_m", "passed"), [(0.0749, True), (0.075, True), (0.0751, False)])
def test_travel_may_exceed_the_planned_height_by_half(travel_m: float, passed: bool) -> None:
    finding = one(too_strong, {TRAVEL: pulse(travel_m)})  # 50 mm are planned
    assert finding.passed is passed
    assert "75 mm (limit 75 mm: 1.5 times the planned height)" in finding.text, finding.text
    assert not found(too_strong, {HUB: pulse(100.0)})


def strikes(second: float, at_s: float) -> Array:
    """Return two equal bursts of a wheel's hop, the second one scaled."""

    def burst(start_s: float) -> Array:
        within = (start_s <= T_S) & (start_s + 0.1 > T_S)
        return np.where(within, np.sin(2 * np.pi * 40.0 * (T_S - start_s)), 0.0)

    return 30.0 * (burst(0.0) + second * burst(at_s))


@pytest.mark.parametrize(("second", "passed"), [(0.24, True), (0.26, False)])
def test_a_second_strike_is_a_quarter_of_the_first(second: float, passed: bool) -> None:
    finding = one(double_bump, {HUB: strikes(second, 1.2)})
    assert finding.passed is passed
    if not passed:
        assert finding.value == pytest.approx(second, rel=0.02)
        assert "at +1.20 s" in finding.text


@pytest.mark.parametrize(("at_s", "passed"), [(0.47, True), (0.51, False)])
def test_a_wheel_that_lands_is_no_second_strike(at_s: float, passed: bool) -> None:
    """The bump is over after 0.2 s; what comes 0.25 s later at most belongs to it.

    The energy is that of 0.1 s about each instant: a strike within shows its tail only.
    """
    assert one(double_bump, {HUB: strikes(0.8, at_s)}).passed is passed


@pytest.mark.parametrize(("rise", "passed"), [(2.9, True), (3.1, False)])
def test_a_second_strike_rises_to_three_times_the_motion_before(rise: float, passed: bool) -> None:
    """A wheel hops on evenly, then to 0.6 of the first strike, then evenly again."""
    low = 0.6 / rise
    height = np.select([T_S < 0.0, T_S < 0.3, T_S < 1.2, T_S < 1.5], [0.0, 1.0, low, 0.6], low)
    hop = 30.0 * height * np.sin(2 * np.pi * 40.0 * T_S)
    assert one(double_bump, {HUB: hop}).passed is passed


def test_the_body_that_swings_back_is_no_second_strike() -> None:
    later = np.clip((T_S - 1.0) / 1.4, 0.0, 1.0)
    assert one(double_bump, {HUB: strikes(0.0, 1.2) + 15.0 * np.sin(np.pi * later) ** 2}).passed


def swing(left: float) -> Array:
    """Return a swing at 2 Hz of amplitude 1, and of `left` in the last second."""
    amplitude = np.where(T_S < 1.0, 1.0, np.where(T_S < 1.5, 0.5, left))
    return np.where(T_S > 0.0, amplitude * np.sin(2 * np.pi * 2.0 * T_S), 0.0)


@pytest.mark.parametrize(("left", "passed"), [(0.145, True), (0.155, False)])
def test_fifteen_percent_of_the_motion_may_be_left(left: float, passed: bool) -> None:
    finding = one(not_decayed, {TRAVEL: swing(left)})
    assert finding.passed is passed
    assert finding.value == pytest.approx(left, rel=0.01)


@pytest.mark.parametrize(("moved_m", "passed"), [(0.0099, True), (-0.0099, True), (0.0101, False),
                                                 (-0.0101, False)])  # fmt: skip
def test_the_rest_position_may_change_by_a_fifth_of_the_peak(moved_m: float, passed: bool) -> None:
    value = pulse(0.05) + np.where(T_S > 0.5, moved_m, 0.0)
    finding = one(rest_changed, {TRAVEL: value})
    assert finding.passed is passed
    assert finding.limit == pytest.approx(0.01)


def by(method: Method, check: Check, records: Mapping[Channel, Array]) -> list[Finding]:
    bench, run = window(records)
    bench = replace(bench, campaign=replace(bench.campaign, method=method))
    return list(check(bench, run, traces(bench.channels, run)))


@pytest.mark.parametrize(
    ("small", "large", "passed"),
    [(PITCH, ROLL, True), (ROLL, PITCH, True), (TURN, TILT, True), (TILT, TURN, True),
     (PITCH, TURN, False), (TURN, ROLL, False), (PITCH, BODY, False), (HUB, BODY, False)],
)  # fmt: skip
def test_a_channel_rests_by_the_largest_peak_of_its_kind(
    small: Channel, large: Channel, passed: bool
) -> None:
    """It moves by 0.02 before: too much for its own peak of 0.1, but not for another of 1."""
    slow = np.sqrt(2.0) * 0.02 * np.sin(2 * np.pi * T_S / 0.97) * BEFORE
    finding = one(not_at_rest, {small: slow + pulse(0.1), large: pulse(1.0)})
    assert finding.passed is passed
    assert finding.limit == pytest.approx(0.03 if passed else 0.003)


def travel(corner: Corner, ratio: float) -> tuple[Channel, Array]:
    channel = replace(TRAVEL, name=f"travel_{corner}", corner=corner)
    return channel, TURNS * BEFORE + pulse(ratio * np.sqrt(0.5))


def test_a_bump_below_the_triggers_level_is_named_alone() -> None:
    findings = found(too_weak, {HUB: pulse(5.0), **dict([travel(Corner.FRONT_LEFT, 9.0)])})
    assert [(f.passed, f.subject, f.limit) for f in findings] == [(False, "hub", 6.0)]
    quiet = found(too_weak, {TRAVEL: pulse(1.0)})  # no noise at all: nothing to compare with
    assert quiet == []


@pytest.mark.parametrize(("at_s", "passed"), [(1.17, True), (1.24, False)])
def test_a_push_and_its_release_are_one_strike(at_s: float, passed: bool) -> None:
    """A second after the bump of 0.2 s, less half of the tenth in which energy is taken."""
    (finding,) = by(Method.PUSH, double_bump, {HUB: strikes(0.8, at_s)})
    assert finding.passed is passed
    (rolled,) = by(Method.ROLL_OVER, double_bump, {HUB: strikes(0.8, at_s)})
    assert not rolled.passed


# Measures of a run, and their likeness to those of other runs ------------------------------------

BOUNCE = Step(BASELINE, Excitation.BOUNCE, 1)


@pytest.mark.parametrize("wave", [(1.05, 0.25), (1.6, 0.4), (0.45, 0.2), (4.6, 0.03)])
def test_the_wave_of_the_body(wave: tuple[float, float]) -> None:
    for channel in (TRAVEL, PITCH, BODY, HEIGHT, TURN):
        assert body_wave(seen({channel: ringing(*wave)}), 0.2) == pytest.approx(wave)
    assert body_wave(seen({HUB: ringing(*wave)}), 0.2) is None
    assert body_wave(seen({TRAVEL: pulse(1.0)}), 0.2) is None  # at rest again


@pytest.mark.parametrize(
    ("peak_to_noise", "stop_s", "shows"),
    [(5.1, 1.42, True), (4.9, 1.42, False), (5.1, 1.39, False)],
)
def test_a_wave_is_clear_of_the_noise_and_a_second_long(
    peak_to_noise: float, stop_s: float, shows: bool
) -> None:
    """The wheels come to rest 0.2 s after the bump of 0.2 s."""
    wave, short = ringing(1.5, 0.1), stop_s > T_S
    value = noisy(wave, float(np.max(np.abs(wave))) / peak_to_noise)
    assert (body_wave(seen({TRAVEL: value[short]}, T_S[short]), 0.2) is not None) is shows


def test_the_wave_is_of_what_shows_the_body_best() -> None:
    slow, quick = ringing(0.8, 0.2), ringing(2.4, 0.1)
    order = [(TRAVEL, PITCH), (PITCH, HEIGHT), (BODY, HEIGHT), (HEIGHT, TURN)]
    for first, second in order:
        for channels in ((first, second), (second, first)):
            records = {c: slow if c is first else quick for c in channels}
            wave = body_wave(seen(records), 0.2)
            assert wave is not None
            assert wave[0] == pytest.approx(0.8, rel=0.01)


def test_a_trace_is_the_deviation_from_rest() -> None:
    rest = np.resize([1.0, 1.0, 3.0], len(T_S))  # median 1, mean 5/3
    value = np.where(T_S < -0.0301, rest, 1.0)
    value[T_S == 0.0] = 7.0
    value[T_S == 1.0] = -8.0
    (trace,) = seen({TRAVEL: value})
    assert trace.peak == 9.0
    assert trace.rest_rms == pytest.approx(np.sqrt(8 / 9), rel=1e-3)
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


def test_nothing_to_judge_is_one_finding() -> None:
    findings, found = judge(bench_of(TRAVEL), BOUNCE, run_of({TRAVEL: T_S[:5]}, T_S[:5]), [])
    assert [f.code for f in findings] == ["stale", "no_data"]
    assert (findings[-1].passed, findings[-1].value, findings[-1].limit) == (False, 0.0, 1.0)
    assert found == RunMeasure()


# A run compared with the accepted runs of its kind ------------------------------------------------


def test_the_course_is_the_mean_of_60_ms_every_20_ms() -> None:
    time_s = T_S + 0.0005  # no sample on the edge of a mean
    square = np.where(T_S >= 0.0, time_s**2, 0.0)
    found = slow_motion(seen({TRAVEL: square, HUB: square}, time_s))
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
    by_peak, course = not_repeatable(seen(records), measure(1.0), before)
    assert (by_peak.value, by_peak.limit, by_peak.subject) == (0.5, 1 / 1.4, "travel")
    assert not by_peak.passed
    assert (course.passed, course.value) == (True, 1.0)
    by_peak, _ = not_repeatable(seen(records), measure(2.5, np.array([4.0, -3.0])), before)
    assert (by_peak.value, by_peak.limit) == (1.25, 1.4)
    by_peak, _ = not_repeatable(seen(records), measure(2.0), before)
    assert (by_peak.passed, by_peak.value) == (True, 1.0)


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
    assert list(not_repeatable(seen(records), unknown, [RunMeasure(), unknown])) == []


@pytest.mark.parametrize(
    ("travel", "other", "subject", "passed"),
    [(0.5, 1.9, "travel", False), (0.8, 1.2, "travel", True), (0.8, 1.3, "other", True),
     (1.0, 1.39, "other", True), (1.0, 1.41, "other", False), (1 / 1.39, 1.0, "travel", True),
     (1 / 1.41, 1.0, "travel", False)],
)  # fmt: skip
def test_a_peak_may_differ_by_the_factor_1_4_up_or_down(
    travel: float, other: float, subject: str, passed: bool
) -> None:
    records = {TRAVEL: pulse(travel), OTHER: pulse(other)}
    usual, peaks = {"travel": 1.0, "other": 1.0}, {"travel": travel, "other": other}
    by_peak, *_ = not_repeatable(seen(records), RunMeasure(peaks=peaks), [RunMeasure(peaks=usual)])
    assert (by_peak.passed, by_peak.subject) == (passed, subject)
    assert by_peak.limit == pytest.approx(1.4 if subject == "other" else 1 / 1.4)


@pytest.mark.parametrize(
    ("like", "small", "by_peak", "by_course"),
    [(0.84, 0.0, True, False), (0.86, 0.0, True, True), (1.0, 0.29, True, True),
     (1.0, 0.31, False, True)],
)  # fmt: skip
def test_a_course_is_85_percent_alike_and_channels_of_three_tenths_of_the_largest_count(
    like: float, small: float, by_peak: bool, by_course: bool
) -> None:
    def run_like(like: float, small: float) -> RunMeasure:
        wave = np.array([like, np.sqrt(1.0 - like**2)])
        return RunMeasure(peaks={"travel": 1.0, "other": small}, waves={"travel": wave})

    shown = seen({TRAVEL: pulse(1.0), OTHER: pulse(small)})
    findings = list(not_repeatable(shown, run_like(like, small), [run_like(1.0, 0.1)]))
    assert findings[0].passed is by_peak
    assert all(finding.passed for finding in findings[1:]) is by_course
