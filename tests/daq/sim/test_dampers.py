"""Damper curves against their definitions, and mounts between their limits."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import Excitation
from daq.sim.dampers import (
    Branch,
    DamperCurve,
    Digressive,
    Straight,
    Table,
    damper_law,
    secant_ns_m,
)
from daq.sim.excitation import Bump
from daq.sim.imperfections import Friction, Imperfections, PerAxle
from daq.sim.load import load_car
from daq.sim.motion import drive, drive_all
from daq.vehicle import FORD_GRANADA, AddedMass

SOFT = Digressive(Branch(1500.0, 300.0, 0.08), Branch(2600.0, 1400.0, 0.1))
HARD = Table(((0.15, 225.0), (0.40, 450.0)), ((0.05, 150.0), (0.15, 390.0), (0.25, 540.0)))
SIDED = Straight(1000.0, 2000.0)
SPEEDS = np.array([[-0.5, -0.2, -0.1, -0.01, 0.01, 0.1, 0.3, 0.6]])
BUMP = Bump(Excitation.WARP, 0.05, 0.1, 0.2)
T_S = np.linspace(0.301, 0.89, 500)


def test_a_digressive_damper_has_its_slopes_and_knees() -> None:
    law = damper_law([SOFT], [1.0])
    expected = [
        1400.0 * v + 120.0 * np.tanh(v / 0.1) if v < 0 else 300.0 * v + 96.0 * np.tanh(v / 0.08)
        for v in SPEEDS[0]
    ]
    np.testing.assert_allclose(law.force(SPEEDS)[0], expected)
    assert law.slope(np.array([[1e-9, -1e-9]]))[0] == pytest.approx([1500.0, 2600.0])
    assert law.slope(np.array([[3.0, -3.0]]))[0] == pytest.approx([300.0, 1400.0])


def test_a_table_is_read_between_and_beyond_its_points() -> None:
    speeds = np.array([[0.075, 0.15, 0.275, 0.5, -0.025, -0.1, -0.25, -0.35]])
    forces = [112.5, 225.0, 337.5, 540.0, -75.0, -270.0, -540.0, -690.0]
    np.testing.assert_allclose(damper_law([HARD], [1.0]).force(speeds)[0], forces)


@pytest.mark.parametrize("curve", [SOFT, HARD, SIDED])
def test_the_slope_is_the_derivative_of_the_force(curve: DamperCurve) -> None:
    law = damper_law([curve, curve], [1.0, 0.5])
    rise = law.force(SPEEDS + 1e-7) - law.force(SPEEDS - 1e-7)
    np.testing.assert_allclose(law.slope(SPEEDS * np.ones((2, 1))), rise / 2e-7, rtol=1e-5)
    np.testing.assert_allclose(law.force(SPEEDS)[1], 0.5 * law.force(SPEEDS)[0])


def test_different_dampers_stand_beside_each_other() -> None:
    law = damper_law([SOFT, HARD, SIDED], [1.0, 1.0, 2.0])
    curves: tuple[DamperCurve, ...] = (SOFT, HARD, SIDED)
    for row, (curve, factor) in enumerate(zip(curves, (1.0, 1.0, 2.0), strict=True)):
        alone = damper_law([curve], [factor]).force(SPEEDS)[0]
        np.testing.assert_allclose(law.force(SPEEDS)[row], alone)


def test_the_secant_is_the_mean_slope_within_a_tenth() -> None:
    assert secant_ns_m(SIDED) == pytest.approx(1500.0)
    # 150 N at 0.1 m/s in compression, 270 N in rebound.
    assert secant_ns_m(HARD) == pytest.approx(2100.0)


BARE = Imperfections(friction=Friction(40.0, 40.0), damper_front=SOFT, damper_rear=HARD)


def accelerations(*mounts: PerAxle) -> list[NDArray[np.float64]]:
    """Return the accelerations of cars that differ in their mounts, each (7, n)."""
    plants = [load_car(FORD_GRANADA, AddedMass(), replace(BARE, mount_n_m=k)) for k in mounts]
    motions = drive_all(plants, [BUMP] * len(plants), 0.9)
    return [motion.at(T_S).acceleration for motion in motions]


def test_a_stiff_mount_is_no_mount() -> None:
    (bare,) = accelerations((inf, inf))
    soft, stiff, stiffer = accelerations((1e6, 1e6), (1e7, 1e7), (1e8, 1e8))
    assert np.abs(soft - bare).max() > 0.5  # a mount of a real car is seen
    assert np.abs(stiff - bare).max() < 0.2 * np.abs(soft - bare).max()
    assert np.abs(stiffer - bare).max() < 0.05


def test_a_soft_mount_takes_the_damper_away() -> None:
    """Fast enough, a damper moves with its wheel, and the mount is a spring between."""
    soft = replace(FORD_GRANADA, c_sf=1e7, c_sr=1e7)
    mounted = load_car(soft, AddedMass(), Imperfections(mount_n_m=(5e3, 7e3)))
    springs = replace(
        FORD_GRANADA, k_sf=FORD_GRANADA.k_sf + 5e3, k_sr=FORD_GRANADA.k_sr + 7e3, c_sf=0.0, c_sr=0.0
    )
    found = drive(mounted, BUMP, 0.9).at(T_S).acceleration
    expected = drive(load_car(springs, AddedMass()), BUMP, 0.9).at(T_S).acceleration
    np.testing.assert_allclose(found, expected, atol=0.1)


def test_one_axle_may_have_mounts_alone() -> None:
    (bare,) = accelerations((inf, inf))
    front, both = accelerations((5e5, inf), (5e5, 1e8))
    assert np.abs(front - both).max() < 0.05
    assert np.abs(front - bare).max() > 0.5
