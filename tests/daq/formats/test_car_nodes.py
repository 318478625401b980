"""The car as nodes and lines: where each stands, and how it moves, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.formats.export.car_nodes import (
    CarNodes,
    car_lines,
    car_nodes,
    place_of,
    vertical_motion,
    wheel_places,
)
from daq.vehicle import Corner, Fact, FactQuantity, Vehicle, VehicleGeometry

CAR = VehicleGeometry(1.25, 1.5, 0.74, 0.76)
FACTS = (
    Fact(FactQuantity.WHEELBASE, 2.75, 0.01),
    Fact(FactQuantity.FRONT_TRACK, 1.48, 0.01),
    Fact(FactQuantity.REAR_TRACK, 1.52, 0.01),
)
CHANNELS = (
    Channel("hub", Quantity.HUB_ACCELERATION, corner=Corner.FRONT_LEFT),
    Channel("az", Quantity.BODY_ACCELERATION, x_m=-1.0, y_m=0.5),
    Channel("cg", Quantity.BODY_ACCELERATION, at_cg=True),
    Channel("pitch", Quantity.PITCH_RATE),
    Channel("z", Quantity.BODY_DISPLACEMENT, x_m=0.25, y_m=-0.5),
)


def _places(nodes: CarNodes | None) -> dict[int, tuple[float, ...]]:
    assert nodes is not None
    return dict(zip(nodes.labels.tolist(), map(tuple, nodes.positions_m.tolist()), strict=True))


WHEELS = {
    1: (0.0, 0.74, 0.5),
    2: (0.0, -0.74, 0.5),
    3: (-2.75, 0.76, 0.5),
    4: (-2.75, -0.76, 0.5),
    11: (0.0, 0.74, 0.0),
    12: (0.0, -0.74, 0.0),
    13: (-2.75, 0.76, 0.0),
    14: (-2.75, -0.76, 0.0),
}
SENSORS = {102: (-1.0, 0.5, 0.5), 105: (0.25, -0.5, 0.5)}


def test_nodes_of_a_car_whose_dimensions_are_known() -> None:
    found = _places(car_nodes(Vehicle("car", CAR), CHANNELS))
    assert found == {**WHEELS, 5: (-1.25, 0.0, 0.5), **SENSORS}


def test_nodes_of_a_car_whose_centre_of_gravity_is_not_known() -> None:
    assert _places(car_nodes(Vehicle("car", facts=FACTS), CHANNELS)) == {**WHEELS, **SENSORS}
    places = wheel_places(Vehicle("car", facts=FACTS))
    assert places is not None
    assert np.isnan(places[0])
    assert places[1:] == (2.75, 0.74, 0.76)


@pytest.mark.parametrize("lacking", range(3))
def test_a_car_without_one_of_its_lengths_has_no_nodes(lacking: int) -> None:
    facts = tuple(fact for i, fact in enumerate(FACTS) if i != lacking)
    assert wheel_places(Vehicle("car", facts=facts)) is None
    assert car_nodes(Vehicle("car", facts=facts), CHANNELS) is None


def test_lines_of_a_car() -> None:
    assert dict(car_lines()) == {
        "body": (1, 2, 4, 3, 1),
        "suspension": (1, 11, 0, 2, 12, 0, 3, 13, 0, 4, 14),
        "axles": (11, 12, 0, 13, 14),
    }


@pytest.mark.parametrize(
    ("channel", "place"),
    [
        (CHANNELS[0], (11, 3, 0)),
        (Channel("h", Quantity.HUB_DISPLACEMENT, corner=Corner.REAR_RIGHT), (14, 3, 0)),
        (Channel("s", Quantity.SUSPENSION_TRAVEL, corner=Corner.FRONT_RIGHT), (12, 3, 2)),
        (Channel("s", Quantity.SUSPENSION_TRAVEL, corner=Corner.REAR_LEFT), (13, 3, 3)),
        (CHANNELS[1], (108, 3, 0)),
        (CHANNELS[2], (5, 3, 0)),
        (CHANNELS[3], (5, 5, 0)),
        (Channel("p", Quantity.PITCH_ACCELERATION), (5, 5, 0)),
        (Channel("r", Quantity.ROLL_RATE), (5, 4, 0)),
        (Channel("r", Quantity.ROLL_ACCELERATION), (5, 4, 0)),
        (Channel("yaw", Quantity.UNUSED), (0, 0, 0)),
    ],
)
def test_where_the_eighth_channel_measures(channel: Channel, place: tuple[int, int, int]) -> None:
    found = place_of(7, channel)
    assert (found.node, found.direction, found.against) == place


@pytest.mark.parametrize(
    ("moving", "motion"),
    [
        (0, dict.fromkeys((1, 2, 3, 4, 5, 102, 105), 1)),
        # A point behind the CG goes up where the body turns about y, one in front of it down.
        (1, {1: -1.25, 2: -1.25, 3: 1.5, 4: 1.5, 102: -0.25, 105: -1.5}),
        # To the left of it one goes up where the body turns about x.
        (2, {1: 0.74, 2: -0.74, 3: 0.76, 4: -0.76, 102: 0.5, 105: -0.5}),
        (3, {11: 1}),
        (4, {12: 1}),
        (5, {13: 1}),
        (6, {14: 1}),
    ],
)
def test_how_nodes_move_with_each_degree_of_freedom(moving: int, motion: dict[int, float]) -> None:
    nodes = car_nodes(Vehicle("car", CAR), CHANNELS)
    assert nodes is not None
    shapes = np.zeros((7, 2), complex)
    shapes[moving, 1] = 2.0j
    found = vertical_motion(nodes, shapes, CAR)
    expected = np.array([2.0j * motion.get(label, 0.0) for label in nodes.labels.tolist()])
    np.testing.assert_allclose(found[:, 1], expected, atol=1e-15)
    assert not found[:, 0].any()
