"""Rest, weak and second bumps, decay and the kind of a body's motion, where details decide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Method
from daq.channels import Channel, Quantity
from daq.vehicle import Corner, VehicleGeometry
from daq.verdict import RunWindow, peak_left
from daq.verdict.bump_kind import patterns
from daq.verdict.motion import double_bump, not_at_rest, not_decayed, rest_changed, too_weak
from daq.verdict.window import traces
from dbc.finding import Finding

from . import test_kinds_of_bumps as kinds
from .closed_forms import BODY, BUMP_NS, HUB, T_S, TRAVEL, Array, Check, found, one, pulse, window
from .test_limits import strikes

PITCH = Channel("pitch", Quantity.PITCH_RATE, "rad/s", "IMU.p")
ROLL = Channel("roll", Quantity.ROLL_RATE, "rad/s", "IMU.r")
TURN = Channel("turn", Quantity.ROLL_ACCELERATION, "rad/s2", "IMU.t")
TILT = Channel("tilt", Quantity.PITCH_ACCELERATION, "rad/s2", "IMU.u")
BEFORE = T_S < -0.0301
TURNS: Array = np.resize([0.0, 1.0, 0.0, -1.0], len(T_S))
"""Samples that differ by 1 each, as white noise of 0.707 does."""


def by(method: Method, check: Check, records: Mapping[Channel, Array]) -> list[Finding]:
    bench, run = window(records)
    bench = replace(bench, campaign=replace(bench.campaign, method=method))
    return list(check(bench, run, traces(bench.channels, run)))


@pytest.mark.parametrize(
    ("channel", "rms", "says"),
    [
        (TRAVEL, 0.0123, "12 mm RMS"),
        (PITCH, np.radians(2.5), "2.5 deg/s RMS"),
        (TURN, np.radians(2.5), "2.5 deg/s2 RMS"),
        (BODY, 0.25, "0.25 m/s2 RMS"),
    ],
)
def test_motion_before_the_bump_is_said_in_the_units_of_people(
    channel: Channel, rms: float, says: str
) -> None:
    value = np.sqrt(2.0) * rms * np.sin(2 * np.pi * T_S / 0.97) * BEFORE
    finding = one(not_at_rest, {channel: value + pulse(rms)})
    assert says in finding.text
    assert not finding.passed
    assert one(not_at_rest, {channel: np.zeros(len(T_S))}).passed


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


def test_hubs_excuse_travels_of_one_axle_alone() -> None:
    front, other = travel(Corner.FRONT_LEFT, 9.0), travel(Corner.FRONT_RIGHT, 8.0)
    rear = travel(Corner.REAR_LEFT, 8.0)
    body = BODY, TURNS * BEFORE + pulse(8.0 * np.sqrt(0.5))
    for records, judged in (
        ((front, other), False),
        ((rear,), False),
        ((front, rear), True),
        ((front, body), True),
    ):
        findings = found(too_weak, {HUB: pulse(100.0), **dict(records)})
        weak = [finding for finding in findings if finding.unit == ""]
        assert bool(weak) is judged
        assert all(not finding.passed for finding in weak)
    # Of several the clearest counts.
    clear = found(too_weak, dict((front, travel(Corner.REAR_RIGHT, 11.0))))
    assert [(f.passed, f.subject) for f in clear] == [(True, "travel_RR")]


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


def test_a_bump_at_the_end_of_a_record_has_no_time_for_another() -> None:
    late = np.where(T_S > 2.2, 30.0 * np.sin(80 * np.pi * T_S), 0.0)
    finding = one(double_bump, {HUB: late})
    assert (finding.passed, finding.value) == (True, 0.0)


def test_a_second_strike_below_three_times_the_noise_is_none() -> None:
    for noise, passed in ((0.0, False), (7.0, True)):
        value = strikes(0.4, 1.2) + noise * np.sqrt(2.0) * TURNS * BEFORE
        assert one(double_bump, {HUB: value}).passed is passed


def left(value: Array, now_s: float) -> float | None:
    t_ns = BUMP_NS + np.rint(T_S * 1e9).astype(np.int64)
    past = now_s > T_S
    columns = {"travel": (t_ns[past], value[past])}
    return peak_left((TRAVEL,), BUMP_NS, columns, BUMP_NS + round(now_s * 1e9))


def test_what_is_left_is_counted_about_where_the_car_stands_after_two_seconds() -> None:
    stands = pulse(1.0) + np.where(T_S > 0.5, 0.2, 0.0)
    assert left(stands, 1.9) == pytest.approx(0.2 * np.sqrt(2.0), rel=1e-3)
    assert left(stands, 2.1) == pytest.approx(0.0, abs=1e-6)
    assert left(pulse(0.0), 2.1) is None  # nothing moved
    swing = np.where(T_S > 0.0, np.sin(4 * np.pi * T_S), 0.0)
    assert left(swing, 2.4) == pytest.approx(1.0, abs=0.01)
    assert left(np.sign(swing), 2.4) == 1.0  # never more, though a sine would be 1.4 times as high
    assert left(swing, -0.5) is None


def test_the_channel_that_moves_most_is_named_in_units_of_its_noise() -> None:
    other = replace(TRAVEL, name="other", corner=Corner.REAR_LEFT)
    noise = 0.01 * TURNS * BEFORE
    swing = np.where(T_S > 0.0, 0.5 * np.sin(4 * np.pi * T_S), 0.0)
    finding = one(not_decayed, {TRAVEL: noise + swing, other: 100 * noise + 2 * swing})
    assert (finding.passed, finding.subject) == (False, "travel")


@pytest.mark.parametrize(("start_s", "changed_m"), [(1.3, 0.0), (1.6, 0.3)])
def test_the_rest_is_that_of_the_last_second(start_s: float, changed_m: float) -> None:
    """Half a metre off for 0.2 s before the last second, or 0.6 m for half of it."""
    stop_s, size = (1.5, 0.5) if start_s < 1.5 else (2.1, 0.6)
    away = np.where((start_s < T_S) & (stop_s > T_S), size, 0.0)
    finding = one(rest_changed, {TRAVEL: away})
    assert finding.value == pytest.approx(changed_m, abs=1e-3)
    assert by(Method.DROP, rest_changed, {TRAVEL: away}) == []
    both = {TRAVEL: pulse(0.1), replace(TRAVEL, name="other", corner=Corner.REAR_LEFT): -away}
    worst = one(rest_changed, both)
    assert worst.subject == ("other" if changed_m else "travel")


def test_a_body_turns_about_levers_of_its_own_car() -> None:
    """Axles 2.4 m apart and half tracks of 0.6 m: rates of 1 / 1.2 and 1 / 0.6 move a corner."""
    place = replace(kinds.Z, at_cg=True)
    records = {
        place: kinds.jolt(1.0),
        kinds.RATES[0]: kinds.rate(1 / 1.2),
        kinds.RATES[1]: kinds.rate(1 / 0.6),
    }
    bench = kinds.bench_of(tuple(records))
    geometry = VehicleGeometry(1.0, 1.4, 0.5, 0.7)
    t_ns = kinds.BUMP_NS + np.rint(kinds.T_S * 1e9).astype(np.int64)
    bench = replace(bench, vehicle=replace(bench.vehicle, geometry=geometry))
    run = RunWindow(kinds.BUMP_NS, {c.name: (t_ns, v) for c, v in records.items()})
    (pattern,) = patterns(bench, traces(bench.channels, run))
    assert list(pattern.shares.values()) == pytest.approx([1 / 3] * 3, abs=0.005)
