"""A hand pushes a corner of the simulated car down; forces decide what the sensors must say."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from daq.bench.config import default_bench_text, parse_bench
from daq.channels import Channel, Quantity
from daq.check.push_test import PushResult, judge_push, shows_push
from daq.sim.plant import corner_motion, forces, load_car, static_pose
from daq.vehicle import FORD_GRANADA, AddedMass, Corner

BIN_S = 0.02
REST_S, LONG_S = 4.0, 9.0
CHANNELS = parse_bench(default_bench_text(), "bench.toml", Path(), "").channels
NOISE = {"m": 2e-4, "rad/s": 2e-3, "m/s2": 0.1}
Array = NDArray[np.float64]


@cache
def _pushed(corner: Corner) -> tuple[Array, Array]:
    """Push a corner down with 400 N for half a second: time, and [pose, velocity, acceleration]."""
    plant = load_car(FORD_GRANADA, AddedMass())
    x, y = (plant.corners[axis][corner.position] for axis in ("x_m", "y_m"))
    still = np.zeros((4, 1))

    def hand(t_s: float) -> Array:
        u = (t_s - REST_S) / 0.5
        push = -400.0 * np.sin(np.pi * u) ** 2 if 0.0 < u < 1.0 else 0.0
        return np.array([[push], [-x * push], [y * push], [0.0], [0.0], [0.0], [0.0]])

    def acceleration(t_s: float, state: Array) -> Array:
        both = state.reshape(2, 7, 1)
        total = forces(plant, both[0], both[1], still) + hand(t_s)
        return np.asarray((plant.mobility @ total)[:, 0])

    rest = static_pose(plant)[:, 0]
    time = np.arange(0.0, LONG_S, 0.002)
    solution = solve_ivp(
        lambda t, s: np.concatenate([s[7:], acceleration(t, s)]),
        (0.0, LONG_S), np.concatenate([rest, np.zeros(7)]), t_eval=time, max_step=0.02,
    ).y  # fmt: skip
    moved = np.array([acceleration(t, s) for t, s in zip(time, solution.T, strict=True)]).T
    return time, np.stack([solution[:7] - rest[:, None], solution[7:], moved])


def _signal(channel: Channel, motion: Array, plant_corner: int | None) -> Array:
    pose, velocity, acceleration = motion
    match channel.quantity:
        case Quantity.SUSPENSION_TRAVEL:
            plant = load_car(FORD_GRANADA, AddedMass())
            return np.asarray((pose[3:] - corner_motion(plant, pose[:3]))[plant_corner])
        case Quantity.HUB_ACCELERATION:
            assert plant_corner is not None
            return np.asarray(acceleration[3 + plant_corner]) + 9.81
        case Quantity.PITCH_RATE:
            return np.asarray(velocity[1])
        case Quantity.ROLL_RATE:
            return np.asarray(velocity[2])
        case Quantity.BODY_ACCELERATION:
            x = channel.x_m + FORD_GRANADA.a
            return np.asarray(acceleration[0] - x * acceleration[1] + channel.y_m * acceleration[2])
    return np.zeros(motion.shape[-1])


def _lanes(corner: Corner, channels: tuple[Channel, ...]) -> dict[str, tuple[Array, Array]]:
    rng = np.random.default_rng(7)
    time, motion = _pushed(corner)
    per_bin = round(BIN_S / 0.002)
    lanes = {}
    for channel in channels:
        place = channel.corner.position if channel.corner else None
        value = channel.sign * _signal(channel, motion, place)
        value = value + rng.normal(0.0, NOISE[channel.unit or "m/s2"], len(time))
        table = value.reshape(-1, per_bin)
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
def test_a_push_on_the_right_corner_passes(corner: Corner) -> None:
    result = _judge(corner, _lanes(corner, CHANNELS))
    assert (result.done, result.passed, result.inverted) == (True, True, ())
    assert f"travel_{corner.lower()} moved +" in result.text
    gyros = _only(Quantity.PITCH_RATE, Quantity.ROLL_RATE)
    assert _judge(corner, _lanes(corner, gyros), gyros).passed


@pytest.mark.parametrize("corner", Corner)
@pytest.mark.parametrize("name", ["travel", "pitch_rate", "roll_rate"])
def test_a_wrong_sign_is_named(corner: Corner, name: str) -> None:
    name = f"travel_{corner.lower()}" if name == "travel" else name
    wrong = tuple(replace(c, sign=-1.0) if c.name == name else c for c in CHANNELS)
    result = _judge(corner, _lanes(corner, wrong))
    assert (result.done, result.passed) == (True, False)
    assert result.inverted == (name,)
    assert name in result.text
    assert "I inverts" in result.advice


def test_swapped_plugs_are_named() -> None:
    lanes = _lanes(Corner.FRONT_LEFT, CHANNELS)
    lanes["travel_fl"], lanes["travel_fr"] = lanes["travel_fr"], lanes["travel_fl"]
    result = _judge(Corner.FRONT_LEFT, lanes)
    assert (result.done, result.passed) == (True, False)
    assert result.text == "FR moved: travel_fl and travel_fr are swapped"
    assert "swap their plugs" in result.advice


def test_gyros_tell_a_push_on_another_corner_from_swapped_plugs() -> None:
    result = _judge(Corner.FRONT_LEFT, _lanes(Corner.REAR_RIGHT, CHANNELS))
    assert not result.passed
    assert "the front LEFT was not pushed" in result.text
    travels = _only(Quantity.SUSPENSION_TRAVEL)
    result = _judge(Corner.FRONT_LEFT, _lanes(Corner.REAR_RIGHT, travels), travels)
    assert "another corner was pushed" in result.advice


def test_a_dead_sensor_is_named() -> None:
    lanes = _lanes(Corner.REAR_LEFT, CHANNELS)
    lanes["travel_rl"] = lanes["body_acc_x"]
    travels = [f"travel_{c.lower()}" for c in Corner]
    dead = {name: lane for name, lane in lanes.items() if name not in travels}
    dead["travel_rl"] = (np.zeros(450), np.full(450, 1e-4))
    result = _judge(Corner.REAR_LEFT, dead)
    assert (result.done, result.passed) == (True, False)
    assert result.text == "travel_rl did not move"


def test_nothing_is_said_before_the_push_is_over() -> None:
    lanes = _lanes(Corner.FRONT_LEFT, CHANNELS)
    said = []
    for stop_s in (3.0, 4.4, LONG_S):
        stop = round(stop_s / BIN_S)
        part = {name: (low[:stop], high[:stop]) for name, (low, high) in lanes.items()}
        result = _judge(Corner.FRONT_LEFT, part)
        said.append((result.done, result.text.split(" ")[0]))
    assert said == [(False, "push"), (False, "moving:"), (True, "travel_fl")]
    assert not _judge(Corner.FRONT_LEFT, {}).done


def test_a_bench_of_accelerometers_alone_cannot_tell() -> None:
    assert not shows_push(_only(Quantity.HUB_ACCELERATION, Quantity.BODY_ACCELERATION))
    assert shows_push(_only(Quantity.PITCH_RATE))
