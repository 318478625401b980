"""Signs, gravity and conversion of the sensors, by motions made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import load_bench
from daq.channels import Channel, Quantity
from daq.errors import InputError
from daq.sim.car import NOISE, SensorTruth, Spread
from daq.sim.motion import Kinematics
from daq.sim.plant import GRAVITY_M_S2, load_car, static_pose
from daq.sim.sensors import Installation, signal_values, true_reading
from daq.vehicle import FORD_GRANADA, AddedMass
from dbc import Codec, parse_codec, shipped_dbc

G = GRAVITY_M_S2
SILENT = Spread(0.0, 0.0, 0.0, 0.0, 0.0)
PERFECT = SensorTruth(x_m=-1.05, y_m=0.12, delay_s=0.0, bias=0.0)


@pytest.fixture(scope="module")
def codec() -> Codec:
    return parse_codec(shipped_dbc(), "shipped")


@pytest.fixture(scope="module")
def car() -> Installation:
    plant = load_car(FORD_GRANADA, AddedMass())
    return Installation(plant, FORD_GRANADA.a, static_pose(plant))


def shipped_channel(name: str) -> Channel:
    return next(channel for channel in load_bench(None).channels if channel.name == name)


def made(
    car: Installation,
    pose: dict[int, float] | None = None,
    velocity: dict[int, float] | None = None,
    acceleration: dict[int, float] | None = None,
) -> Kinematics:
    """One instant, away from rest in the given degrees of freedom."""
    rows = np.zeros((3, 7, 1))
    for row, moved in zip(rows, (pose, velocity, acceleration), strict=True):
        for dof, value in (moved or {}).items():
            row[dof] = value
    return Kinematics(car.design_pose + rows[0], rows[1], rows[2])


def read(name: str, car: Installation, motion: Kinematics) -> float:
    return float(true_reading(shipped_channel(name), PERFECT, car, motion)[0])


def test_at_rest_only_gravity_is_felt(car: Installation) -> None:
    rest = made(car)
    for channel in load_bench(None).channels:
        vertical = channel.quantity in (Quantity.BODY_ACCELERATION, Quantity.HUB_ACCELERATION)
        expected = G if vertical else 0.0
        assert read(channel.name, car, rest) == pytest.approx(expected, abs=1e-12)


def test_nose_down_by_forces(car: Installation) -> None:
    # Push the front axle into its springs: nose down is positive pitch, and the front compresses.
    pushed = made(car, pose={1: 0.02}, velocity={1: 0.3}, acceleration={1: 2.0})
    assert read("pitch_rate", car, pushed) == pytest.approx(0.3)
    assert read("roll_rate", car, pushed) == 0.0
    assert read("body_acc_x", car, pushed) == pytest.approx(-G * 0.02)
    assert read("travel_fl", car, pushed) == pytest.approx(0.02 * FORD_GRANADA.a)
    assert read("travel_rr", car, pushed) == pytest.approx(-0.02 * FORD_GRANADA.b)
    # The IMU sits 0.2 m ahead of the CG, where the body is being accelerated downwards.
    assert read("body_acc_z", car, pushed) == pytest.approx(G - 2.0 * 0.2)


def test_a_lifted_wheel_compresses_its_own_suspension(car: Installation) -> None:
    raised = made(car, pose={5: 0.04}, acceleration={5: -7.0})
    assert read("hub_acc_rl", car, raised) == pytest.approx(G - 7.0)
    assert read("hub_acc_rr", car, raised) == pytest.approx(G)
    assert read("travel_rl", car, raised) == pytest.approx(0.04)
    assert read("travel_fl", car, raised) == pytest.approx(0.0, abs=1e-15)


def sent(
    channel: Channel, si_values: NDArray[np.float64], codec: Codec, noise: Spread = SILENT
) -> NDArray[np.float64]:
    message, _, signal = channel.signal.partition(".")
    layout = codec.message(message).signal(signal)
    rng = np.random.default_rng(7)
    return signal_values(channel, layout, PERFECT, noise, si_values, rng)


def test_the_recorder_undoes_sign_gain_and_tare(codec: Codec) -> None:
    value = np.linspace(-0.05, 0.05, 11)
    channel = replace(shipped_channel("travel_fl"), sign=-1.0, gain=1.25, tare=0.02)
    mm = sent(channel, value, codec)
    np.testing.assert_allclose(-1.0 * 1.25 * (mm * 1e-3) - 0.02, value, atol=1e-15)


def test_noise_and_bias_are_those_asked_for(codec: Codec) -> None:
    zero = np.zeros(20000)
    for name, spread in (
        ("body_acc_z", 0.03),
        ("body_acc_x", 0.03),
        ("pitch_rate", 0.1),
        ("yaw_rate", 0.1),
        ("hub_acc_rr", 0.15 / 9.80665),
        ("travel_fl", 0.2),
    ):
        values = sent(shipped_channel(name), zero, codec, NOISE)
        assert values.std() == pytest.approx(spread, rel=0.03), name
        assert abs(values.mean()) < 5 * spread / np.sqrt(len(zero))


def test_a_signal_of_another_unit_is_refused(codec: Codec) -> None:
    channel = replace(shipped_channel("body_acc_z"), signal="SUSP_Front.travel_fl")
    layout = codec.message("SUSP_Front").signal("travel_fl")
    with pytest.raises(InputError, match=r"body_acc_z: is in m/s2, but SUSP_Front\.travel_fl"):
        signal_values(channel, layout, PERFECT, SILENT, np.zeros(1), np.random.default_rng(0))
