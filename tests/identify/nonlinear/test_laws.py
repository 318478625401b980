"""Force elements: each law against its words, each derivative against differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from identify.nonlinear.laws import (
    friction_rate,
    friction_slopes,
    hinge,
    hinge_slope,
    knee,
    knee_slope,
    mount_misfit,
    mount_slope,
    secant_share,
    sliding_share,
    sliding_slopes,
    spring_force,
    spring_stiffness,
    stop_force,
    stop_slopes,
    tyre_force,
    tyre_load,
    tyre_push,
    tyre_slopes,
)
from identify.nonlinear.path import PATH

Law = Callable[..., Any]


def _road_force(load: float, damping_n: float) -> float:
    """Return the force of the road on a tyre; `damping_n` is minus c_t v."""
    return float(tyre_force(tyre_push(load, -damping_n / 100.0, 100.0, 20.0), 0.0, 20.0))


DERIVATIVES: dict[str, tuple[Law, Law, Sequence[int], Sequence[tuple[float, ...]]]] = {
    "hinge": (
        lambda x: hinge(x, 0.002),
        lambda x: hinge_slope(x, 0.002),
        (0,),
        [(-0.0015,), (-0.0002,), (0.0007,), (0.0019,), (0.004,)],
    ),
    "knee": (
        lambda w, knot: knee(w, knot, 0.002),
        lambda w, knot: knee_slope(w, knot, 0.002),
        (0,),
        [(w, k) for k in (-0.15, 0.0, 0.15) for w in (-0.3, -0.1505, 0.0004, 0.1493, 0.4)],
    ),
    "spring": (
        lambda u: spring_force(u, 20e3, 40e3, 8e5),
        lambda u: spring_stiffness(u, 20e3, 40e3, 8e5),
        (0,),
        [(-0.04,), (0.0,), (0.025,)],
    ),
    "stop": (  # before the gap, in the rounding of 0.05 mm about it, and beyond
        lambda u, k_b, power: stop_force(u, k_b, 0.025, power, 5e-5),
        lambda u, k_b, power: stop_slopes(u, k_b, 0.025, power, 5e-5),
        (0, 1, 2),
        [
            (u, 2e5, power)
            for u in (0.0, 0.0249, 0.02497, 0.02503, 0.030, 0.040)
            for power in (1.2, 2.0, 3.0)
        ],
    ),
    "sliding": (
        sliding_share,
        sliding_slopes,
        (0, 1, 2),
        [(w, 0.4, 0.01) for w in (0.2, -0.05, 0.0003, 0.007)],
    ),
    "friction": (
        lambda w, zeta, length, limit: friction_rate(w, zeta, length, limit, 0.0005, 1e-4),
        lambda w, zeta, length, limit: friction_slopes(w, zeta, length, limit, 0.0005, 1e-4),
        (0, 1, 2, 3),
        [(w, z, 0.5e-3, 1.3) for w, z in ((0.2, 0.3), (-0.05, 0.8), (0.0003, -0.5), (0.007, 1.2))],
    ),
    "mount": (
        lambda r: mount_misfit(r, 1500.0 * r, 0.1e-3, 0.3, 1e-6, 1.2e-4),
        lambda _: mount_slope(1500.0, 1e-6, 1.2e-4),
        (0,),
        [(0.5,)],
    ),
    "tyre": (
        _road_force,
        lambda load, damping_n: tyre_slopes(load, -damping_n / 100.0, 100.0, 20.0),
        (0, 1),
        [(-30.0, 150.0), (7.0, 150.0), (30.0, -20.0), (500.0, 150.0)],
    ),
}
"""A law, its derivatives, by which of its arguments, and where."""


@pytest.mark.parametrize("name", DERIVATIVES)
def test_derivatives_are_those_of_the_law(name: str) -> None:
    law, slopes, arguments, points = DERIVATIVES[name]
    for point in points:
        for k, slope in zip(arguments, np.atleast_1d(slopes(*point)), strict=True):
            step = 1e-6 * max(abs(point[k]), 1e-3)
            ends = [[*point[:k], point[k] + d, *point[k + 1 :]] for d in (step, -step)]
            difference = (law(*ends[0]) - law(*ends[1])) / (2.0 * step)
            assert slope == pytest.approx(difference, rel=1e-5, abs=1e-6), (point, k)


def test_a_hinge_is_exact_beyond_its_rounding() -> None:
    assert hinge(-0.0021, 0.002) == 0.0
    assert hinge(0.0021, 0.002) == 0.0021
    assert hinge(0.0, 0.002) == pytest.approx(0.0005)


def test_a_progressive_spring_is_stiffer_in_compression() -> None:
    assert spring_force(0.03, 20e3, 40e3, 0.0) == pytest.approx(636.0)
    assert spring_force(-0.03, 20e3, 40e3, 0.0) == pytest.approx(-564.0)
    assert spring_force(-0.03, 20e3, 0.0, 1e6) == pytest.approx(-627.0)


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


def test_friction_sticks_then_slides() -> None:
    zeta, step = 0.0, 1e-6
    for _ in range(20000):  # 2 mm at 0.1 m/s, four pre-sliding lengths
        zeta += step * friction_rate(0.1, zeta, 0.5e-3, 1.0, 0.0, 0.0)
    assert zeta == pytest.approx(1.0 - np.exp(-4.0), abs=1e-4)
    assert friction_rate(0.0, 0.7, 0.5e-3, 1.0, 0.0002, 0.0) == pytest.approx(-0.28)
    # 0.3 m/s rounded over 0.4 is 0.5 m/s; half of the limit acts; the lag doubles the length.
    assert friction_rate(0.3, 0.6, 0.5e-3, 1.2, 0.4, 1e-3) == pytest.approx(0.05 / 1e-3)


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
