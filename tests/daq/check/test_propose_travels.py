"""Travels of which nothing states the unit."""

from __future__ import annotations

import numpy as np
import pytest

from daq.channels import Quantity
from daq.check.answers import answered
from daq.check.find_sensors import traffic_of
from daq.check.guess_map import Asked, kind_by_name, unit_by_peak
from daq.check.guess_sensor import guess_bench
from daq.check.propose_message import Seen
from daq.vehicle import Corner
from dbc import parse_codec
from dbc.samples import DecodeCounts, Decoded, Samples

from ..wild_bench import POT, rest_and_pushes

MESSAGE = parse_codec(
    POT.replace("Position_Value", "pot_fl").replace('"mm"', '""'), "pot.dbc"
).message("TPDO1")


@pytest.mark.parametrize(
    ("peak", "unit"),
    [(0.0, "mm"), (0.004, "mm"), (0.006, "m"), (0.9, "m"), (1.1, "mm"), (120, "mm")],
)
def test_the_unit_of_travels_by_what_they_read(peak: float, unit: str) -> None:
    assert unit_by_peak(peak) == unit


@pytest.mark.parametrize(
    ("name", "message", "kind"),
    [
        ("pot_fl", "TPDO1", "m"),
        ("pot_1", "TPDO1", None),
        ("door_pos_fl", "TPDO1", None),
        ("damper_dist_fl", "TPDO1", None),
        ("pot_fl", "Radar", None),
        ("pot_fl_status", "TPDO1", None),
    ],
)
def test_a_length_without_a_unit_is_one_if_it_is_a_travel_of_a_corner(
    name: str, message: str, kind: str | None
) -> None:
    text = POT.replace("Position_Value", name).replace('"mm"', '""')
    signal = parse_codec(text, "pot.dbc").message("TPDO1").signal(name)
    assert kind_by_name(message, signal) == kind


def test_a_travel_without_a_unit_is_proposed_and_asked_for() -> None:
    name, n = "TPDO1.pot_fl", 40
    samples = Samples(name, np.arange(n) * 5_000_000, np.full(n, 120.0), np.zeros(n, np.uint8))
    known = {"TPDO1": next(iter(traffic_of(rest_and_pushes()[0]).values()))}
    seen = Seen(known, Decoded({name: samples}, DecodeCounts(0, 0, 0, 0, 0)))
    guess = guess_bench([MESSAGE], {}, seen, None, {})[name]
    assert guess.quantity is Quantity.SUSPENSION_TRAVEL
    assert (guess.corner, guess.unit, guess.asked) == (Corner.FRONT_LEFT, "mm", Asked.UNIT)
    assert guess.ask == "no unit is stated: is it mm?"
    assert guess.tare == pytest.approx(0.12)
    in_cm = answered(guess, "cm")
    assert (in_cm.unit, in_cm.ask) == ("cm", "")
    assert in_cm.tare == pytest.approx(1.2)
