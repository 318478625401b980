"""The names and units of a vehicle's parameters, and where its corners are."""

from __future__ import annotations

import numpy as np
import pytest

from daq.vehicle import (
    PARAMETER_NAMES,
    AddedMass,
    Corner,
    Structure,
    parameter_names,
    parameter_unit,
)

BODY = ("m_s", "I_yy", "I_xx")
AXLES = ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr")
PLACES = ("a", "b", "t_f", "t_r")


@pytest.mark.parametrize(
    ("structure", "more"),
    [
        (Structure(), ()),
        (Structure(anti_roll_bars=True), ("k_af", "k_ar")),
        (Structure(tyre_damping=True), ("c_tf", "c_tr")),
        (Structure(cg_offset=True), ("y_s",)),
        (Structure(True, True, True, True), ("k_af", "k_ar", "c_tf", "c_tr", "y_s")),
    ],
)
def test_a_model_has_fifteen_parameters_and_those_of_what_it_has_more(
    structure: Structure, more: tuple[str, ...]
) -> None:
    assert parameter_names(structure) == (*BODY, *AXLES, *PLACES, *more)


def test_a_model_with_unlike_corners_has_each_of_them() -> None:
    corners = [f"{name}{side}" for name in AXLES for side in "lr"]
    assert parameter_names(Structure(symmetric=False)) == (*BODY, *corners, *PLACES)
    assert len(corners) == 16  # with the other seven: 23


def test_units_follow_from_the_first_letter() -> None:
    units = [parameter_unit(name) for name in PARAMETER_NAMES]
    assert units == [
        "kg", "kg m2", "kg m2", "kg", "kg", "N/m", "N/m", "N/m", "N/m", "N s/m", "N s/m",
        "m", "m", "m", "m",
    ]  # fmt: skip
    assert (parameter_unit("F_cf"), parameter_unit("y_s")) == ("N", "m")


def test_corners_are_counted_from_the_front_left_and_left_is_positive() -> None:
    assert [corner.position for corner in Corner] == [0, 1, 2, 3]
    assert [corner.front for corner in Corner] == [True, True, False, False]
    assert [corner.side for corner in Corner] == [1, -1, 1, -1]


def test_added_mass_is_a_matrix_of_seven_that_nobody_changes() -> None:
    assert AddedMass().matrix.shape == (7, 7)
    assert not AddedMass().matrix.any()
    assert not AddedMass().matrix.flags.writeable
    with pytest.raises(ValueError, match=r"7 x 7, not \(7, 6\)"):
        AddedMass(matrix=np.zeros((7, 6)))
