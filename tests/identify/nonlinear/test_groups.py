"""The elements that a bench may force or forbid are those that the fit knows."""

from __future__ import annotations

import numpy as np
import pytest

from daq.bench.bench_tables import StructureTable
from daq.vehicle import ELEMENTS, Fact
from identify.fit.grey_box import GreyBox
from identify.nonlinear.begin import weak_priors
from identify.nonlinear.car import K_S, K_T, KNOTS, MASS, STATIC, Model, X, Y, car
from identify.nonlinear.release import BY_NAME, GROUPS, STAGES

from .cars import RICH, bent, granada, model_of
from .truth import BASELINE


def test_bench_file_vehicle_and_fit_know_the_same_elements() -> None:
    names = {group.name for group in GROUPS}
    assert names == set(ELEMENTS)
    assert names == set(StructureTable.model_fields) - {"symmetric"}
    released = {name for stage in STAGES for name in stage}
    assert released | {"damper_mounts", "static_friction"} == names


def test_an_element_that_is_not_stated_is_left_to_the_data() -> None:
    assert StructureTable().decided == {}
    stated = StructureTable(friction=False, anti_roll_bars=True)
    assert stated.decided == {"anti_roll_bars": True, "friction": False}


def test_unequal_corners_differ_by_their_share_left_and_right() -> None:
    model = model_of()
    eta = bent(model, dk_sf=0.2, dk_tr=-0.1, dm_uf=0.3)
    one = car(model, eta, BASELINE, np.array([model.names.index("dk_sf")]))
    assert one.corner[:, K_S] == pytest.approx([1.02 * 17e3, 0.98 * 17e3, 22e3, 22e3])
    assert one.corner[:, K_T] == pytest.approx([192e3, 192e3, 0.99 * 192e3, 1.01 * 192e3])
    assert one.corner[:, MASS] == pytest.approx([1.03 * 40.5, 0.97 * 40.5, 45.4, 45.4])
    assert one.d_corner[:, K_S, 0] == pytest.approx([1.7e3, -1.7e3, 0.0, 0.0])


def test_a_heavier_wheel_weighs_on_the_scales() -> None:
    names = ("corner_fl_kg", "corner_fr_kg", "corner_rl_kg", "corner_rr_kg")
    facts = tuple(Fact(name, 0.0, 1.0) for name in names)
    model = Model(GreyBox((), (BASELINE,), None, RICH, facts), KNOTS["K3"])
    even, _ = model.fact_misfits(bent(model))
    uneven, slopes = model.fact_misfits(bent(model, dm_uf=0.3, dm_ur=-0.5))
    # Units of 0.1: 3 % of 40.5 kg more on the front left, 5 % of 45.4 kg less on the rear left.
    np.testing.assert_allclose(even - uneven, [1.215, -1.215, -2.27, 2.27], rtol=1e-9)
    np.testing.assert_allclose(
        slopes[:, model.names.index("dm_uf")], [4.05, -4.05, 0.0, 0.0], rtol=1e-9
    )


def test_wheels_that_lift_show_the_cross_weight_without_scales() -> None:
    """A free four-legged table: two opposite wheels carry more, and nothing turns it over."""
    model = Model(GreyBox((), (BASELINE,), None, RICH, lifts=True), KNOTS["K3"])
    place = model.names.index("cross weight")
    even, crossed = bent(model), bent(model)
    crossed[place] = 0.4
    before, after = (car(model, eta, BASELINE, np.array([place])) for eta in (even, crossed))
    more = after.corner[:, STATIC] - before.corner[:, STATIC]
    assert more[0] == pytest.approx(4.0 * 9.80665)
    assert more[1] == pytest.approx(-more[0])
    assert [more.sum(), more @ after.corner[:, X], more @ after.corner[:, Y]] == pytest.approx(
        [0.0, 0.0, 0.0], abs=1e-9
    )
    assert after.d_corner[:, STATIC, 0] * 0.4 == pytest.approx(more)
    _, prior = weak_priors(model, even)
    body_kg = granada()[0]
    assert prior[place] * 10.0 == pytest.approx(0.1 * body_kg / 4.0)
    assert "cross weight" not in model_of().names


def test_an_element_may_show_on_one_axle_alone() -> None:
    parts = BY_NAME["tyre_damping"].parts(("c_tf", "c_tr"))
    assert parts == (("c_tf", "c_tr"), ("c_tf",), ("c_tr",))
    knees = BY_NAME["damper_knees"].parts(("h_f1", "h_f3", "h_r1"))
    assert knees == (("h_f1", "h_f3", "h_r1"),)
    assert BY_NAME["cg_offset"].members(model_of()) == ("y_s",)


def test_what_cannot_be_negative_is_absent_below_zero() -> None:
    """Bars of a solid axle, a spring that softens and differences of sides may be negative."""
    assert {group.name for group in GROUPS if group.positive} == {
        "friction", "static_friction", "damper_mounts", "tyre_damping", "progressive_tyres",
        "bump_stops",
    }  # fmt: skip
