"""Names of modes by content."""

from __future__ import annotations

import numpy as np
import pytest

from daq.vehicle import FORD_GRANADA, VehicleGeometry
from identify.model.matrices import physical_model
from identify.modes.modal_model import MODE_NAMES, ModalModel, mode_names, modes_of

GEOMETRY = FORD_GRANADA.geometry
BASELINE = physical_model(FORD_GRANADA)
ADDED = BASELINE.with_mass(np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]))


def test_the_modes_of_the_granada_have_the_names_of_the_reference() -> None:
    assert mode_names(modes_of(BASELINE.A), GEOMETRY) == (
        "body bounce",
        "body pitch",
        "body roll",
        "rear wheels antisymmetric",
        "rear wheels symmetric",
        "front wheels antisymmetric",
        "front wheels symmetric",
    )


def test_the_swap_shows_in_the_names() -> None:
    names = mode_names(modes_of(ADDED.A), GEOMETRY)
    assert names[3:5] == ("rear wheels symmetric", "rear wheels antisymmetric")
    assert sorted(names) == sorted(MODE_NAMES)


def test_pure_motions_and_one_mode_too_many() -> None:
    shapes = np.zeros((7, 8), dtype=complex)
    shapes[0, 0] = shapes[1, 1] = shapes[2, 2] = 1j
    for number, (left, right) in enumerate([(3, 4), (5, 6)]):
        shapes[left, 3 + 2 * number : 5 + 2 * number] = 1.0
        shapes[right, 3 + 2 * number : 5 + 2 * number] = [1.0, -1.0]
    shapes[:, 7] = 0.1
    poles = np.asarray(-1.0 + 1j * np.arange(1.0, 9.0), dtype=np.complex128)
    assert mode_names(ModalModel(poles, shapes), GEOMETRY) == (*MODE_NAMES, "further mode")


@pytest.mark.parametrize(
    ("wheels", "name"), [(0.55, "body bounce"), (0.58, "front wheels symmetric")]
)
def test_two_wheels_count_by_the_root_of_their_squares_and_the_body_by_its_corners(
    wheels: float, name: str
) -> None:
    """Four corners at 0.4 have the norm 0.8; two wheels have it at 0.8 / sqrt(2) = 0.566 each."""
    shape = np.array([0.4, 0.0, 0.0, wheels, wheels, 0.0, 0.0], dtype=complex)
    model = ModalModel(np.array([-1.0 + 10.0j]), shape[:, None])
    assert mode_names(model, GEOMETRY) == (name,)


UNEQUAL = VehicleGeometry(1.0, 2.0, 0.6, 0.8)


@pytest.mark.parametrize(
    ("entries", "border", "name"),
    [
        ((0, 1, 0, 0, 0, 0, 0), 2.0 / 3.0, "body pitch"),
        ((0, 0, 1, 0, 0, 0, 0), 1.0 / 0.7, "body roll"),
        ((0, 0, 0, 1, 1, 0, 0), 2.0**0.5, "front wheels symmetric"),
        ((0, 0, 0, 1, -1, 0, 0), 2.0**0.5, "front wheels antisymmetric"),
        ((0, 0, 0, 0, 0, 1, 1), 2.0**0.5, "rear wheels symmetric"),
        ((0, 0, 0, 0, 0, 1, -1), 2.0**0.5, "rear wheels antisymmetric"),
    ],
)
@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_motion_names_a_mode_where_it_is_larger_than_the_bounce(
    entries: tuple[float, ...], border: float, name: str, share: float
) -> None:
    """Beside a bounce of 1, whose four corners have the norm 2.

    Pitch by the wheelbase of 3 m, roll by twice the mean half track of 0.7 m, two wheels by
    sqrt(2).
    """
    shape = np.array([share * border * entry for entry in entries], dtype=complex)
    shape[0] += 1.0
    model = ModalModel(np.array([-1.0 + 10.0j]), shape[:, None])
    assert mode_names(model, UNEQUAL) == (name if share > 1.0 else "body bounce",)
