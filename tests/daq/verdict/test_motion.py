"""Rest, weak, strong and second bumps, and decay, by records of closed form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Method
from daq.channels import Channel
from daq.vehicle import Corner
from daq.verdict.motion import (
    double_bump,
    not_at_rest,
    not_decayed,
    rest_changed,
    too_strong,
    too_weak,
)
from daq.verdict.window import traces
from dbc.finding import Finding

from .closed_forms import (
    BEFORE,
    BODY,
    HUB,
    PITCH,
    ROLL,
    T_S,
    TILT,
    TRAVEL,
    TURN,
    TURNS,
    Array,
    Check,
    found,
    one,
    pulse,
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


"""Rest, weak and second bumps, decay and the kind of a body's motion, where details decide."""
"""Samples that differ by 1 each, as white noise of 0.707 does."""


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


"""Rest, strikes, gaps and likeness where two rules meet, by records of closed form."""


"""The measures of a run against closed forms: peaks, noise, the body's wave, the slow course."""
