"""Facts that sessions of one car should state alike, and do not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from daq.channels import Channel, Quantity
from daq.vehicle import Corner, Fact, VehicleGeometry
from identify import Identification, Judgement
from identify.compare import stated_unlike

BODY = Channel("acc", Quantity.BODY_ACCELERATION, x_m=1.2, y_m=0.4)
HUB = Channel("hub", Quantity.HUB_ACCELERATION, corner=Corner.FRONT_LEFT)
RATE = Channel("gyro", Quantity.PITCH_RATE, x_m=1.0)


def stated(
    vehicle: str = "Golf",
    channels: tuple[Channel, ...] = (),
    facts: tuple[Fact, ...] = (),
    geometry: VehicleGeometry | None = None,
) -> Identification:
    box = SimpleNamespace(
        geometry=geometry, facts=facts, groups=(SimpleNamespace(channels=channels),)
    )
    fit = cast(Any, SimpleNamespace(box=box))
    return Identification(Judgement((), 1.0), {}, vehicle=vehicle, estimation=fit)


def unlike(*results: Identification) -> tuple[str, ...]:
    return stated_unlike([chr(ord("a") + i) for i in range(len(results))], results)


def test_two_vehicles_are_named_with_the_sessions_of_each() -> None:
    assert unlike(stated(), stated("Polo"), stated()) == ("vehicle Golf in a, c; Polo in b",)
    assert unlike(stated(), stated(""), stated()) == (), "a name that is not stated is no other"


@pytest.mark.parametrize(
    ("sigma_m", "second_m", "differs"),
    [
        # The sigma of the difference is 1.4142 times that of each, and three of it are allowed.
        (0.01, 2.642, False),
        (0.01, 2.643, True),
        (0.01, 2.558, False),
        (0.01, 2.557, True),
        (1e-5, 2.601, False),  # a millimetre is never reported
        (1e-5, 2.6011, True),
    ],
)
def test_a_wheelbase_differs_beyond_its_uncertainty(
    sigma_m: float, second_m: float, differs: bool
) -> None:
    first, second = (
        stated(facts=(Fact("wheelbase_m", value, sigma_m), Fact("total_mass_kg", value, 1e-9)))
        for value in (2.6, second_m)
    )
    text = f"wheelbase 2.6 m in a; {second_m:.4g} m in b"
    assert unlike(first, second) == ((text,) if differs else ()), "a mass may change"


def test_measured_lengths_are_those_of_the_facts() -> None:
    geometry = VehicleGeometry(1.2, 1.4, 0.7, 0.75)
    facts = (Fact("wheelbase_m", 2.6, 0.001), Fact("rear_track_m", 1.45, 0.001))
    assert unlike(stated(geometry=geometry), stated(facts=facts)) == (
        "rear track 1.5 m in a; 1.45 m in b",
    )
    moved = VehicleGeometry(1.3, 1.3, 0.7, 0.75)  # the CG of a car with other things on board
    assert unlike(stated(geometry=geometry), stated(geometry=moved)) == ()


def test_sensors_have_their_places_where_places_count() -> None:
    one = stated(channels=(BODY, HUB, RATE))
    moved = Channel("acc", Quantity.BODY_ACCELERATION, x_m=1.2, y_m=-0.4)
    other = Channel("hub", Quantity.HUB_ACCELERATION, corner=Corner.REAR_RIGHT)
    turned = Channel("gyro", Quantity.PITCH_RATE, x_m=0.0)
    assert unlike(one, stated(channels=(moved, other, turned))) == (
        "place of acc (1.2, 0.4) m in a; (1.2, -0.4) m in b",
        "place of hub FL in a; RR in b",
    )
    middle = Channel("acc", Quantity.BODY_ACCELERATION, at_cg=True)
    assert unlike(one, stated(channels=(middle,))) == (
        "place of acc (1.2, 0.4) m in a; at the CG in b",
    )
    vague = Channel("acc", Quantity.BODY_ACCELERATION, x_m=1.3, y_m=0.4, position_sigma_m=0.04)
    assert unlike(one, stated(channels=(vague,))) == ()


def test_a_session_without_a_fit_has_its_name_alone() -> None:
    refused = Identification(Judgement((), 1.0), {}, vehicle="Polo")
    assert unlike(stated(channels=(BODY,)), refused) == ("vehicle Golf in a; Polo in b",)
