"""Every limit of the verdict from both sides, by records of closed form with a known property."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Campaign
from daq.bench.config import Bench, load_bench
from daq.channels import Channel, Quantity
from daq.runs import Excitation, Losses
from daq.vehicle import Corner
from daq.verdict import RunMeasure, RunWindow
from daq.verdict.body_motion import Body, of_body
from daq.verdict.motion import (
    double_bump,
    not_at_rest,
    not_decayed,
    rest_changed,
    too_strong,
    too_weak,
)
from daq.verdict.pattern import patterns, wrong_mode
from daq.verdict.repeats import not_repeatable
from daq.verdict.traffic import lost_frames, overload, stale
from daq.verdict.window import Trace, traces
from dbc.finding import Finding

Array = NDArray[np.float64]
BUMP_NS = 1_800_000_000_000_000_000
T_S: Array = np.arange(-1000.0, 2500.0) / 1000.0
HUB = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", "HUB.a", corner=Corner.FRONT_LEFT)
TRAVEL = Channel(
    "travel", Quantity.SUSPENSION_TRAVEL, "m", "SUSP.z", corner=Corner.FRONT_LEFT
)  # fmt: skip
BODY = Channel("body", Quantity.BODY_ACCELERATION, "m/s2", "IMU.z")
Check = Callable[[Bench, RunWindow, tuple[Trace, ...]], Iterator[Finding]]


def window(records: Mapping[Channel, Array], time_s: Array = T_S) -> tuple[Bench, RunWindow]:
    """Return a bench of these channels and the run that they show."""
    bench = replace(load_bench(None), channels=tuple(records))
    t_ns = BUMP_NS + np.rint(time_s * 1e9).astype(np.int64)
    return bench, RunWindow(BUMP_NS, {c.name: (t_ns, value) for c, value in records.items()})


def found(check: Check, records: Mapping[Channel, Array], time_s: Array = T_S) -> list[Finding]:
    bench, run = window(records, time_s)
    return list(check(bench, run, traces(bench.channels, run)))


def one(check: Check, records: Mapping[Channel, Array], time_s: Array = T_S) -> Finding:
    (finding,) = found(check, records, time_s)
    return finding


def pulse(height: float) -> Array:
    """Return one sample away from rest, at 0.1 s."""
    return np.where(np.isclose(T_S, 0.1), height, 0.0)


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


@pytest.mark.parametrize(("peak", "passed"), [(5.95, False), (6.05, True)])
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


@pytest.mark.parametrize(("travel_m", "passed"), [(0.0599, True), (0.0601, False)])
def test_travel_may_exceed_the_planned_height_by_half(travel_m: float, passed: bool) -> None:
    finding = one(too_strong, {TRAVEL: pulse(travel_m)})  # 40 mm are planned
    assert finding.passed is passed
    assert "60 mm (limit 60 mm: 1.5 times the planned height)" in finding.text, finding.text
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


def swing(left: float) -> Array:
    """Return a swing at 2 Hz of amplitude 1, and of `left` in the last second."""
    amplitude = np.where(T_S < 1.0, 1.0, np.where(T_S < 1.5, 0.5, left))
    return np.where(T_S > 0.0, amplitude * np.sin(2 * np.pi * 2.0 * T_S), 0.0)


@pytest.mark.parametrize(("left", "passed"), [(0.145, True), (0.155, False)])
def test_fifteen_percent_of_the_motion_may_be_left(left: float, passed: bool) -> None:
    finding = one(not_decayed, {TRAVEL: swing(left)})
    assert finding.passed is passed
    assert finding.value == pytest.approx(left, rel=0.01)


@pytest.mark.parametrize(("moved_m", "passed"), [(0.0074, True), (-0.0074, True), (0.0076, False),
                                                 (-0.0076, False)])  # fmt: skip
def test_the_rest_position_may_change_by_fifteen_percent_of_the_peak(
    moved_m: float, passed: bool
) -> None:
    value = pulse(0.05) + np.where(T_S > 0.5, moved_m, 0.0)
    finding = one(rest_changed, {TRAVEL: value})
    assert finding.passed is passed
    assert finding.limit == pytest.approx(0.0075)


def without(time_s: Array, start_s: float, length_s: float) -> Array:
    """Return the times less those within a gap: as long from sample to sample."""
    return time_s[(time_s <= start_s + 1e-6) | (time_s >= start_s + length_s - 1e-6)]


@pytest.mark.parametrize(
    ("period_s", "silent_s", "passed"),
    [(0.001, 0.249, True), (0.001, 0.251, False), (0.05, 0.45, True), (0.05, 0.55, False)],
)
def test_a_message_may_be_silent_for_a_quarter_second_or_ten_cycles(
    period_s: float, silent_s: float, passed: bool
) -> None:
    time_s = without(np.arange(-1.0, 2.5001, period_s), 1.0, silent_s)
    assert one(stale, {TRAVEL: np.sin(time_s)}, time_s).passed is passed


@pytest.mark.parametrize(("lost", "passed"), [(71, True), (72, False)])
def test_two_percent_of_the_frames_may_be_lost(lost: int, passed: bool) -> None:
    bench, run = window({TRAVEL: pulse(0.05)})  # 3500 came: 71 of 3571 are 1.99 %
    run = replace(run, losses=Losses(counter_gaps=lost))
    (finding,) = lost_frames(bench, run, traces(bench.channels, run))
    assert finding.passed is passed


@pytest.mark.parametrize(
    ("period_s", "gap_s", "start_s", "passed"),
    [
        (0.001, 0.019, 0.05, True),
        (0.001, 0.021, 0.05, False),
        (0.001, 0.021, 0.19, False),
        (0.001, 0.021, 0.21, True),
        (0.01, 0.03, 0.05, True),
        (0.01, 0.04, 0.05, False),
    ],
)
def test_no_gap_while_the_wheels_move(
    period_s: float, gap_s: float, start_s: float, passed: bool
) -> None:
    """A gap counts from 20 ms or 3.5 cycles on, within 0.2 s after the bump."""
    time_s = without(np.arange(-1.0, 2.5, period_s), start_s, gap_s)
    assert one(lost_frames, {TRAVEL: np.sin(time_s)}, time_s).passed is passed


@pytest.mark.parametrize(("at_s", "passed"), [(0.15, True), (0.25, False)])
def test_a_top_is_cut_after_the_bump_or_on_it(at_s: float, passed: bool) -> None:
    noise = np.random.default_rng(3).standard_normal(len(T_S))
    value = np.where((at_s <= T_S) & (at_s + 0.02 > T_S), 50.0, noise)
    assert one(overload, {HUB: value}).passed is passed


@pytest.mark.parametrize(("rear", "passed"), [(0.32, False), (0.35, True)])
def test_a_bump_is_eighty_percent_pure(rear: float, passed: bool) -> None:
    """Rear wheels of a third of the front ones make a bounce of (1 + r)^2 / 2 (1 + r^2) = 0.8."""
    size = dict(zip(Corner, (1.0, 1.0, rear, rear), strict=True))
    hop = np.where((T_S > 0.0) & (T_S < 1.0), np.sin(2 * np.pi * 10.0 * T_S), 0.0)
    hubs = {
        replace(HUB, name=corner.value, corner=corner): 20.0 * share * hop
        for corner, share in size.items()
    }
    bench, run = window(hubs)
    (pattern,) = patterns(bench, traces(bench.channels, run))
    (finding,) = wrong_mode(Excitation.BOUNCE, pattern)
    assert finding.passed is passed
    assert finding.value == pytest.approx((1 + rear) ** 2 / 2 / (1 + rear**2), rel=1e-3)


FOUR = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL, Excitation.REAR_PITCH)


@pytest.mark.parametrize(("front", "passed"), [(0.49, True), (0.51, False)])
def test_a_rear_pitch_is_eighty_percent_pure(front: float, passed: bool) -> None:
    """Front wheels at a share r of the rear ones leave a rear pitch 1 / (1 + r^2) = 0.8."""
    size = dict(zip(Corner, (front, front, 1.0, 1.0), strict=True))
    hop = np.where((T_S > 0.0) & (T_S < 1.0), np.sin(2 * np.pi * 10.0 * T_S), 0.0)
    hubs = {
        replace(HUB, name=corner.value, corner=corner): 20.0 * share * hop
        for corner, share in size.items()
    }
    bench, run = window(hubs)
    bench = replace(bench, campaign=Campaign(FOUR, 2))
    (pattern,) = patterns(bench, traces(bench.channels, run))
    (rear,) = wrong_mode(Excitation.REAR_PITCH, pattern)
    (other,) = wrong_mode(Excitation.PITCH, pattern)
    assert (rear.passed, other.passed) == (passed, False)
    assert rear.value == pytest.approx(1 / (1 + front**2), rel=1e-3)


@pytest.mark.parametrize(
    ("front", "rear", "kinds"),
    [
        (1.0, 0.64, {Excitation.PITCH}),
        (1.0, 0.66, {Excitation.PITCH, Excitation.REAR_PITCH}),
        (0.66, 1.0, {Excitation.PITCH, Excitation.REAR_PITCH}),
        (0.64, 1.0, {Excitation.REAR_PITCH}),
    ],
)
def test_the_body_moves_more_at_the_axle_of_a_pitch(
    front: float, rear: float, kinds: set[Excitation]
) -> None:
    """A body that pitches as much as it heaves is known by its ends, from 0.65 of the other on."""
    pattern = of_body(FOUR, Body(1.0, 1.0, 0.0, front, rear, 1.0, 1.0), {}, "body's motion")
    passed = {kind for kind in FOUR if next(wrong_mode(kind, pattern)).passed}
    assert passed == kinds
    assert ("nose more" in pattern.words) is (front > rear)


@pytest.mark.parametrize(("hub", "passed"), [(False, False), (True, None)])
def test_travels_of_one_axle_do_not_judge_what_hubs_show(hub: bool, passed: bool | None) -> None:
    """A travel peak of 9 times its noise is too weak, unless it only misses the other axle."""
    noise = np.sqrt(0.5)
    turn = np.resize([0.0, 1.0, 0.0, -1.0], len(T_S))
    records = {TRAVEL: np.where(T_S < -0.0301, turn, 0.0) + pulse(9.0 * noise)}
    if hub:
        records[HUB] = pulse(100.0)
    subjects = {f.subject: f.passed for f in found(too_weak, records)}
    assert subjects.get("travel") is passed


def measure(peak: float, like: float = 1.0, small: float = 0.0) -> RunMeasure:
    """Return a run whose wave has the correlation `like` with that of `measure(1.0)`."""
    wave = np.array([like, np.sqrt(1.0 - like**2)])
    return RunMeasure(peaks={"travel": peak, "small": small}, waves={"travel": wave})


SMALL = replace(TRAVEL, name="small", corner=Corner.FRONT_RIGHT)


@pytest.mark.parametrize(
    ("peak", "passed"), [(1.39, True), (1.41, False), (1 / 1.39, True), (1 / 1.41, False)]
)
def test_a_peak_may_differ_by_the_factor_1_4(peak: float, passed: bool) -> None:
    bench, run = window({TRAVEL: pulse(peak), SMALL: pulse(0.0)})
    seen = traces(bench.channels, run)
    findings = list(not_repeatable(seen, measure(peak), [measure(1.0)]))
    assert findings[0].passed is passed


@pytest.mark.parametrize(("like", "passed"), [(0.84, False), (0.86, True)])
def test_a_course_is_85_percent_alike(like: float, passed: bool) -> None:
    bench, run = window({TRAVEL: pulse(1.0), SMALL: pulse(0.0)})
    seen = traces(bench.channels, run)
    by_peak, by_course = not_repeatable(seen, measure(1.0, like), [measure(1.0)])
    assert by_peak.passed
    assert by_course.passed is passed


@pytest.mark.parametrize(("size", "counts"), [(0.29, False), (0.31, True)])
def test_a_channel_counts_from_three_tenths_of_the_largest_on(size: float, counts: bool) -> None:
    bench, run = window({TRAVEL: pulse(1.0), SMALL: pulse(size)})
    seen = traces(bench.channels, run)
    findings = list(not_repeatable(seen, measure(1.0, small=size), [measure(1.0, small=0.1)]))
    assert findings[0].passed is not counts
