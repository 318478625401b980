"""Every limit of the verdict from both sides, by records of closed form with a known property."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Campaign
from daq.runs import Excitation
from daq.vehicle import Corner
from daq.verdict import RunMeasure
from daq.verdict.bump_kind import Body, of_body, patterns, wrong_mode
from daq.verdict.motion import (
    double_bump,
    not_at_rest,
    not_decayed,
    rest_changed,
    too_strong,
    too_weak,
)
from daq.verdict.repeats import not_repeatable, roughness
from daq.verdict.window import traces

from .closed_forms import BODY, HUB, T_S, TRAVEL, Array, found, one, pulse, window


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


@pytest.mark.parametrize(("second", "passed"), [(0.12, True), (0.13, False)])
def test_a_strike_is_as_high_as_its_energy_in_a_tenth_of_a_second(
    second: float, passed: bool
) -> None:
    """In 0.1 s a hop of 25 ms has half the RMS of one of 0.3 s: the limit of 0.25 is at 0.125."""
    hop = np.sin(2 * np.pi * 40.0 * T_S)
    first = np.where((T_S >= 0.0) & (T_S < 0.025), hop, 0.0)
    again = np.where((T_S >= 1.2) & (T_S < 1.5), hop, 0.0)
    finding = one(double_bump, {HUB: 30.0 * (first + second * again)})
    assert finding.passed is passed
    assert finding.value == pytest.approx(2.0 * second, rel=0.02)


@pytest.mark.parametrize("first", [0, 1, 2])
def test_a_second_strike_is_sought_at_the_hubs_else_at_the_body_else_anywhere(first: int) -> None:
    """The first of these channels decides; what the others show does not count."""
    channels = (HUB, BODY, TRAVEL)[first:]
    for again in (True, False):
        own, rest = (strikes(0.8 * share, 1.2) for share in (float(again), float(not again)))
        records = {c: own if c is channels[0] else rest for c in channels}
        passed = [finding.passed for finding in found(double_bump, records)]
        assert all(passed) is not again


@pytest.mark.parametrize("size", [1.0, 0.01])
def test_the_time_of_a_second_strike_does_not_depend_on_its_size(size: float) -> None:
    assert "at +1.20 s" in one(double_bump, {HUB: size * strikes(0.3, 1.2)}).text


@pytest.mark.parametrize("size", [1.0, 0.01])
def test_one_odd_sample_before_a_second_strike_is_not_its_time(size: float) -> None:
    odd = np.where(np.abs(T_S - 0.8) < 0.0004, 7.0, 0.0)
    finding = one(double_bump, {HUB: size * (strikes(0.3, 1.2) + odd)})
    assert not finding.passed
    assert "at +1.20 s" in finding.text


def test_a_wheel_that_lands_is_not_the_time_of_a_second_strike() -> None:
    """It lands 0.28 s after the bump, as hard as it is struck at 1.2 s."""
    landing = np.where((T_S >= 0.28) & (T_S < 0.38), np.sin(80 * np.pi * T_S), 0.0)
    finding = one(double_bump, {HUB: strikes(0.8, 1.2) + 24.0 * landing})
    assert "at +1.20 s" in finding.text


@pytest.mark.parametrize(("second", "passed"), [(0.24, True), (0.26, False)])
def test_a_strike_of_which_every_second_sample_is_missing_is_as_high(
    second: float, passed: bool
) -> None:
    keep = (T_S < 1.0) | (np.arange(len(T_S)) % 2 == 0)
    finding = one(double_bump, {HUB: strikes(second, 1.2)[keep]}, T_S[keep])
    assert finding.passed is passed


def test_a_strike_at_the_end_of_a_run_has_none_after_it() -> None:
    """The bump and what belongs to it, 0.45 s, end behind the run, or with it."""
    for at_s in (2.0, 2.09, 2.3):
        assert one(double_bump, {HUB: np.where(np.abs(T_S - at_s) < 0.02, 40.0, 0.0)}).passed


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


def test_motion_that_is_left_counts_in_noise_or_else_in_thousandths_of_the_peak() -> None:
    """A tenth is left of a travel without noise, a fifth of a body with a thousandth of noise."""
    turn = np.where(T_S < -0.0301, np.resize([0.0, 1.0, 0.0, -1.0], len(T_S)), 0.0)
    body = swing(0.2) + 1e-3 * np.sqrt(2.0) * turn
    finding = one(not_decayed, {TRAVEL: swing(0.1), BODY: body})
    assert finding.value == pytest.approx(np.sqrt((0.1**2 + 0.2**2) / 2.0), rel=0.02)
    assert finding.subject == "body"


@pytest.mark.parametrize(("moved_m", "passed"), [(0.0099, True), (-0.0099, True), (0.0101, False),
                                                 (-0.0101, False)])  # fmt: skip
def test_the_rest_position_may_change_by_a_fifth_of_the_peak(moved_m: float, passed: bool) -> None:
    value = pulse(0.05) + np.where(T_S > 0.5, moved_m, 0.0)
    finding = one(rest_changed, {TRAVEL: value})
    assert finding.passed is passed
    assert finding.limit == pytest.approx(0.01)


def test_a_travel_that_never_moved_rests_where_it_was() -> None:
    finding = one(rest_changed, {TRAVEL: np.zeros(len(T_S))})
    assert (finding.passed, finding.value, finding.limit) == (True, 0.0, 0.0)


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
    bench = replace(bench, campaign=Campaign(FOUR, 2, bump_height_m=0.05))
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


def test_white_noise_is_as_rough_as_it_is_large() -> None:
    value = 0.3 * np.random.default_rng(5).standard_normal(len(T_S))
    assert rough_of(value) == pytest.approx(0.3, rel=0.15)
