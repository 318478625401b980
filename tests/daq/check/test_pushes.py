"""Pushes on a simulated car, where forces decide what the sensors must say, and made by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import default_bench_text, parse_bench
from daq.channels import Channel, Quantity
from daq.check.pushes import (
    ORDER,
    Pushes,
    PushResult,
    axis_of,
    find_pushes,
    judge_push,
    mounting,
    pushed_corner,
    shows_push,
)
from daq.samples.mapping import Trace
from daq.sim.car import SensorTruth, true_reading
from daq.sim.motion import load_car, pushed
from daq.vehicle import FORD_GRANADA, AddedMass, Corner

BIN_S = 0.02
REST_S, LONG_S = 4.0, 9.0
CHANNELS = parse_bench(default_bench_text(), "bench.toml", Path(), "").channels
NOISE = {"m": 2e-4, "rad/s": 2e-3, "m/s2": 0.1}
Array = NDArray[np.float64]
FL, FR, RL, RR = Corner
PLANT = load_car(FORD_GRANADA, AddedMass())


@cache
def _lanes(corner: Corner) -> dict[str, tuple[Array, Array]]:
    """Return the channels of the shipped bench while a corner is pushed after `REST_S`."""
    rng = np.random.default_rng(7)
    time_s = np.arange(0.0, LONG_S, 0.002)
    motion = pushed(PLANT, corner, 400.0, 1.2).at(time_s - REST_S)
    truth = SensorTruth(x_m=-1.05, y_m=0.12, delay_s=0.0, bias=0.0)
    lanes = {}
    for channel in CHANNELS:
        value = true_reading(channel, truth, PLANT, motion)
        value = value + rng.normal(0.0, NOISE[channel.unit or "m/s2"], len(time_s))
        table = value.reshape(-1, round(BIN_S / 0.002))
        lanes[channel.name] = (table.min(axis=1), table.max(axis=1))
    return lanes


def _judge(
    asked: Corner,
    lanes: Mapping[str, tuple[Array, Array]],
    channels: tuple[Channel, ...] = CHANNELS,
) -> PushResult:
    return judge_push(asked, channels, lanes, round(2.0 / BIN_S), BIN_S)


def _only(*quantities: Quantity) -> tuple[Channel, ...]:
    return tuple(channel for channel in CHANNELS if channel.quantity in quantities)


@pytest.mark.parametrize("corner", Corner)
def test_a_push_on_the_right_corner_passes_and_a_wrong_sign_is_named(corner: Corner) -> None:
    lanes = _lanes(corner)
    result = _judge(corner, lanes)
    assert (result.done, result.passed, result.inverted) == (True, True, ())
    assert f"travel_{corner.lower()} moved +" in result.text
    assert _judge(corner, lanes, _only(Quantity.PITCH_RATE, Quantity.ROLL_RATE)).passed
    for name in (f"travel_{corner.lower()}", "pitch_rate", "roll_rate"):
        low, high = lanes[name]
        result = _judge(corner, lanes | {name: (-high, -low)})
        assert (result.done, result.passed) == (True, False)
        assert result.inverted == (name,)
        assert name in result.text
        assert "I inverts" in result.advice


def test_swapped_plugs_or_a_push_on_another_corner_are_named() -> None:
    lanes = _lanes(FL)
    swapped = {"travel_fl": lanes["travel_fr"], "travel_fr": lanes["travel_fl"]}
    for shown, corner in ((lanes | swapped, FR), (_lanes(RR), RR)):
        result = _judge(FL, shown)
        assert (result.done, result.passed) == (True, False)
        other = f"travel_{corner.lower()}"
        said = f"{corner} moved: another corner was pushed, or travel_fl and {other} are swapped"
        assert result.text == said
        assert "push the front LEFT" in result.advice


def test_a_dead_sensor_is_named() -> None:
    dead = {name: lane for name, lane in _lanes(RL).items() if "travel" not in name}
    dead["travel_rl"] = (np.zeros(450), np.full(450, 1e-4))
    result = _judge(RL, dead)
    assert (result.done, result.passed) == (True, False)
    assert result.text == "travel_rl did not move"


def test_nothing_is_said_before_the_push_is_over() -> None:
    said = []
    for stop_s in (3.0, 4.8, LONG_S):
        stop = round(stop_s / BIN_S)
        part = {name: (low[:stop], high[:stop]) for name, (low, high) in _lanes(FL).items()}
        result = _judge(FL, part)
        said.append((result.done, result.text.split(" ")[0]))
    assert said == [(False, "push"), (False, "moving:"), (True, "travel_fl")]
    assert not _judge(FL, {}).done


def test_a_bench_of_accelerometers_alone_cannot_tell() -> None:
    assert not shows_push(_only(Quantity.HUB_ACCELERATION, Quantity.BODY_ACCELERATION))
    assert shows_push(_only(Quantity.PITCH_RATE))


# When a push counts, is over, and goes the right way, on deviations made by hand ------------------


def channel(quantity: Quantity, name: str = "c", **facts: Any) -> Channel:
    if quantity is Quantity.SUSPENSION_TRAVEL:
        facts = {"corner": FL, **facts}
    return Channel(name, quantity, signal=f"M.{name}", **facts)


def lane(values: Sequence[float] | Array, at: int = 50, n: int = 100) -> Array:
    """Return a channel at rest in bins of 0.1 s, that shows these values from one bin on."""
    shown = np.zeros(n)
    shown[at : at + len(values)] = values
    return shown


def judged(
    corner: Corner, lanes: Mapping[Channel, Array], begin: int = 0, bin_s: float = 0.1
) -> PushResult:
    pairs = {c.name: (value - 1e-6, value + 1e-6) for c, value in lanes.items()}
    return judge_push(corner, tuple(lanes), pairs, begin, bin_s)


@pytest.mark.parametrize(
    ("quantity", "least"),
    [(Quantity.SUSPENSION_TRAVEL, 3e-3), (Quantity.PITCH_RATE, 0.01), (Quantity.ROLL_RATE, 0.01)],
)
def test_a_push_moves_each_kind_of_channel_by_so_much(quantity: Quantity, least: float) -> None:
    for share, done in ((0.99, False), (1.01, True)):
        result = judged(FL, {channel(quantity): lane([share * least, -share * least])})
        assert result.done is done
        assert result.text.startswith("push DOWN at the front LEFT") is not done
    assert not judged(FL, {channel(Quantity.PITCH_ACCELERATION): lane([9.0])}).done


@pytest.mark.parametrize(("size", "done"), [(8.8e-3, False), (8.95e-3, True)])
def test_a_push_is_six_times_the_noise(size: float, done: bool) -> None:
    """Of three bins two lie 1 mm from the middle one: the noise is 1.48 mm, and the limit 8.88."""
    noise = np.resize([-1e-3, 0.0, 1e-3], 100)
    noise[50:60] = lane([size], 0, 10)
    for level in (0.0, 0.5):
        result = judged(FL, {channel(Quantity.SUSPENSION_TRAVEL): noise + level})
        assert result.done is done


@pytest.mark.parametrize(("share", "first"), [(0.39, 1), (0.41, -1)])
def test_the_first_way_is_that_of_four_tenths_of_the_peak(share: float, first: int) -> None:
    rate = channel(Quantity.PITCH_RATE)
    result = judged(FL, {rate: lane([0.001, -0.05 * share, 0.05, -0.02])})
    assert result.done
    assert result.passed is (first > 0)
    assert result.inverted == (() if first > 0 else ("c",))


@pytest.mark.parametrize(
    ("moving", "after", "done"),
    [(1, 5, False), (1, 6, True), (45, 5, False), (46, 5, True), (50, 1, True), (49, 1, False)],
)
def test_a_push_is_over_after_rest_or_after_five_seconds(
    moving: int, after: int, done: bool
) -> None:
    """0.6 s of rest, or 5 s since the movement began."""
    value = lane([0.02] * moving, 120 - after - moving, 120)
    result = judged(FL, {channel(Quantity.SUSPENSION_TRAVEL): value})
    assert result.done is done
    assert result.text.startswith("moving") is not done


@pytest.mark.parametrize(("begin", "passed"), [(48, True), (53, False)])
def test_a_push_that_is_under_way_at_the_key_press_is_not_judged(begin: int, passed: bool) -> None:
    """Its rebound alone would ask for a sign to be inverted that is right."""
    travel = channel(Quantity.SUSPENSION_TRAVEL)
    pushed = [0.005, 0.02, 0.02, 0.005, -0.012, -0.008, 0.004]
    result = judged(FL, {travel: lane(pushed)}, begin)
    assert (result.done, result.passed, result.inverted) == (passed, passed, ())
    again = lane(pushed)
    again[80:87] = pushed
    assert judged(FL, {travel: again}, begin).passed


def test_a_body_that_rests_elsewhere_after_a_push_can_be_pushed_again() -> None:
    travel = channel(Quantity.SUSPENSION_TRAVEL)
    stuck = lane([0.02, 0.01], 150, 400)
    stuck[152:] = 0.006
    stuck[300:302] = [0.03, 0.0]
    assert judged(FL, {travel: stuck}, 250).passed


def test_a_travel_at_another_corner_does_not_show_its_sign() -> None:
    travel = {channel(Quantity.SUSPENSION_TRAVEL, unit="m"): lane([-0.004, 0.002])}
    rate = {channel(Quantity.PITCH_RATE, "w", unit="rad/s"): lane([-0.05, 0.02])}
    assert judged(RR, travel).text == "c moved -4 mm"
    assert judged(RR, travel | rate).text == "w moved -0.05 rad/s, sign right"


# How sensors are mounted, from gravity and from pushes --------------------------------------------


UP = {"x": 0.0, "y": 0.0, "z": 1.0}
START_NS = 1_800_000_000_000_000_000


@pytest.mark.parametrize(
    ("gravity", "up"),
    [
        ((0.0, 0.0, 1.0), ("z", 1)),
        ((0.0, 0.1, -0.98), ("z", -1)),
        ((1.02, 0.0, 0.0), ("x", 1)),
        ((0.43, 0.0, 0.903), ("z", 1)),  # 25 degrees
        ((0.45, 0.0, 0.893), None),  # 27 degrees
        ((0.0, 0.0, 1.11), None),
        ((0.0, 0.0, 1.09), ("z", 1)),
        ((0.0, 0.0, 0.0), None),
    ],
)
def test_up_is_where_gravity_is(
    gravity: tuple[float, float, float], up: tuple[str, int] | None
) -> None:
    found = mounting(dict(zip("xyz", gravity, strict=True)), {})
    assert (axis_of(found.up) if found else None) == up


def test_the_pushes_show_every_way_to_mount_an_imu() -> None:
    # Pitch is positive nose down, roll positive lifts the left side.
    car = {FL: (1.0, -0.7), FR: (1.0, 0.7), RL: (-1.0, -0.7), RR: (-1.0, 0.7)}
    eye = np.eye(3)
    tried = 0
    for up in (*eye, *-eye):
        for forward in (*eye, *-eye):
            if up @ forward:
                continue
            left = np.cross(up, forward)
            turns = {c: pitch * left + roll * forward for c, (pitch, roll) in car.items()}
            seen = {c: dict(zip("xyz", turn.tolist(), strict=True)) for c, turn in turns.items()}
            found = mounting(dict(zip("xyz", up.tolist(), strict=True)), seen)
            assert found is not None
            assert found.surely_forward
            np.testing.assert_array_equal(found.up, up)
            np.testing.assert_array_equal(found.forward, forward)
            np.testing.assert_array_equal(found.left, left)
            tried += 1
    assert tried == 24


@pytest.mark.parametrize(("roll", "sure"), [(-0.35, True), (-0.3, False)])
def test_forward_explains_pushes_twice_as_well_as_the_next_best(roll: float, sure: bool) -> None:
    """A push at the front left turns by 1 about y: forward fits by 1 - roll, right by 1 + roll."""
    for size in (1.0, 100.0):
        found = mounting(UP, {FL: {"x": roll * size, "y": size}})
        assert found is not None
        assert found.surely_forward is sure
        assert axis_of(found.forward) == ("x", 1)


@pytest.mark.parametrize(
    ("peaks", "other", "place"),
    [
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), None),  # a dead one
        ((10.0, -4.9, 1.0, 0.0), (0.0, 0.0, 0.0, 0.0), (FL, 1)),
        ((10.0, -5.1, 1.0, 0.0), (0.0, 0.0, 0.0, 0.0), None),
        ((1.0, 0.0, 0.0, -2.0), (-1.9, 9.0, 0.0, -1.9), (RR, -1)),
        ((2.0, 1.0, 0.0, 0.0), (-2.1, 0.0, 0.0, 0.0), None),
    ],
)
def test_a_travel_is_where_its_own_push_moves_it_most(
    peaks: tuple[float, ...], other: tuple[float, ...], place: tuple[Corner, int] | None
) -> None:
    one, two = (dict(zip(Corner, each, strict=True)) for each in (peaks, other))
    assert pushed_corner(one, [two]) == place


# Pushes in a recording ----------------------------------------------------------------------------


def trace(
    heights: Sequence[float], length_s: float = 0.2, apart_s: float = 3.0, noise: float = 0.0
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return pushes at 1 s, 4 s and so on, 200 samples a second, about a level of 5."""
    time_s = np.arange(round(200 * (1.0 + apart_s * (len(heights) - 1) + length_s + 2.0))) / 200
    value = np.zeros(len(time_s))
    value[:100] = noise * np.resize([1.0, -1.0], 100)
    for k, height in enumerate(heights):
        begin = 1.0 + k * apart_s - 1e-4
        value[(time_s >= begin) & (time_s < begin + length_s)] = height
    # A little after the edges of bins of 0.05 s.
    return START_NS + np.rint(time_s * 1e9).astype(np.int64) + 1_000_000, 5.0 + value


def pushes(*traces: Trace) -> Pushes:
    found, number = find_pushes({str(k): each for k, each in enumerate(traces)})
    assert found is not None
    assert number == 4
    return found


def test_four_pushes_are_one_on_each_corner_with_a_quarter_second_around() -> None:
    found = pushes(trace([1.0, 1.0, 1.0, 1.0]))
    begins = [START_NS + 1_000_000 + (3 * k + 1) * 10**9 - 250_000_000 for k in range(4)]
    assert found.spans == {
        corner: (begin, begin + 700_000_000) for corner, begin in zip(ORDER, begins, strict=True)
    }


@pytest.mark.parametrize(
    ("length_s", "apart_s", "number"),
    [
        (0.15, 3.0, 4), (0.1, 3.0, 0),
        (0.2, 0.7, 4), (0.2, 0.65, 1),  # bins with 0.5 s and 0.45 s of rest between them
    ],
)  # fmt: skip
def test_a_push_lasts_long_enough_and_rest_parts_two(
    length_s: float, apart_s: float, number: int
) -> None:
    assert find_pushes({"a": trace([1.0] * 4, length_s, apart_s)})[1] == number


@pytest.mark.parametrize(("small", "number"), [(0.19, 3), (0.21, 4)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_push_reaches_a_fifth_of_the_largest(small: float, number: int, sign: float) -> None:
    found, seen = find_pushes({"a": trace([1.0, sign * small, -1.0, 0.5])})
    assert seen == number
    assert (found is None) is (number != 4)
