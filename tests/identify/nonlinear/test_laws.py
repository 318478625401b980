"""Laws of the force elements, with their derivatives, and the forces that a result reports."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import ELEMENTS, Fact
from identify.fit.grey_box import GreyBox
from identify.fit.uncertainty import Estimate
from identify.nonlinear.begin import weak_priors
from identify.nonlinear.car import K_S, K_T, KNOTS, MASS, STATIC, Car, Model, X, Y, car
from identify.nonlinear.forces import (
    AxleForces,
    DamperCurve,
    Forces,
    axle_forces,
    element_estimates,
    force_quantities,
    forces_at_speeds,
)
from identify.nonlinear.laws import (
    friction_rate,
    hinge,
    knee,
    mount_misfit,
    secant_share,
    sliding_share,
    stop_force,
    tyre_force,
    tyre_load,
    tyre_push,
)
from identify.nonlinear.path import PATH
from identify.nonlinear.release import GROUPS, STAGES

from .truth import BASELINE, RICH, bent, granada, model_of


def test_a_hinge_is_exact_beyond_its_rounding() -> None:
    assert hinge(-0.0021, 0.002) == 0.0
    assert hinge(0.0021, 0.002) == 0.0021
    assert hinge(0.0, 0.002) == pytest.approx(0.0005)


def test_a_stop_acts_beyond_its_gap_alone() -> None:
    """Its force is the stated one at 10 mm for every power, and falls from there by the power."""
    for power, at_5_mm in ((1.0, 500.0), (2.0, 250.0), (3.0, 125.0)):
        assert stop_force(0.0249, 1e5, 0.025, power, 5e-5) == 0.0
        assert stop_force(0.035, 1e5, 0.025, power, 5e-5) == pytest.approx(1000.0)
        assert stop_force(0.030, 1e5, 0.025, power, 5e-5) == pytest.approx(at_5_mm)


def test_a_knee_bends_outwards_from_rest() -> None:
    assert knee(0.0, 0.15, 0.002) == 0.0
    assert knee(0.35, 0.15, 0.002) == pytest.approx(0.2)
    assert knee(0.35, -0.15, 0.002) == 0.0
    assert knee(-0.35, -0.15, 0.002) == pytest.approx(-0.2)


def test_a_knee_at_rest_raises_the_secant_by_half() -> None:
    assert secant_share(0.0, 0.002) == pytest.approx(0.5, abs=1e-3)
    assert secant_share(0.15, 0.002) == 0.0
    assert secant_share(-0.08, 0.002) == pytest.approx(0.1, abs=1e-3)


def test_a_corner_that_sticks_keeps_its_friction_for_as_long_as_a_decay_lasts() -> None:
    """At rest 0.9 of the friction over 0.5 mm acts for 3 s: dry friction does not creep."""
    after = 0.9 + 3.0 * friction_rate(0.0, 0.9, 0.5e-3, 1.0, PATH.turn_m_s, PATH.lag_s)
    assert 0.84 < after <= 0.9  # a rounding of 0.2 mm/s would leave nothing


def test_static_friction_falls_off_with_the_speed() -> None:
    assert sliding_share(0.0, 0.4, 0.01) == 1.4
    assert sliding_share(-0.01, 0.4, 0.01) == pytest.approx(1.0 + 0.4 / math.e)
    assert sliding_share(0.1, 0.4, 0.01) == 1.0
    # It slides steadily where the share is that of its speed.
    assert friction_rate(0.01, 1.0 + 0.4 / math.e, 0.5e-3, 1.0 + 0.4 / math.e, 0.0, 0.0) == 0.0


def test_a_tyre_pushes_and_never_pulls() -> None:
    load = tyre_load(-0.01, 200e3, 2.0, 3500.0)
    assert load == pytest.approx(3500.0 + 2000.0 * 1.02)
    assert tyre_force(load, 3500.0, 20.0) == pytest.approx(2040.0)
    assert tyre_force(tyre_load(0.03, 200e3, 0.0, 3500.0), 3500.0, 20.0) == -3500.0


def test_a_tyre_is_damped_on_the_road_and_not_in_the_air() -> None:
    coming_down, going_up = -2.0, 2.0
    assert tyre_push(500.0, coming_down, 100.0, 20.0) == 700.0
    assert tyre_push(-21.0, coming_down, 100.0, 20.0) == -21.0
    assert tyre_force(tyre_push(-21.0, coming_down, 100.0, 20.0), 900.0, 20.0) == -900.0
    assert tyre_force(tyre_push(150.0, going_up, 100.0, 20.0), 900.0, 20.0) == -900.0


def test_on_a_mount_the_force_of_the_damper_bends_it_and_the_rubber_follows() -> None:
    """450 N on 1e-6 m/N: 0.45 mm; 0.2 m/s more in the damper than outside: 0.024 mm of loss."""
    misfit_m = mount_misfit(0.5, 450.0, 0.1e-3, 0.3, 1e-6, 1.2e-4)
    assert misfit_m == pytest.approx(0.45e-3 + 0.024e-3 - 0.1e-3)
    assert mount_misfit(0.3, 450.0, 0.0, 0.3, 0.0, 1.2e-4) == 0.0  # rigid: the suspension's speed


# Damper curves, friction, stops and mounts that a fit reports, against  ---------------------------


MODEL = model_of(knots="K1")


def places(*names: str, model: Model = MODEL) -> NDArray[np.intp]:
    return np.array([model.names.index(name) for name in names], dtype=np.intp)


def optimum(eta: NDArray[np.float64], free: NDArray[np.intp]) -> Any:
    problem = SimpleNamespace(model=MODEL, free=free)
    return SimpleNamespace(eta=eta, point=SimpleNamespace(problem=problem))


@pytest.mark.parametrize(
    ("name", "unknown", "std", "value", "half", "unit", "size"),
    [
        ("F_cf", 1.2, 0.1, 60.0, 1.96 * 5.0, "N", 50.0),  # in units of 50 N
        ("F_cr", -0.2, 0.1, -10.0, 1.96 * 5.0, "N", 50.0),
        ("k_2r", 0.3, 0.05, 3e4, 1.96 * 5e3, "N/m2", 1e5),
        ("g_bf", float(np.log(0.02)), 0.1, 0.02, 1.96 * 2e-3, "m", 0.0),  # a logarithm
        ("s_mf", 0.5, 0.2, 0.5e-6, 1.96 * 0.2e-6, "m/N", 1e-6),
        ("k_sf", float(np.log(17e3)), 0.01, 17e3, 1.96 * 170.0, "N/m", 0.0),
        ("c_sr", float(np.log(1500.0)), 0.01, 1500.0, 1.96 * 15.0, "N s/m", 0.0),
        ("m_s", float(np.log(1380.0)), 0.01, 1380.0, 1.96 * 13.8, "kg", 0.0),
    ],
)
def test_an_unknown_is_reported_in_its_unit_with_its_interval(
    name: str, unknown: float, std: float, value: float, half: float, unit: str, size: float
) -> None:
    eta = bent(MODEL, **{name: unknown})
    ((found_name, found),) = element_estimates(
        optimum(eta, places(name)), np.array([[std**2]])
    ).items()
    assert found_name == name
    assert found.value == pytest.approx(value, rel=1e-9)
    assert found.std == pytest.approx(half / 1.96, rel=1e-9)
    assert found.low == pytest.approx(value - half, abs=1e-4 * half)
    assert found.high == pytest.approx(value + half, abs=1e-4 * half)
    assert (found.unit, found.size) == (unit, size)


def test_the_cross_weight_is_no_element() -> None:
    model = Model(GreyBox((), (BASELINE,), None, RICH, may_lift=True), (0.0,))
    eta = bent(model, F_cf=2.0)
    free = places("k_tr", "cross weight", "F_cf", model=model)
    problem = SimpleNamespace(model=model, free=free)
    best: Any = SimpleNamespace(eta=eta, point=SimpleNamespace(problem=problem))
    found = element_estimates(best, np.diag([1e-4, 1.0, 4e-2]))
    assert list(found) == ["k_tr", "F_cf"]
    assert found["F_cf"].std == pytest.approx(10.0)


def states(travel_m: float, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return states in which only the wheels move: the front left and the rear right one."""
    result = np.zeros((len(speeds), 22))
    result[:, 10], result[:, 13] = speeds, -speeds
    result[-1, 3] = travel_m
    return result


def forces(
    one: Car,
    values: dict[str, Estimate],
    covariance: NDArray[np.float64],
    speeds: NDArray[np.float64],
    travel_m: float = 0.0,
    of_dampers: NDArray[np.float64] | None = None,
) -> tuple[AxleForces, AxleForces]:
    path = SimpleNamespace(states=states(travel_m, speeds), speeds=of_dampers)
    point = SimpleNamespace(cars=(one,), predicted=(SimpleNamespace(path=path),))
    best: Any = SimpleNamespace(point=point)
    front, rear = (axle_forces(best, covariance, values, axle) for axle in ("front", "rear"))
    return front, rear


SPEEDS = np.concatenate([np.zeros(2), np.linspace(-0.4, 0.6, 101)])


def test_the_curve_of_a_bent_damper_with_friction() -> None:
    """1500 N s/m as the secant between +-0.1 m/s, and 400 N s/m more in compression than rebound.

    Friction of 60 N with a surplus of half that falls off over 0.2 m/s.  The unknowns are the
    coefficient (a logarithm), the knee (1000 N s/m) and the friction (50 N).
    """
    eta = bent(MODEL, h_f1=0.4, F_cf=1.2, r_cf=0.5, v_cf=float(np.log(0.2)))
    one = car(MODEL, eta, BASELINE, places("c_sf", "h_f1", "F_cf", "r_cf", "v_cf"))
    stds = np.array([0.02, 0.05, 0.1, 0.0, 0.0])
    front, rear = forces(one, {}, np.diag(stds**2), SPEEDS)
    assert (front.axle, rear.axle, front.values, front.notes) == ("front", "rear", {}, ())
    curve = front.damper
    v = curve.speed_m_s
    away = np.abs(v) > 0.02  # the knee at rest is rounded over 2 mm/s
    slope = np.where(v > 0.0, 1700.0, 1300.0)
    expected = slope * v + 0.2  # half the width of the knee times 400 N s/m, at most
    assert curve.force_n[away] == pytest.approx(expected[away], abs=0.6)
    by_c, by_h = 1500.0 * v, 1000.0 * (np.where(v > 0.0, v, 0.0) - 0.5 * v)
    std = np.hypot(0.02 * by_c, 0.05 * by_h)
    assert curve.std_n[away] == pytest.approx(std[away], abs=0.1)
    sliding = 1.0 + 0.5 * np.exp(-((v / 0.2) ** 2))
    assert curve.total_n - curve.force_n == pytest.approx(60.0 * np.sign(v) * sliding)
    total = np.hypot(std, 0.1 * 50.0 * sliding)
    assert curve.total_std_n[away] == pytest.approx(total[away], abs=0.1)
    low, high = curve.band_n
    assert high - low == pytest.approx(2.0 * 1.96 * curve.std_n, rel=1e-4)
    assert low + high == pytest.approx(2.0 * curve.force_n)


@pytest.mark.parametrize(("name", "unknown"), [("r_cf", 0.5), ("v_cf", np.log(0.2))])
def test_the_deviation_of_the_total_is_that_of_its_change(name: str, unknown: float) -> None:
    """By differences: the friction's surplus and the speed over which it falls off."""
    at = {"F_cf": 1.2, "r_cf": 0.5, "v_cf": float(np.log(0.2)), name: float(unknown)}
    free = places(name)
    total = []
    for step in (-1e-5, 0.0, 1e-5):
        one = car(MODEL, bent(MODEL, **(at | {name: unknown + step})), BASELINE, free)
        total.append(forces(one, {}, np.array([[0.3**2]]), SPEEDS)[0].damper)
    expected = 0.3 * np.abs(total[2].total_n - total[0].total_n) / 2e-5
    assert total[1].total_std_n == pytest.approx(expected, rel=1e-4, abs=1e-6)
    assert total[1].std_n == pytest.approx(0.0, abs=1e-9)


def test_a_curve_ends_where_the_damper_spent_a_hundredth_of_its_time() -> None:
    """Of the speeds of an axle, half of them zero, that is a fiftieth of the wheel that moves."""
    one = car(MODEL, bent(MODEL), BASELINE, places("c_sf"))
    front, rear = forces(one, {}, np.eye(1), np.linspace(-0.5, 0.6, 2001))
    assert front.damper.speed_m_s[[0, -1]] == pytest.approx([-0.478, 0.578], abs=1e-3)
    assert rear.damper.speed_m_s[[0, -1]] == pytest.approx([-0.578, 0.478], abs=1e-3)
    assert len(front.damper.speed_m_s) == 62  # evenly, and rest
    fast = forces(one, {}, np.eye(1), np.linspace(0.2, 0.5, 301))[0].damper.speed_m_s
    assert (fast[0], 0.0 in fast, len(fast)) == (0.0, True, 61)
    slow = forces(one, {}, np.eye(1), -np.linspace(0.2, 0.5, 301))[0].damper.speed_m_s
    assert (slow[-1], len(slow)) == (0.0, 61)


STOP = {
    "k_bf": Estimate(1e5, 1e4, 8e4, 1.2e5, "N/m"),
    "g_bf": Estimate(0.015, 1e-3, 0.013, 0.017, "m"),
    "p_bf": Estimate(2.0, 0.1, 1.8, 2.2, "1"),
    "F_cr": Estimate(40.0, 2.0, 36.0, 44.0, "N"),
}


@pytest.mark.parametrize(
    ("travel_m", "shown", "notes"),
    [(0.0149, [], 1), (0.0151, ["bump_stop", "bump_stop_gap", "bump_stop_power"], 0)],
)
def test_a_stop_is_reported_where_the_travel_reached_it(
    travel_m: float, shown: list[str], notes: int
) -> None:
    one = car(MODEL, bent(MODEL, k_bf=1.0, g_bf=float(np.log(0.015))), BASELINE, places("k_bf"))
    front, rear = forces(one, STOP, np.eye(1), SPEEDS, travel_m)
    assert list(front.values) == shown
    assert len(front.notes) == notes
    assert all("15 mm" in note for note in front.notes)
    assert rear.values == {"friction": STOP["F_cr"]}


def mount(value: float, std: float) -> Estimate:
    return Estimate(value, std, value - 1.96 * std, value + 1.96 * std, "m/N", 1e-6)


@pytest.mark.parametrize(
    ("value", "std", "rigid"), [(1.9e-7, 1e-7, True), (2.1e-7, 1e-7, False), (0.0, 1e-7, True)]
)
def test_a_mount_is_rigid_below_two_standard_deviations(
    value: float, std: float, rigid: bool
) -> None:
    one = car(MODEL, bent(MODEL), BASELINE, places("c_sf"))
    front, rear = forces(one, {"s_mr": mount(value, std)}, np.eye(1), SPEEDS)
    assert (front.values, front.notes) == ({}, ())
    assert ("mount" in rear.values) is not rigid
    assert any("rigid" in note for note in rear.notes) is rigid


def test_the_stiffness_of_a_mount_has_the_interval_of_its_compliance_turned_over() -> None:
    one = car(MODEL, bent(MODEL), BASELINE, places("c_sf"))
    front, _ = forces(one, {"s_mf": mount(1e-6, 1e-7)}, np.eye(1), SPEEDS)
    found = front.values["mount"]
    assert [found.value, found.std] == pytest.approx([1e6, 1e5])
    assert [found.low, found.high] == pytest.approx([1e6 / 1.196, 1e6 / 0.804])
    assert found.unit == "N/m"
    assert front.notes == ()


# The elements that a bench may force or forbid are those that the fit knows -----------------------


def test_vehicle_and_fit_know_the_same_elements() -> None:
    names = {group.name for group in GROUPS}
    assert names == set(ELEMENTS)
    released = {name for stage in STAGES for name in stage}
    assert released | {"damper_mounts", "static_friction"} == names


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
    model = Model(GreyBox((), (BASELINE,), None, RICH, may_lift=True), KNOTS["K3"])
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


# Steps and roundings of each stage of a fit, and forces at the speeds of tables -------------------


def curve(low: float, high: float) -> DamperCurve:
    speed = np.linspace(low, high, round((high - low) / 0.01) + 1)
    return DamperCurve(
        speed, 1000.0 * speed, np.full(len(speed), 5.0), 1100.0 * speed, np.full(len(speed), 8.0)
    )


def test_tables_of_dampers_have_four_speeds_each_way() -> None:
    found = forces_at_speeds(curve(-0.45, 0.45))
    assert [one.speed_m_s for one in found] == [-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.4]
    ends = forces_at_speeds(curve(-0.4, 0.2))
    assert [one.speed_m_s for one in ends] == pytest.approx(
        [-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2]
    )
    slow = ends[1]
    assert [slow.damper.value, slow.damper.std] == pytest.approx([-200.0, 5.0])
    assert [slow.total.value, slow.total.std] == pytest.approx([-220.0, 8.0])
    assert slow.damper.high - slow.damper.low == pytest.approx(2 * 1.96 * 5.0, rel=1e-4)
    assert slow.damper.low + slow.damper.high == pytest.approx(-400.0)
    assert (slow.damper.unit, slow.damper.determined) == ("N", True)


def test_every_force_has_a_name_of_axle_and_element() -> None:
    friction = Estimate(50.0, 2.0, 46.0, 54.0, "N")
    front = AxleForces("front", curve(-0.07, 0.12), {"pre_sliding_length": friction}, ())
    rear = AxleForces("rear", curve(-0.01, 0.06), {"friction": friction}, ())
    found = force_quantities(Forces((front, rear), ()))
    assert list(found) == [
        "front pre sliding length",
        "front damper -0.05 m/s", "front corner -0.05 m/s",
        "front damper +0.05 m/s", "front corner +0.05 m/s",
        "front damper +0.10 m/s", "front corner +0.10 m/s",
        "rear friction",
        "rear damper +0.05 m/s", "rear corner +0.05 m/s",
    ]  # fmt: skip
    assert found["rear friction"] is friction
    assert found["front damper +0.10 m/s"].value == pytest.approx(100.0)
    assert found["front corner +0.10 m/s"].value == pytest.approx(110.0)


@pytest.mark.parametrize(("std_n", "determined"), [(12.0, True), (60.0, False)])
def test_a_force_is_determined_beside_fifty_newtons_where_it_is_small(
    std_n: float, determined: bool
) -> None:
    """A damper may have nearly none at a low speed: 5 N at 5 cm/s."""
    speed = np.linspace(-0.1, 0.1, 21)
    small = DamperCurve(speed, 100.0 * speed, np.full(21, std_n), 100.0 * speed, np.full(21, std_n))
    (found,) = (one.damper for one in forces_at_speeds(small) if one.speed_m_s == 0.05)
    assert found.size == 50.0
    assert found.determined is determined
