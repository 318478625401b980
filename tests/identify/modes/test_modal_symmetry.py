"""Mirror images of sensors."""

from __future__ import annotations

import numpy as np
import pytest

from daq.channels import Channel, Quantity, paper_channels
from daq.vehicle import Corner
from identify.modes.vehicle_modes import mirror_of


def body(name: str, x_m: float, y_m: float) -> Channel:
    return Channel(name, Quantity.BODY_ACCELERATION, "m/s2", x_m=x_m, y_m=y_m)


def test_the_papers_channels_pair_up() -> None:
    mirror = mirror_of(paper_channels())
    assert list(mirror.image) == [0, 1, 2, 4, 3, 6, 5]
    assert list(mirror.sign) == [1, 1, -1, 1, 1, 1, 1]
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        mirror.combinations(-1.0),
        [[0, 0, 1, 0, 0, 0, 0], [0, 0, 0, half, -half, 0, 0], [0, 0, 0, 0, 0, half, -half]],
    )
    assert len(mirror.combinations(1.0)) == 4
    ties = mirror.ties(np.array([1.0, -1.0]))
    np.testing.assert_array_equal(
        ties.sign, [[1, 0], [1, 0], [0, 1], [1, 1], [1, -1], [1, 1], [1, -1]]
    )
    assert list(ties.owner) == [0, 1, 2, 3, 3, 4, 4]


def test_body_sensors_pair_by_place_and_a_lone_one_is_free() -> None:
    channels = (
        body("left", -1.0, 0.5),
        body("right", -1.0, -0.5),
        body("middle", -2.0, 0.0),
        body("lone", -2.0, 0.4),
        Channel("fl", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT),
        Channel("fr", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.FRONT_RIGHT),
    )
    mirror = mirror_of(channels)
    assert list(mirror.image) == [1, 0, 2, -1, -1, -1]
    np.testing.assert_array_equal(mirror.ties(np.array([-1.0])).sign.ravel(), [1, -1, 0, 1, 1, 1])


def test_the_image_of_a_sensor_at_the_cg_is_at_the_cg() -> None:
    """The place of the CG is unknown: a sensor at the stated origin is not beside it."""
    at_cg = Channel("cg", Quantity.BODY_ACCELERATION, "m/s2", at_cg=True)
    assert list(mirror_of((at_cg,)).image) == [0]
    assert list(mirror_of((at_cg, body("origin", 0.0, 0.0))).image) == [0, 1]


def test_two_sensors_at_one_place_have_no_certain_image() -> None:
    mirror = mirror_of((body("one", -1.0, 0.5), body("two", -1.0, 0.5), body("right", -1.0, -0.5)))
    assert list(mirror.image) == [-1, -1, -1]


@pytest.mark.parametrize(("apart_m", "image"), [(0.0049, [1, 0]), (0.0051, [-1, -1])])
def test_a_mirror_image_is_at_its_place_to_five_millimetres(
    apart_m: float, image: list[int]
) -> None:
    mirror = mirror_of((body("left", -1.0, 0.5), body("right", -1.0 - apart_m, -0.5)))
    assert list(mirror.image) == image


def test_a_mirror_cannot_be_changed() -> None:
    mirror = mirror_of(paper_channels())
    assert not mirror.image.flags.writeable
    assert not mirror.sign.flags.writeable


def test_a_pair_of_the_first_two_channels_is_tied() -> None:
    mirror = mirror_of((body("left", -1.0, 0.5), body("right", -1.0, -0.5), body("lone", 0.0, 1.0)))
    ties = mirror.ties(np.array([1.0, -1.0]))
    assert ties.owner.tolist() == [0, 0, 1]
    assert ties.sign.tolist() == [[1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]


def test_five_millimetres_are_still_the_mirror_place() -> None:
    assert list(mirror_of((body("left", 0.0, 0.5), body("right", 0.005, -0.5))).image) == [1, 0]
