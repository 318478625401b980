"""Signs, gravity and conversion of the sensors, by motions made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import load_bench
from daq.channels import Channel, Quantity
from daq.errors import InputError
from daq.sim.car import NOISE, SensorTruth, SimulatedCar, Spread, truth
from daq.sim.motion import Kinematics
from daq.sim.plant import GRAVITY_M_S2, load_car, static_pose
from daq.sim.sensors import Installation, signal_values, true_reading
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner
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


def test_left_side_up(car: Installation) -> None:
    lifted = made(car, pose={2: 0.03}, velocity={2: -0.1}, acceleration={2: 5.0})
    assert read("roll_rate", car, lifted) == pytest.approx(-0.1)
    assert read("body_acc_y", car, lifted) == pytest.approx(G * 0.03)
    assert read("travel_fl", car, lifted) == pytest.approx(-0.03 * FORD_GRANADA.t_f)
    assert read("travel_fr", car, lifted) == pytest.approx(0.03 * FORD_GRANADA.t_f)
    assert read("body_acc_z", car, lifted) == pytest.approx(G + 5.0 * 0.12)


@pytest.mark.parametrize(
    ("quantity", "corner", "expected"),
    [
        (Quantity.PITCH_ACCELERATION, None, 0.5),
        (Quantity.ROLL_ACCELERATION, None, -0.25),
        (Quantity.BODY_DISPLACEMENT, None, 0.01 - 0.2 * 0.02 + 0.12 * 0.05),
        (Quantity.HUB_DISPLACEMENT, Corner.REAR_RIGHT, 0.07),
    ],
)
def test_other_quantities(
    quantity: Quantity, corner: Corner | None, expected: float, car: Installation
) -> None:
    motion = made(car, pose={0: 0.01, 1: 0.02, 2: 0.05, 6: 0.07}, acceleration={1: 0.5, 2: -0.25})
    channel = Channel("c", quantity, "", corner=corner)
    assert true_reading(channel, PERFECT, car, motion)[0] == pytest.approx(expected)


def test_added_weight_shows_as_a_static_offset_of_the_travel(car: Installation) -> None:
    weight = AddedMass((BodyWeight(100.0, -FORD_GRANADA.a, 0.0),))  # at the CG
    pose = static_pose(load_car(FORD_GRANADA, weight))
    still = np.zeros((7, 1))
    sagged = Kinematics(pose, still, still)
    p = FORD_GRANADA
    front = 100.0 * G * p.b / (p.a + p.b) / 2 / p.k_sf
    assert read("travel_fl", car, sagged) == pytest.approx(front, rel=1e-9)


def test_values_are_in_the_units_of_the_dbc(codec: Codec) -> None:
    one = np.array([1.0])
    assert sent(shipped_channel("body_acc_z"), one, codec)[0] == pytest.approx(1.0)
    assert sent(shipped_channel("pitch_rate"), one, codec)[0] == pytest.approx(57.29577951308232)
    assert sent(shipped_channel("hub_acc_fl"), one, codec)[0] == pytest.approx(1 / 9.80665)
    assert sent(shipped_channel("travel_rr"), 0.05 * one, codec)[0] == pytest.approx(50.0)


def test_a_sensor_saturates_at_the_range_of_its_bits(codec: Codec) -> None:
    mm = sent(shipped_channel("travel_fl"), np.array([-1.0, 0.0, 1.0]), codec)
    np.testing.assert_allclose(mm, [-327.68, 0.0, 327.67])


def test_weights_are_drawn_about_what_the_scales_showed() -> None:
    bench = load_bench(None)
    unsure = BodyWeight(30.0, 0.1, 0.5, sigma_kg=0.3, position_sigma_m=0.02)
    weights = (unsure, BodyWeight(30.0, 0.1, -0.5))
    state = replace(bench.mass_states[1], added=AddedMass(weights))
    bench = replace(bench, mass_states=(bench.mass_states[0], state))
    drawn = [truth(bench, SimulatedCar(), seed).mass_states["added"] for seed in range(300)]
    assert np.std([d.weights[0].mass_kg for d in drawn]) == pytest.approx(0.3, rel=0.15)
    places = np.array([(w.x_m, w.y_m) for d in drawn if isinstance(w := d.weights[0], BodyWeight)])
    np.testing.assert_allclose(places.std(axis=0), 0.02, rtol=0.15)
    assert {d.weights[1] for d in drawn} == {weights[1]}
