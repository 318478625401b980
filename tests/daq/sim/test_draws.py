"""What is drawn for a simulated bench has the spread that the bench states."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.sim.car import SimulatedCar, Spread, draw
from daq.vehicle import Corner

MANY = 3000
"""Draws: the standard deviation of so many is 1.3 % uncertain."""


def many(**facts: Any) -> list[Channel]:
    kind = Quantity.SUSPENSION_TRAVEL if "motion_ratio" in facts else Quantity.BODY_ACCELERATION
    corner = Corner.FRONT_LEFT if "motion_ratio" in facts else None
    first = replace(Channel("c", kind, corner=corner), **facts)
    return [replace(first, name=f"c{k}", signal=f"M{k}.a") for k in range(MANY)]


def test_gain_and_motion_ratio_are_off_by_their_relative_uncertainties() -> None:
    drawn = draw(many(motion_ratio=0.5, motion_ratio_sigma=0.02), (), SimulatedCar(), 1)
    gain = np.array([sensor.gain for sensor in drawn.sensors.values()])
    assert gain.mean() == pytest.approx(1.0, abs=0.003)
    assert gain.std() == pytest.approx(0.04, rel=0.06)
    both = draw(
        many(motion_ratio=0.5, motion_ratio_sigma=0.02, gain_sigma=0.03), (), SimulatedCar(), 1
    )
    assert np.std([sensor.gain for sensor in both.sensors.values()]) == pytest.approx(
        0.05, rel=0.06
    )
    exact = draw(many(motion_ratio=0.5), (), SimulatedCar(), 1)
    assert {sensor.gain for sensor in exact.sensors.values()} == {1.0}


def test_places_delays_and_zeros_are_off_by_their_uncertainties() -> None:
    channels = many(
        x_m=-1.0, y_m=0.4, position_sigma_m=0.03, delay_s=0.01, delay_sigma_s=0.001
    )  # fmt: skip
    sensors = list(draw(channels, (), SimulatedCar(), 2).sensors.values())
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
    first, second = draw(pair, (), SimulatedCar(), 5).sensors.values()
    assert second.delay_s - first.delay_s == pytest.approx(0.01)
    assert first.x_m != second.x_m or first.bias != second.bias


def test_each_message_has_a_clock_with_any_phase() -> None:
    clocks = draw(many(), (), SimulatedCar(clock_error=2e-5), 4).clocks
    phase = np.array([clock.phase for clock in clocks.values()])
    error = np.array([clock.error for clock in clocks.values()])
    assert len(clocks) == MANY
    assert phase.min() >= 0.0
    assert phase.max() < 1.0
    assert phase.std() == pytest.approx(np.sqrt(1 / 12), rel=0.04)
    assert error.std() == pytest.approx(2e-5, rel=0.06)


@pytest.mark.parametrize(
    ("quantity", "sigma"),
    [
        (Quantity.BODY_ACCELERATION, 1.0),
        (Quantity.HUB_ACCELERATION, 2.0),
        (Quantity.PITCH_RATE, 3.0),
        (Quantity.ROLL_RATE, 3.0),
        (Quantity.PITCH_ACCELERATION, 4.0),
        (Quantity.ROLL_ACCELERATION, 4.0),
        (Quantity.SUSPENSION_TRAVEL, 5.0),
        (Quantity.BODY_DISPLACEMENT, 5.0),
        (Quantity.HUB_DISPLACEMENT, 5.0),
        (Quantity.UNUSED, 0.0),
    ],
)
def test_each_kind_of_sensor_has_its_own_spread(quantity: Quantity, sigma: float) -> None:
    assert Spread(1.0, 2.0, 3.0, 4.0, 5.0).of(quantity) == sigma


def test_no_sensor_foresees() -> None:
    sensors = draw(many(delay_s=0.0, delay_sigma_s=0.001), (), SimulatedCar(), 3).sensors
    delay_s = np.array([sensor.delay_s for sensor in sensors.values()])
    assert delay_s.min() == 0.0
    assert np.mean(delay_s == 0.0) == pytest.approx(0.5, abs=0.04)
