"""Dry friction against closed forms: Dahl's hysteresis, Stribeck's limits, a car that sticks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from daq.runs import Excitation
from daq.sim.balance import static_pose
from daq.sim.excitation import Bump
from daq.sim.friction import FrictionLaw
from daq.sim.imperfections import Friction, Imperfections
from daq.sim.load import load_car
from daq.sim.motion import drive, standing
from daq.sim.plant import corner_motion
from daq.vehicle import FORD_GRANADA, AddedMass

P = FORD_GRANADA
FORCE_N, LENGTH_M = 50.0, 0.5e-3


def law(ratio: float = 1.0, stribeck_m_s: float = 0.01) -> FrictionLaw:
    """Return the friction of one corner."""
    one = np.ones((1, 1))
    surplus = None if ratio == 1.0 else (ratio - 1.0) * one
    return FrictionLaw(FORCE_N * one, LENGTH_M * one, surplus, stribeck_m_s * one)


def dragged(friction: FrictionLaw, speed_m_s: float, time_s: float, share: float = 0.0) -> float:
    """Return the share after dragging a corner at a constant speed."""
    state = np.array([[share]])
    for _ in range(1000):
        state = friction.slid(state, np.array([[speed_m_s]]), time_s / 1000)
    return float(state[0, 0])


def test_dahl_follows_its_hysteresis_at_any_speed() -> None:
    """From -1 the force climbs by 2 (1 - exp(-x / d)): the same path, however fast it is gone."""
    for travel in (0.1e-3, 0.5e-3, 2e-3):
        expected = -1.0 + 2.0 * (1.0 - np.exp(-travel / LENGTH_M))
        for speed in (0.001, 0.1, 2.0):
            found = dragged(law(), speed, travel / speed, share=-1.0)
            assert found == pytest.approx(expected, rel=1e-9)
            assert dragged(law(), -speed, travel / speed, share=1.0) == pytest.approx(-expected)


def test_at_rest_a_deflection_stays() -> None:
    assert dragged(law(1.4), 0.0, 5.0, share=0.7) == 0.7
    assert dragged(law(1.4), -0.0, 5.0, share=-0.7) == -0.7


def test_small_movements_meet_a_spring() -> None:
    # F_c / d = 100 N/mm: a micrometre changes the share by 1/500.
    assert dragged(law(), 0.001, 0.001) == pytest.approx(0.002, rel=0.002)


def test_lugre_slides_at_the_stribeck_curve() -> None:
    for speed, share in ((1e-5, 1.4), (0.01, 1.0 + 0.4 * np.exp(-1.0)), (0.1, 1.0)):
        found = dragged(law(1.4), speed, 20.0 * LENGTH_M / speed)
        assert found == pytest.approx(share, rel=1e-6)
        assert dragged(law(1.4), -speed, 20.0 * LENGTH_M / speed) == pytest.approx(-share, rel=1e-6)


def test_lugre_within_a_stroke_is_its_differential_equation() -> None:
    """A stroke of 3 mm at 2 Hz, as integrated by somebody else from the law as published."""
    friction, turn = law(1.3, 0.02), 2 * np.pi * 2.0

    def rate(t: float, z: NDArray[np.float64]) -> NDArray[np.float64]:
        w = 0.003 * turn * np.cos(turn * t)
        level = FORCE_N * (1.0 + 0.3 * np.exp(-((w / 0.02) ** 2)))
        stiffness = FORCE_N / LENGTH_M
        return np.asarray(w - stiffness * abs(w) / level * z)

    t = np.linspace(0.0, 1.0, 101)
    z = solve_ivp(rate, (0.0, 1.0), [0.0], t_eval=t, rtol=1e-9, atol=1e-15, max_step=1e-3).y[0]
    share, found, h = np.zeros((1, 1)), [0.0], 1e-4
    for k in range(10_000):
        w = 0.003 * turn * np.cos(turn * (k + 0.5) * h)
        share = friction.slid(share, np.array([[w]]), h)
        if (k + 1) % 100 == 0:
            found.append(float(share[0, 0]))
    np.testing.assert_allclose(found, z / LENGTH_M, atol=2e-5)


def test_dahl_is_lugre_without_surplus() -> None:
    rng = np.random.default_rng(1)
    share, closing = rng.uniform(-1, 1, (1, 50)), rng.normal(0.0, 0.1, (1, 50))
    one = law()
    same = FrictionLaw(one.force_n, one.presliding_m, np.zeros((1, 1)), one.stribeck_m_s)
    found, expected = one.slid(share, closing, 1e-4), same.slid(share, closing, 1e-4)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_car_without_dampers_loses_four_friction_forces_a_cycle() -> None:
    """Coulomb: with a short pre-sliding length the amplitude of heave falls by 4 F / k a cycle."""
    hard = 100.0 * P.k_tf  # a tyre that hardly yields: one degree of freedom is left
    even = replace(P, c_sf=0.0, c_sr=0.0, k_sf=20e3, k_sr=20e3, a=1.4, b=1.4, k_tf=hard, k_tr=hard)
    rough = Imperfections(friction=Friction(25.0, 25.0, presliding_m=2e-5))
    plant = load_car(even, AddedMass(), rough)
    rest, lift = standing(plant), np.zeros((7, 1))
    lift[0] = 0.04
    start = replace(rest, pose=rest.pose + lift)
    motion = drive(plant, Bump(Excitation.BOUNCE, 0.0, 0.0, 0.1), 2.6, start)
    period = 2 * np.pi * np.sqrt(even.m_s / 80e3)
    cycles = np.arange(4)
    found = motion.at(cycles * period).pose[0] - static_pose(plant)[0]
    np.testing.assert_allclose(found, 0.04 - cycles * 4 * 100.0 / 80e3, atol=1e-4)


def test_a_bumped_car_stays_where_it_sticks() -> None:
    """Friction holds: the car comes to rest off its free level, and does not creep back."""
    rough = Imperfections(friction=Friction(80.0, 80.0))
    plant = load_car(P, AddedMass(), rough)
    bump = Bump(Excitation.PITCH, 0.05, 0.0, 0.2)
    late_s = np.linspace(2.0, 3.0, 101)
    motion = drive(plant, bump, 3.1)
    moved = motion.at(late_s).pose - static_pose(plant)
    # It trembles about there, on rubber and seals that hardly damp.
    assert np.abs(moved[0].mean()) > 5e-4
    assert np.ptp(moved[0]) < 3e-4
    state = motion.states(late_s)
    assert np.abs(state.memory.friction).max() < 1.0
    # What friction carries is what the springs are short of, but for a little trembling.
    held = (plant.friction.force_n * state.memory.friction).mean(axis=1)
    spring = plant.suspension_n_m * (moved[3:] - corner_motion(plant, moved))
    np.testing.assert_allclose(held, -spring.mean(axis=1), atol=2.0)
