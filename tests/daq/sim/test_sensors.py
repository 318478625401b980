"""Signs, gravity and conversion of the sensors, by motions made by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Campaign
from daq.bench.config import WeightTable, load_bench
from daq.channels import Channel, Quantity
from daq.runs import Excitation
from daq.sim.car import (
    NOISE,
    SensorTruth,
    SimulatedCar,
    Spread,
    low_pass,
    signal_values,
    true_reading,
)
from daq.sim.ecu import campaign_frames
from daq.sim.motion import GRAVITY_M_S2, Kinematics, Plant, load_car
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner
from dbc import Codec, parse_codec, shipped_dbc
from dbc.words import InputError

G = GRAVITY_M_S2
SILENT = Spread(0.0, 0.0, 0.0, 0.0, 0.0)
PERFECT = SensorTruth(x_m=-1.05, y_m=0.12, delay_s=0.0, bias=0.0)


@pytest.fixture(scope="module")
def codec() -> Codec:
    return parse_codec(shipped_dbc(), "shipped")


@pytest.fixture(scope="module")
def car() -> Plant:
    return load_car(FORD_GRANADA, AddedMass())


def shipped_channel(name: str) -> Channel:
    return next(channel for channel in load_bench(None).channels if channel.name == name)


def made(
    car: Plant,
    pose: dict[int, float] | None = None,
    velocity: dict[int, float] | None = None,
    acceleration: dict[int, float] | None = None,
) -> Kinematics:
    """One instant, away from rest in the given degrees of freedom."""
    rows = np.zeros((3, 7, 1))
    for row, moved in zip(rows, (pose, velocity, acceleration), strict=True):
        for dof, value in (moved or {}).items():
            row[dof] = value
    return Kinematics(car.static_pose() + rows[0], rows[1], rows[2])


def read(name: str, car: Plant, motion: Kinematics) -> float:
    return float(true_reading(shipped_channel(name), PERFECT, car, motion)[0])


def test_at_rest_only_gravity_is_felt(car: Plant) -> None:
    rest = made(car)
    for channel in load_bench(None).channels:
        vertical = channel.quantity in (Quantity.BODY_ACCELERATION, Quantity.HUB_ACCELERATION)
        expected = G if vertical else 0.0
        assert read(channel.name, car, rest) == pytest.approx(expected, abs=1e-12)


def test_nose_down_by_forces(car: Plant) -> None:
    # Push the front axle into its springs: nose down is positive pitch, and the front compresses.
    pushed = made(car, pose={1: 0.02}, velocity={1: 0.3}, acceleration={1: 2.0})
    assert read("pitch_rate", car, pushed) == pytest.approx(0.3)
    assert read("roll_rate", car, pushed) == 0.0
    assert read("travel_fl", car, pushed) == pytest.approx(0.02 * FORD_GRANADA.a)
    assert read("travel_rr", car, pushed) == pytest.approx(-0.02 * FORD_GRANADA.b)
    # The IMU sits 0.2 m ahead of the CG, where the body is being accelerated downwards.
    assert read("body_acc_z", car, pushed) == pytest.approx(G - 2.0 * 0.2)


def test_a_lifted_wheel_compresses_its_own_suspension(car: Plant) -> None:
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
    with pytest.raises(InputError, match=r"body_acc_z: SUSP_Front\.travel_fl has unit 'mm'"):
        signal_values(channel, layout, PERFECT, SILENT, np.zeros(1), np.random.default_rng(0))


def test_left_side_up(car: Plant) -> None:
    lifted = made(car, pose={2: 0.03}, velocity={2: -0.1}, acceleration={2: 5.0})
    assert read("roll_rate", car, lifted) == pytest.approx(-0.1)
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
    quantity: Quantity, corner: Corner | None, expected: float, car: Plant
) -> None:
    motion = made(car, pose={0: 0.01, 1: 0.02, 2: 0.05, 6: 0.07}, acceleration={1: 0.5, 2: -0.25})
    channel = Channel("c", quantity, "", corner=corner)
    assert true_reading(channel, PERFECT, car, motion)[0] == pytest.approx(expected)


def test_added_weight_shows_as_a_static_offset_of_the_travel(car: Plant) -> None:
    weight = AddedMass((BodyWeight(100.0, -FORD_GRANADA.a, 0.0),))  # at the CG
    pose = load_car(FORD_GRANADA, weight).static_pose()
    still = np.zeros((7, 1))
    sagged = Kinematics(pose, still, still)
    p = FORD_GRANADA
    front = 100.0 * G * p.b / (p.a + p.b) / 2 / p.k_sf
    assert read("travel_fl", car, sagged) == pytest.approx(front, rel=1e-9)


def test_a_sensor_saturates_at_the_range_of_its_bits(codec: Codec) -> None:
    mm = sent(shipped_channel("travel_fl"), np.array([-1.0, 0.0, 1.0]), codec)
    np.testing.assert_allclose(mm, [-327.68, 0.0, 327.67])


def test_weights_are_drawn_about_what_the_scales_showed() -> None:
    unsure = WeightTable(mass_kg=30.0, x_m=0.1, y_m=0.5, sigma_kg=0.3, position_sigma_m=0.02)
    weights = (unsure, WeightTable(mass_kg=30.0, x_m=0.1, y_m=-0.5))
    bench = replace(load_bench(None), weights=weights)
    drawn = [
        SimulatedCar().draw((), bench.mass_states, seed).mass_states["added"] for seed in range(300)
    ]
    assert np.std([d.weights[0].mass_kg for d in drawn]) == pytest.approx(0.3, rel=0.15)
    places = np.array([(w.x_m, w.y_m) for d in drawn if isinstance(w := d.weights[0], BodyWeight)])
    np.testing.assert_allclose(places.std(axis=0), 0.02, rtol=0.15)
    assert {d.weights[1] for d in drawn} == {weights[1].weight()}


# What is drawn for a simulated bench has the spread that the bench states -----------------------


MANY = 1000
"""Draws: the standard deviation of so many is 2.2 % uncertain."""


def many(**facts: Any) -> list[Channel]:
    kind = Quantity.SUSPENSION_TRAVEL if "motion_ratio" in facts else Quantity.BODY_ACCELERATION
    corner = Corner.FRONT_LEFT if "motion_ratio" in facts else None
    first = replace(Channel("c", kind, corner=corner), **facts)
    return [replace(first, name=f"c{k}", signal=f"M{k}.a") for k in range(MANY)]


def test_gain_and_motion_ratio_are_off_by_their_relative_uncertainties() -> None:
    drawn = SimulatedCar().draw(many(motion_ratio=0.5, motion_ratio_sigma=0.02), (), 1)
    gain = np.array([sensor.gain for sensor in drawn.sensors.values()])
    assert gain.mean() == pytest.approx(1.0, abs=0.003)
    assert gain.std() == pytest.approx(0.04, rel=0.06)
    both = SimulatedCar().draw(
        many(motion_ratio=0.5, motion_ratio_sigma=0.02, gain_sigma=0.03), (), 1
    )
    assert np.std([sensor.gain for sensor in both.sensors.values()]) == pytest.approx(
        0.05, rel=0.06
    )
    exact = SimulatedCar().draw(many(motion_ratio=0.5), (), 1)
    assert {sensor.gain for sensor in exact.sensors.values()} == {1.0}


def test_places_delays_and_zeros_are_off_by_their_uncertainties() -> None:
    channels = many(
        x_m=-1.0, y_m=0.4, position_sigma_m=0.03, delay_s=0.01, delay_sigma_s=0.001
    )  # fmt: skip
    sensors = list(SimulatedCar().draw(channels, (), 2).sensors.values())
    x_m, y_m = np.array([s.x_m for s in sensors]), np.array([s.y_m for s in sensors])
    delay_s, bias = np.array([s.delay_s for s in sensors]), np.array([s.bias for s in sensors])
    for value, mean, sigma in (
        (x_m, -1.0, 0.03), (y_m, 0.4, 0.03), (delay_s, 0.01, 0.001), (bias, 0.0, 0.05),
    ):  # fmt: skip
        assert value.mean() == pytest.approx(mean, abs=0.08 * sigma)
        assert value.std() == pytest.approx(sigma, rel=0.06)
    assert abs(np.corrcoef(x_m, y_m)[0, 1]) < 0.08


def test_signals_of_one_message_are_late_together() -> None:
    one = many(delay_s=0.01, delay_sigma_s=0.001)[0]
    pair = [one, replace(one, name="d", delay_s=0.02)]
    first, second = SimulatedCar().draw(pair, (), 5).sensors.values()
    assert second.delay_s - first.delay_s == pytest.approx(0.01)
    assert first.x_m != second.x_m or first.bias != second.bias


def test_each_message_has_a_clock_with_any_phase() -> None:
    clocks = SimulatedCar(clock_error=2e-5).draw(many(), (), 4).clocks
    phase = np.array([clock.phase for clock in clocks.values()])
    error = np.array([clock.error for clock in clocks.values()])
    assert len(clocks) == MANY
    assert phase.min() >= 0.0
    assert phase.max() < 1.0
    assert phase.std() == pytest.approx(np.sqrt(1 / 12), rel=0.04)
    assert error.std() == pytest.approx(2e-5, rel=0.06)


def test_no_sensor_foresees() -> None:
    sensors = SimulatedCar().draw(many(delay_s=0.0, delay_sigma_s=0.001), (), 3).sensors
    delay_s = np.array([sensor.delay_s for sensor in sensors.values()])
    assert delay_s.min() == 0.0
    assert np.mean(delay_s == 0.0) == pytest.approx(0.5, abs=0.04)


# The low-pass of a sensor -------------------------------------------------------------------------


STEP_S = 1e-4


@pytest.mark.parametrize(("order", "tail"), [(2, 1.0 / 17), (4, 1.0 / 257)])
def test_a_sine_is_damped_by_3_db_at_the_cut_off(order: int, tail: float) -> None:
    """Squared gain 1 / (1 + (f / f_c)^(2 n))."""
    t = np.arange(0.0, 2.0, STEP_S)
    for frequency_hz, power in ((20.0, 0.5), (40.0, tail)):
        swing = low_pass(3.0 + np.sin(2 * np.pi * frequency_hz * t), STEP_S, 20.0, order)
        assert swing[0] == 3.0  # it begins at rest
        assert 2 * np.mean((swing[-10000:] - 3.0) ** 2) == pytest.approx(power, rel=1e-3)


def test_a_low_pass_that_the_bench_states_is_in_its_frames(codec: Codec) -> None:
    """Frames come every millisecond: to filter those of a sound sensor is a coarser way to it."""
    quiet = SimulatedCar(noise=SILENT, bias=SILENT, jitter_s=0.0, lead_s=0.3, tail_s=0.6)
    shipped = load_bench(None)
    (hub,) = (replace(c, gain_sigma=0.0) for c in shipped.channels if c.name == "hub_acc_fl")
    campaign = Campaign((Excitation.ROLL,), 1, ("baseline",), bump_height_m=0.05)

    def values(channel: Channel) -> NDArray[np.float64]:
        bench = replace(shipped, channels=(channel,), campaign=campaign)
        (batch,) = campaign_frames(bench, codec, quiet, 3, 1_700_000_000_000_000_000)
        return codec.decode(batch)["HUB_Front.acc_fl"].value

    sound, filtered = values(hub), values(replace(hub, low_pass_hz=20.0, low_pass_order=2))
    np.testing.assert_allclose(filtered, low_pass(sound, 0.001, 20.0, 2), atol=0.004)
    assert np.abs(filtered - sound).max() > 0.3
