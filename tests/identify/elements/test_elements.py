"""Force elements: each law against its words, each derivative against differences."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from identify.elements.laws import (
    bar_force,
    friction_rate,
    friction_rate_by_length,
    friction_rate_by_limit,
    friction_rate_by_share,
    friction_rate_by_speed,
    hinge,
    hinge_slope,
    knee,
    knee_slope,
    mount_misfit,
    mount_slope,
    rounded_speed,
    secant_share,
    sliding_share,
    sliding_share_by_fall,
    sliding_share_by_speed,
    sliding_share_by_surplus,
    spring_force,
    spring_stiffness,
    stop_by_rate,
    stop_force,
    stop_stiffness,
    tyre_contact,
    tyre_force,
    tyre_grip,
    tyre_load,
    tyre_load_by_heave,
    tyre_push,
    tyre_push_by_load,
)
from identify.nonlinear.path import PATH

STEP = 1e-6


def slope(law: Callable[[float], float], at: float, step: float = STEP) -> float:
    return (law(at + step) - law(at - step)) / (2.0 * step)


def test_a_hinge_is_exact_beyond_its_rounding() -> None:
    assert hinge(-0.0021, 0.002) == 0.0
    assert hinge(0.0021, 0.002) == 0.0021
    assert hinge(0.0, 0.002) == pytest.approx(0.0005)


@pytest.mark.parametrize("x", [-0.0015, -0.0002, 0.0007, 0.0019])
def test_the_slope_of_a_hinge(x: float) -> None:
    assert hinge_slope(x, 0.002) == pytest.approx(slope(lambda y: hinge(y, 0.002), x, 1e-8))


def test_a_progressive_spring_is_stiffer_in_compression() -> None:
    assert spring_force(0.03, 20e3, 40e3, 0.0) == pytest.approx(636.0)
    assert spring_force(-0.03, 20e3, 40e3, 0.0) == pytest.approx(-564.0)
    assert spring_force(-0.03, 20e3, 0.0, 1e6) == pytest.approx(-627.0)


def test_the_stiffness_of_a_spring() -> None:
    for u in (-0.04, 0.0, 0.025):
        found = slope(lambda v: spring_force(v, 20e3, 40e3, 8e5), u)
        assert spring_stiffness(u, 20e3, 40e3, 8e5) == pytest.approx(found, rel=1e-7)


def test_a_stop_acts_beyond_its_gap_alone() -> None:
    assert stop_force(0.0249, 1e5, 0.025, 5e-5) == 0.0
    assert stop_force(0.030, 1e5, 0.025, 5e-5) == pytest.approx(500.0)
    assert stop_by_rate(0.030, 0.025, 5e-5) == pytest.approx(0.005)
    assert stop_stiffness(0.030, 1e5, 0.025, 5e-5) == 1e5


@pytest.mark.parametrize("u", [0.0, 0.0249, 0.02497, 0.02503, 0.030])
def test_the_stiffness_and_the_rate_of_a_stop(u: float) -> None:
    """Before the gap, in the rounding of 0.05 mm about it, and beyond."""
    found = slope(lambda v: stop_force(v, 2e5, 0.025, 5e-5), u, 1e-9)
    assert stop_stiffness(u, 2e5, 0.025, 5e-5) == pytest.approx(found, rel=1e-5, abs=1e-3)
    found = slope(lambda k: stop_force(u, k, 0.025, 5e-5), 2e5, 1.0)
    assert stop_by_rate(u, 0.025, 5e-5) == pytest.approx(found, rel=1e-7, abs=1e-12)


def test_a_bar_pushes_the_corner_that_is_compressed_more() -> None:
    assert bar_force(0.02, -0.01, 8e3) == pytest.approx(240.0)


def test_a_knee_bends_outwards_from_rest() -> None:
    assert knee(0.0, 0.15, 0.002) == 0.0
    assert knee(0.35, 0.15, 0.002) == pytest.approx(0.2)
    assert knee(0.35, -0.15, 0.002) == 0.0
    assert knee(-0.35, -0.15, 0.002) == pytest.approx(-0.2)


@pytest.mark.parametrize("knot", [-0.15, 0.0, 0.15])
@pytest.mark.parametrize("w", [-0.3, -0.1505, 0.0004, 0.1493, 0.4])
def test_the_slope_of_a_knee(knot: float, w: float) -> None:
    found = slope(lambda r: knee(r, knot, 0.002), w, 1e-8)
    assert knee_slope(w, knot, 0.002) == pytest.approx(found, abs=1e-6)


def test_a_knee_at_rest_raises_the_secant_by_half() -> None:
    assert secant_share(0.0, 0.002) == pytest.approx(0.5, abs=1e-3)
    assert secant_share(0.15, 0.002) == 0.0
    assert secant_share(-0.08, 0.002) == pytest.approx(0.1, abs=1e-3)


def test_friction_sticks_then_slides() -> None:
    zeta, step = 0.0, 1e-6
    for _ in range(20000):  # 2 mm at 0.1 m/s, four pre-sliding lengths
        zeta += step * friction_rate(0.1, zeta, 0.5e-3, 1.0, 0.0, 0.0)
    assert zeta == pytest.approx(1.0 - np.exp(-4.0), abs=1e-4)
    assert friction_rate(0.0, 0.7, 0.5e-3, 1.0, 0.0002, 0.0) == pytest.approx(-0.28)


def test_static_friction_falls_off_with_the_speed() -> None:
    assert sliding_share(0.0, 0.4, 0.01) == 1.4
    assert sliding_share(-0.01, 0.4, 0.01) == pytest.approx(1.0 + 0.4 / math.e)
    assert sliding_share(0.1, 0.4, 0.01) == 1.0
    # It slides steadily where the share is that of its speed.
    assert friction_rate(0.01, 1.0 + 0.4 / math.e, 0.5e-3, 1.0 + 0.4 / math.e, 0.0, 0.0) == 0.0


@pytest.mark.parametrize(("w", "zeta"), [(0.2, 0.3), (-0.05, 0.8), (0.0003, -0.5), (0.007, 1.2)])
def test_the_derivatives_of_friction(w: float, zeta: float) -> None:
    rest = (0.0005, 1e-4)

    def rate(speed: float, share: float, length: float, surplus: float, fall: float) -> float:
        limit = sliding_share(speed, surplus, fall)
        return float(friction_rate(speed, share, length, limit, *rest))

    length, surplus, fall = 0.5e-3, 0.4, 0.01
    limit = sliding_share(w, surplus, fall)
    by_limit = friction_rate_by_limit(w, zeta, length, limit, *rest)
    found = friction_rate_by_speed(w, zeta, length, limit, *rest)
    found += by_limit * sliding_share_by_speed(w, surplus, fall)
    by_speed = slope(lambda v: rate(v, zeta, length, surplus, fall), w, 1e-8)
    assert found == pytest.approx(by_speed, rel=1e-5)
    by_share = slope(lambda z: rate(w, z, length, surplus, fall), zeta)
    assert friction_rate_by_share(w, length, limit, *rest) == pytest.approx(by_share, rel=1e-7)
    by_length = slope(lambda d: rate(w, zeta, d, surplus, fall), length, 1e-9)
    found = friction_rate_by_length(w, zeta, length, limit, *rest)
    assert found == pytest.approx(by_length, rel=1e-5)
    by_surplus = slope(lambda r: rate(w, zeta, length, r, fall), surplus)
    found = by_limit * sliding_share_by_surplus(w, fall)
    assert found == pytest.approx(by_surplus, rel=1e-6, abs=1e-6)
    by_fall = slope(lambda v: rate(w, zeta, length, surplus, v), fall, 1e-8)
    found = by_limit * sliding_share_by_fall(w, surplus, fall)
    assert found == pytest.approx(by_fall, rel=1e-5, abs=1e-6)


def test_a_tyre_pushes_and_never_pulls() -> None:
    load = tyre_load(-0.01, 200e3, 2.0, 3500.0)
    assert load == pytest.approx(3500.0 + 2000.0 * 1.02)
    assert tyre_force(load, 3500.0, 20.0) == pytest.approx(2040.0)
    gone = tyre_load(0.03, 200e3, 0.0, 3500.0)
    assert tyre_force(gone, 3500.0, 20.0) == -3500.0
    assert tyre_contact(gone, 20.0) == 0.0
    assert tyre_contact(load, 20.0) == 1.0
    found = slope(lambda z: tyre_load(z, 200e3, 2.0, 3500.0), -0.01)
    assert tyre_load_by_heave(-0.01, 200e3, 2.0) == pytest.approx(found, rel=1e-7)


@pytest.mark.parametrize("load", [-30.0, -11.0, 7.0, 30.0])
def test_slopes_of_a_tyre_that_meets_the_road(load: float) -> None:
    found = slope(lambda x: tyre_push(x, -1.5, 100.0, 20.0), load, 1e-3)
    assert tyre_push_by_load(load, -1.5, 100.0, 20.0) == pytest.approx(found, rel=1e-7)
    found = slope(lambda v: tyre_push(load, v, 100.0, 20.0), -1.5)
    assert -100.0 * tyre_grip(load, 20.0) == pytest.approx(found, rel=1e-7, abs=1e-7)


def test_a_tyre_is_damped_on_the_road_and_not_in_the_air() -> None:
    coming_down, going_up = -2.0, 2.0
    assert tyre_push(500.0, coming_down, 100.0, 20.0) == 700.0
    assert tyre_push(-21.0, coming_down, 100.0, 20.0) == -21.0
    assert tyre_force(tyre_push(-21.0, coming_down, 100.0, 20.0), 900.0, 20.0) == -900.0
    assert tyre_force(tyre_push(150.0, going_up, 100.0, 20.0), 900.0, 20.0) == -900.0


def test_a_rigid_mount_gives_the_speed_of_the_suspension() -> None:
    assert mount_misfit(0.3, 450.0, 0.0, 0.3, 0.0, 1.2e-4) == 0.0
    assert mount_slope(1500.0, 1e-6, 1.2e-4) == pytest.approx(1.62e-3)


def test_on_a_mount_the_force_of_the_damper_bends_it_and_the_rubber_follows() -> None:
    """450 N on 1e-6 m/N: 0.45 mm; 0.2 m/s more in the damper than outside: 0.024 mm of loss."""
    found = mount_misfit(0.5, 450.0, 0.1e-3, 0.3, 1e-6, 1.2e-4)
    assert found == pytest.approx(0.45e-3 + 0.024e-3 - 0.1e-3)
    by_speed = slope(lambda r: mount_misfit(r, 1500.0 * r, 0.1e-3, 0.3, 1e-6, 1.2e-4), 0.5)
    assert mount_slope(1500.0, 1e-6, 1.2e-4) == pytest.approx(by_speed, rel=1e-7)


def test_a_corner_that_sticks_keeps_its_friction_for_as_long_as_a_decay_lasts() -> None:
    """At rest 0.9 of the friction over 0.5 mm acts for 3 s: dry friction does not creep."""
    left = 0.9 + 3.0 * friction_rate(0.0, 0.9, 0.5e-3, 1.0, PATH.turn_m_s, PATH.lag_s)
    assert 0.84 < left <= 0.9  # a rounding of 0.2 mm/s would leave nothing


def test_the_rate_of_friction_by_hand() -> None:
    """0.3 m/s rounded over 0.4 is 0.5 m/s; half of the limit acts; the lag doubles the length."""
    assert rounded_speed(0.3, 0.4) == pytest.approx(0.5)
    assert friction_rate(0.3, 0.6, 0.5e-3, 1.2, 0.4, 1e-3) == pytest.approx(0.05 / 1e-3)
