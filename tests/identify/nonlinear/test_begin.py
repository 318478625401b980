"""Where a nonlinear fit begins: at a linear fit, if it is that of a vehicle."""

from __future__ import annotations

import numpy as np
import pytest

from identify.fit.grey_box import GreyBox
from identify.nonlinear.begin import is_impossible, scaled_to_vehicle

from ..bumps import GROUP, MASS_STATES, TRUTH
from .cars import RICH, granada

BOX = GreyBox((GROUP,), MASS_STATES, None, RICH)
VEHICLES = tuple(TRUTH * np.where(np.arange(15) == 0, kg / TRUTH[0], 1.0) for kg in (1e3, 5e2, 4e3))
"""Vehicles of 1000, 500 and 4000 kg: 250 to 8000 kg are within a factor of two of them."""


@pytest.mark.parametrize(
    ("body_kg", "kept_kg"),
    [(240.0, 1000.0), (260.0, 260.0), (7900.0, 7900.0), (8100.0, 1000.0), (3e4, 1000.0)],
)
def test_masses_and_forces_of_no_vehicle_are_scaled_together(
    body_kg: float, kept_kg: float
) -> None:
    full = granada()
    full[0] = body_kg
    eta = BOX.unknowns_of(full)
    before = dict(zip(BOX.names, BOX.values(eta), strict=True))
    after = dict(zip(BOX.names, BOX.values(scaled_to_vehicle(BOX, eta, VEHICLES)), strict=True))
    factor = kept_kg / before["m_s"]
    for name in ("m_s", "I_yy", "I_xx", "m_uf", "m_ur", "k_sf", "k_tr", "c_sf", "k_af", "k_ar"):
        assert after[name] == pytest.approx(factor * before[name], rel=1e-12), name
    for name in ("a", "b", "t_f", "t_r", "y_s"):
        assert after[name] == before[name]


@pytest.mark.parametrize(
    ("index", "factor", "no_vehicle"),
    [(11, 0.26, False), (11, 0.24, True), (8, 3.9, False), (8, 4.1, True), (0, 0.13, False),
     (0, 0.12, True), (0, 15.9, False), (0, 16.1, True)],
)  # fmt: skip
def test_a_parameter_four_times_beyond_all_vehicles_is_that_of_none(
    index: int, factor: float, no_vehicle: bool
) -> None:
    wide = tuple(TRUTH * np.where(np.arange(15) == 0, share, 1.0) for share in (1.0, 0.5, 4.0))
    theta = TRUTH.copy()
    theta[index] *= factor
    assert is_impossible(BOX, BOX.unknowns(theta), wide) is no_vehicle


def test_no_bar_and_no_offset_are_those_of_a_vehicle() -> None:
    assert not is_impossible(BOX, BOX.unknowns(TRUTH), VEHICLES)
