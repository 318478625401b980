"""Hub sensors that no name places: the user is asked; and without gravity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.config import Bench
from daq.channels import Quantity
from daq.check.find_sensors import traffic_of
from daq.check.guess_sensor import guess_bench
from daq.check.propose import Proposal, propose_sensors
from daq.check.propose_message import Seen
from dbc import FrameBatch, parse_codec
from dbc.samples import DecodeCounts, Decoded, Samples

from ..wild_bench import DATABASES, HUBS, rest_and_pushes
from .test_propose_sensors import FL, bench_of

ASKED = "is it on the body, or on which hub?"
NAMELESS = HUBS
for said, number in (("WheelAccelFL", 1), ("WheelAccelFR", 2), ("WheelAccelRL", 3)):
    NAMELESS = NAMELESS.replace(f"{said} ", f"Accel_{number} ")
NAMELESS = NAMELESS.replace("WheelAccelRR ", "Accel_4 ")


def nameless(pushes: FrameBatch | None) -> tuple[Proposal, Bench]:
    databases = tuple(
        replace(each, text=NAMELESS) if each.name == "hubs.dbc" else each for each in DATABASES
    )
    found = propose_sensors(databases, (), rest_and_pushes()[0], pushes)
    return found, bench_of(found, databases)


def test_hubs_that_no_name_shows_are_asked_for() -> None:
    for pushes in (None, rest_and_pushes()[1]):
        found, bench = nameless(pushes)
        asked = [q for q in found.questions if ASKED in q]
        assert asked == [f"channel hubs_Accel_{n}: {ASKED}" for n in (1, 2, 3, 4)]
        assert not [c for c in bench.channels if c.quantity is Quantity.HUB_ACCELERATION]


@pytest.mark.parametrize(("level_g", "is_hub"), [(0.09, True), (0.11, False), (0.9, True)])
def test_a_hub_sensor_that_shows_no_gravity_is_one_of_an_ac_coupled_sensor(
    level_g: float, is_hub: bool
) -> None:
    message = parse_codec(HUBS, "hubs.dbc").message("WheelAccelFront")
    message = replace(message, signals=message.signals[:1])
    name, n = "WheelAccelFront.WheelAccelFL", 40
    value = np.full(n, level_g * 9.80665)
    samples = Samples(name, np.arange(n) * 2_000_000, value, np.zeros(n, np.uint8))
    known = {message.name: next(iter(traffic_of(rest_and_pushes()[0]).values()))}
    seen = Seen(known, Decoded({name: samples}, DecodeCounts(0, 0, 0, 0, 0)))
    guess = guess_bench([message], {}, seen, None, {})[name]
    assert (guess.quantity is Quantity.HUB_ACCELERATION) == is_hub
    assert (guess.corner is FL) == is_hub
    assert ("is it AC-coupled" in guess.ask) == (level_g == 0.09)
