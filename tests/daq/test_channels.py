"""A channel knows its unit, and refuses what does not fit."""

from typing import Any

import pytest

from daq.channels import SI_UNITS, TIME_DERIVATIVE, Channel, Quantity
from daq.vehicle import Corner

TEXT: dict[str, Any] = {"name": "fl", "quantity": "hub_acceleration", "corner": "FL"}


def test_the_unit_is_that_of_the_quantity() -> None:
    assert Channel("r", Quantity.ROLL_RATE).unit == "rad/s"
    assert Channel("r", Quantity.ROLL_RATE, "rad/s").unit == "rad/s"
    assert Channel("yaw", Quantity.UNUSED, "deg/s").unit == "deg/s"
    assert Channel("yaw", Quantity.UNUSED).unit == ""


def test_the_unit_shows_how_often_a_displacement_is_derived() -> None:
    order = {"m/s2": 2, "rad/s2": 2, "rad/s": 1, "m": 0}
    assert set(Quantity) - set(TIME_DERIVATIVE) == {Quantity.UNUSED}
    for quantity, derivative in TIME_DERIVATIVE.items():
        assert derivative == order[SI_UNITS[quantity]], quantity


def test_another_unit_is_refused() -> None:
    with pytest.raises(ValueError, match="channel r: roll_rate is in rad/s, not deg/s"):
        Channel("r", Quantity.ROLL_RATE, "deg/s")


def test_corners_and_quantities_may_be_texts() -> None:
    hub = Channel("fl", Quantity("hub_acceleration"), corner=Corner("FL"))
    assert Channel(**TEXT) == hub
    assert Channel(**TEXT).corner is Corner.FRONT_LEFT


def test_a_corner_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"channel fl: no corner is 'FM' .* FL, FR, RL, RR"):
        Channel(**TEXT | {"corner": "FM"})
    with pytest.raises(ValueError, match=r"channel fl: no quantity is 'speed' .*hub_acceleration"):
        Channel(**TEXT | {"quantity": "speed"})
    with pytest.raises(ValueError, match="channel fl: hub_acceleration needs a corner"):
        Channel("fl", Quantity.HUB_ACCELERATION)
    with pytest.raises(ValueError, match="channel p: pitch_rate has no corner"):
        Channel("p", Quantity.PITCH_RATE, corner=Corner.FRONT_LEFT)
