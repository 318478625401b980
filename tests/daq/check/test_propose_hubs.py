"""Hub sensors that no name places: by kicks against the tyres, and without gravity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.config import Bench
from daq.channels import Quantity
from daq.check.find_sensors import traffic_of
from daq.check.guess_hubs import ON_HUB
from daq.check.guess_sensor import guess_bench
from daq.check.propose import Proposal, propose_sensors
from daq.check.propose_message import Seen
from daq.check.push_test import ORDER
from dbc import FrameBatch, parse_codec
from dbc.samples import DecodeCounts, Decoded, Samples

from ..wild_bench import DATABASES, HUBS, rest_and_pushes
from .test_propose_sensors import FL, FR, RL, RR, bench_of

PLACES = {"Accel_1": RR, "Accel_2": FL, "Accel_3": FR, "Accel_4": RL}
"""Where hub sensors are in truth of which no name says so."""
NAMELESS = HUBS
for said, number in (("WheelAccelFL", 1), ("WheelAccelFR", 2), ("WheelAccelRL", 3)):
    NAMELESS = NAMELESS.replace(f"{said} ", f"Accel_{number} ")
NAMELESS = NAMELESS.replace("WheelAccelRR ", "Accel_4 ")


def with_kicks(pushes: FrameBatch) -> FrameBatch:
    """Return pushes with a kick of 30 m/s2 for 20 ms at each corner, 0.3 s after it was let go."""
    data = pushes.data.copy()
    for number, corner in enumerate(ORDER):
        sensor = int(next(name for name, place in PLACES.items() if place is corner)[-1]) - 1
        at_ns = pushes.t_ns[0] + round((1.0 + 2.2 * number + 1.5) * 1e9)
        inside = (pushes.t_ns >= at_ns) & (pushes.t_ns < at_ns + 20_000_000)
        own = inside & (pushes.bus == 0) & (pushes.can_id == 272 + sensor // 2)
        column = 2 * (sensor % 2)
        data[own, column : column + 2] = np.frombuffer(np.int16(3981).tobytes(), np.uint8)
    return replace(pushes, data=data)


def nameless(pushes: FrameBatch | None) -> tuple[Proposal, Bench]:
    databases = tuple(
        replace(each, text=NAMELESS) if each.name == "hubs.dbc" else each for each in DATABASES
    )
    found = propose_sensors(databases, (), rest_and_pushes()[0], pushes)
    return found, bench_of(found, databases)


def test_kicks_against_the_tyres_show_the_hubs() -> None:
    _, bench = nameless(with_kicks(rest_and_pushes()[1]))
    hubs = {c.signal.rpartition(".")[2]: c.corner for c in bench.channels if "hubs." in c.signal}
    assert hubs == PLACES
    named = [c for c in bench.channels if c.quantity is Quantity.HUB_ACCELERATION]
    assert len(named) == 4


def test_kicks_show_hubs_of_which_the_name_says_that_they_are_imus() -> None:
    imus = NAMELESS.replace("WheelAccelFront", "Imu_1").replace("WheelAccelRear", "Imu_2")
    databases = tuple(
        replace(each, text=imus) if each.name == "hubs.dbc" else each for each in DATABASES
    )
    rest, pushes = rest_and_pushes()
    bench = bench_of(propose_sensors(databases, (), rest, with_kicks(pushes)), databases)
    hubs = {c.signal.rpartition(".")[2]: c.corner for c in bench.channels if "hubs." in c.signal}
    assert hubs == PLACES
    found = propose_sensors(databases, (), rest, pushes)
    assert not [q for q in found.questions if ON_HUB in q]
    named = [c.quantity for c in bench_of(found, databases).channels if "hubs." in c.signal]
    assert named == [Quantity.BODY_ACCELERATION] * 4


def test_a_sensor_whose_name_says_body_is_no_hub_however_it_is_shaken() -> None:
    bodies = NAMELESS.replace("WheelAccelFront", "Body_1").replace("WheelAccelRear", "Body_2")
    databases = tuple(
        replace(each, text=bodies) if each.name == "hubs.dbc" else each for each in DATABASES
    )
    rest, pushes = rest_and_pushes()
    found = propose_sensors(databases, (), rest, with_kicks(pushes))
    named = [c.quantity for c in bench_of(found, databases).channels if "hubs." in c.signal]
    assert Quantity.HUB_ACCELERATION not in named
    assert not [q for q in found.questions if ON_HUB in q]


def test_without_kicks_hubs_that_no_name_shows_are_asked_for() -> None:
    for pushes in (None, rest_and_pushes()[1]):
        found, bench = nameless(pushes)
        asked = [q for q in found.questions if ON_HUB in q]
        assert asked == [f"channel hubs_Accel_{n}: {ON_HUB}" for n in (1, 2, 3, 4)]
        assert not [c for c in bench.channels if c.quantity is Quantity.HUB_ACCELERATION]


def test_a_kick_at_another_wheel_than_the_name_says_is_asked_for() -> None:
    _, pushes = rest_and_pushes()
    found = propose_sensors(DATABASES, (), rest_and_pushes()[0], with_kicks(pushes))
    asked = [q for q in found.questions if "are plugs swapped?" in q]
    assert asked == [
        f"channel hubs_WheelAccel{c}: its name says {c}: are plugs swapped?"
        for c in (FL, FR, RL, RR)
    ]


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
