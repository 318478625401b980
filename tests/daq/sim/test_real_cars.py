"""The cars of the tests against the linear one, closed forms and energy."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from daq.runs import Excitation
from daq.sim.motion import GRAVITY_M_S2, Array, Bump
from daq.sim.motion import load_car as load_linear_car
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight, VehicleParameters
from identify.model.matrices import PhysicalModel

from ...simulated.elements import (
    NONE,
    Branch,
    DamperCurve,
    Friction,
    Imperfections,
    load_car,
)
from ...simulated.engine import RealPlant, drive, forces, standing

P, G = FORD_GRANADA, GRAVITY_M_S2
WEIGHTS = AddedMass((BodyWeight(60.0, 0.2, 0.45), HubWeight(5.0, Corner.REAR_LEFT)))
SOFT = DamperCurve(Branch(1500.0, 500.0, 0.08), Branch(2600.0, 1400.0, 0.1))
HARD = DamperCurve(
    Branch.table([(0.15, 225.0), (0.40, 450.0)]),
    Branch.table([(0.05, 150.0), (0.15, 390.0), (0.25, 540.0)]),
)
REAL = Imperfections(
    friction=Friction(50.0, 35.0, presliding_m=0.4e-3, static_ratio=1.2),
    damper_front=SOFT,
    damper_rear=HARD,
    mount_n_m=(1e6, 6e5),
    quadratic_n_m2=(4e4, 3e4),
    cubic_n_m3=(5e5, 4e5),
    stop_gap_m=(0.02, 0.025),
    stop_n_m=(1e5, 8e4),
    bar_front_n_m=8e3,
    bar_rear_n_m=-3e3,
    tyre_damping_front_ns_m=100.0,
    tyre_damping_rear_ns_m=80.0,
    tyre_progression_per_m=(4.0, 2.0),
    suspension=(1.04, 0.97, 1.0, 1.02),
    cg_offset_m=0.03,
)
"""A car with everything."""


def bump(excitation: Excitation, height_m: float = 0.05) -> Bump:
    return Bump(excitation, height_m, start_s=0.5, duration_s=0.2)


def axles(front: float, rear: float) -> Array:
    return np.array([[front], [front], [rear], [rear]])


def linearised(plant: RealPlant) -> PhysicalModel:
    """Return M from the accelerations of unit forces; C and K as slopes of the forces at rest."""
    rest, still, flat, h = plant.static_pose(), np.zeros((7, 7)), np.zeros((4, 7)), 1e-3
    step = h * np.eye(7)
    stiffness, damping = (
        forces(plant, rest - d, -v, flat)[2] - forces(plant, rest + d, v, flat)[2]
        for d, v in ((step, still), (still, step))
    )
    mass = np.asarray(np.linalg.inv(plant.mobility), dtype=np.float64)
    return PhysicalModel(mass, damping / (2 * h), stiffness / (2 * h))


@pytest.mark.parametrize("excitation", list(Excitation))
def test_a_car_without_elements_moves_as_the_linear_one(excitation: Excitation) -> None:
    t_s = np.linspace(0.0, 2.2, 2001)
    linear = load_linear_car(P, WEIGHTS).drive(bump(excitation), 2.2).at(t_s)
    found = drive(load_car(P, WEIGHTS), bump(excitation), 2.2).at(t_s)
    for row, exact in zip(found, linear, strict=True):
        np.testing.assert_allclose(row, exact, atol=1e-6)


def test_imperfections_act_corner_by_corner() -> None:
    """Springs, tyres, wheels, bars and the CG off the middle, as slopes of the forces at rest."""
    car = Imperfections(
        suspension=(1.1, 0.9, 1.0, 1.2), tyre=(1.0, 1.1, 0.9, 1.0), wheel=(1.2, 1.0, 1.0, 0.9),
        damper=(1.0, 1.3, 0.8, 1.0), bar_front_n_m=5e3, bar_rear_n_m=-2e3, cg_offset_m=0.04,
        tyre_damping_front_ns_m=120.0,
    )  # fmt: skip
    found = linearised(load_car(P, AddedMass(), car))
    k = axles(P.k_sf, P.k_sr)[:, 0] * car.suspension
    bars = np.array([5e3, 5e3, -2e3, -2e3])
    tyres = axles(P.k_tf, P.k_tr)[:, 0] * car.tyre
    np.testing.assert_allclose(np.diag(found.K)[3:], k + bars + tyres, rtol=1e-8)
    assert found.K[3, 4] == pytest.approx(-5e3)
    assert found.K[5, 6] == pytest.approx(2e3)
    c = axles(P.c_sf, P.c_sr)[:, 0] * car.damper
    np.testing.assert_allclose(
        np.diag(found.C)[3:], c + np.array([120.0, 120.0, 0.0, 0.0]), rtol=1e-8
    )
    m = axles(P.m_uf, P.m_ur)[:, 0] * car.wheel
    np.testing.assert_allclose(np.diag(found.M)[3:], m, rtol=1e-9)
    y = np.array([P.t_f, -P.t_f, P.t_r, -P.t_r]) - 0.04
    np.testing.assert_allclose(found.K[0, 2], k @ y, rtol=1e-7)


def test_tyres_push_and_never_pull_nor_stiffen_again() -> None:
    plant = load_car(P, AddedMass())
    high, rising = np.zeros((7, 1)), np.zeros((7, 1))
    high[3:, 0], rising[3:, 0] = [0.01, -0.01, 0.0, -0.02], [0.5, 0.0, 0.0, -0.5]
    suspension_n, tyre_n, _ = forces(plant, high, rising, np.zeros((4, 1)))
    np.testing.assert_allclose(tyre_n[:, 0], [0.0, 1920.0, 0.0, 3840.0])
    springs = np.array([0.01 * P.k_sf, -0.01 * P.k_sf, 0.0, -0.02 * P.k_sr])
    np.testing.assert_allclose(suspension_n[:, 0] - springs, [750.0, 0.0, 0.0, -750.0])
    soft = load_car(P, AddedMass(), Imperfections(tyre_progression_per_m=(12.0, 12.0)))
    lifted = soft.static_pose() + np.vstack(
        [np.zeros((3, 400)), np.tile(np.linspace(0, 0.2, 400), (4, 1))]
    )
    loads = forces(soft, lifted, np.zeros((7, 400)), np.zeros((4, 400)))[1]
    assert (np.diff(loads, axis=1) <= 0.0).all()


def test_dampers_have_their_slopes_knees_and_tables() -> None:
    speeds = np.array([-0.5, -0.1, -0.01, 0.01, 0.1, 0.6])
    expected = [
        1400.0 * v + 120.0 * np.tanh(v / 0.1) if v < 0 else 500.0 * v + 80.0 * np.tanh(v / 0.08)
        for v in speeds
    ]
    np.testing.assert_allclose(SOFT.force(speeds), expected)
    table = HARD.force(np.array([0.075, 0.15, 0.275, 0.5, -0.025, -0.1, -0.25, -0.35]))
    np.testing.assert_allclose(table, [112.5, 225.0, 337.5, 540.0, -75.0, -270.0, -540.0, -690.0])
    assert HARD.secant_ns_m == pytest.approx(2100.0)  # 150 N and 270 N at 0.1 m/s
    assert SOFT.scaled(1234.0).secant_ns_m == pytest.approx(1234.0)
    # The car's corners have the same forces, front and rear, times their factors.
    plant = load_car(
        P, AddedMass(),
        Imperfections(damper_front=SOFT, damper_rear=HARD, damper=(1.0, 0.5, 1.0, 2.0)),
    )  # fmt: skip
    moving, still = np.zeros((2, 7, len(speeds)))
    moving[3:] = speeds
    pose, flat = np.repeat(plant.static_pose(), len(speeds), axis=1), np.zeros((4, len(speeds)))
    act = [forces(plant, pose, v, flat)[0] for v in (moving, still)]
    found = act[0] - act[1]
    for row, (curve, factor) in enumerate(((SOFT, 1.0), (SOFT, 0.5), (HARD, 1.0), (HARD, 2.0))):
        np.testing.assert_allclose(found[row], factor * curve.force(speeds), atol=1e-9)


def test_springs_stops_bars_and_tyres_have_their_laws() -> None:
    """They count from the pose of the unloaded car, at standstill: dampers and friction rest."""
    plant, i = load_car(P, WEIGHTS, REAL), REAL
    bare = load_car(P, AddedMass(), REAL).static_pose()
    pose = bare + np.random.default_rng(1).uniform(-0.02, 0.02, (7, 200))
    travel, bare_travel = (each[3:] - plant.at_corners(each) for each in (pose, bare))
    u, squash = travel - bare_travel, bare[3:] - pose[3:]
    k = axles(P.k_sf, P.k_sr) * np.array(i.suspension)[:, None]
    spring_n = k * travel + axles(*i.quadratic_n_m2) * u**2 + axles(*i.cubic_n_m3) * u**3
    stop_n = axles(*i.stop_n_m) * np.maximum(u - axles(*i.stop_gap_m), 0.0)
    bar_n = axles(i.bar_front_n_m, i.bar_rear_n_m) * (travel - travel[[1, 0, 3, 2]])
    progression_n = axles(*i.tyre_progression_per_m) * np.maximum(squash, -0.125) ** 2
    tyre_n = axles(P.k_tf, P.k_tr) * (-pose[3:] + progression_n)
    suspension_n, found_tyre_n, _ = forces(plant, pose, 0.0 * pose, np.zeros((4, 200)))
    np.testing.assert_allclose(suspension_n, spring_n + stop_n + bar_n, atol=1e-6)
    np.testing.assert_allclose(found_tyre_n, np.maximum(tyre_n, 0.0), atol=1e-6)
    assert (stop_n > 0.0).any()


def test_a_car_without_dampers_loses_four_friction_forces_a_cycle() -> None:
    """Coulomb: with a short pre-sliding length the amplitude of heave falls by 4 F / k a cycle."""
    hard = 100.0 * P.k_tf  # a tyre that hardly yields: one degree of freedom is left
    even = replace(P, c_sf=0.0, c_sr=0.0, k_sf=20e3, k_sr=20e3, a=1.4, b=1.4, k_tf=hard, k_tr=hard)
    rough = Imperfections(friction=Friction(25.0, 25.0, presliding_m=2e-5))
    plant = load_car(even, AddedMass(), rough)
    start = standing(plant)
    start[0] += 0.04
    motion = drive(plant, Bump(Excitation.BOUNCE, 0.0, 0.0, 0.1), 2.6, start)
    cycles = np.arange(4)
    found = (
        motion.at(cycles * 2 * np.pi * np.sqrt(even.m_s / 80e3)).pose[0] - plant.static_pose()[0]
    )
    np.testing.assert_allclose(found, 0.04 - cycles * 4 * 100.0 / 80e3, atol=1e-4)


@pytest.mark.parametrize("ratio", [1.0, 1.4])
def test_a_bumped_car_stays_where_it_sticks(ratio: float) -> None:
    """Friction holds: the car comes to rest off its free level, and does not creep back."""
    rough = Imperfections(friction=Friction(80.0, 80.0, static_ratio=ratio))
    plant, late_s = load_car(P, AddedMass(), rough), np.linspace(2.0, 3.0, 101)
    motion = drive(plant, Bump(Excitation.PITCH, 0.05, 0.0, 0.2), 3.1)
    moved = motion.at(late_s).pose - plant.static_pose()
    # It trembles about there, on rubber and seals that hardly damp.
    assert np.abs(moved[0].mean()) > 3e-4
    assert np.ptp(moved[0]) < 4e-4
    # What friction carries is what the springs are short of.
    carried = 80.0 * motion.states(late_s)[14:18].mean(axis=1)
    spring = axles(P.k_sf, P.k_sr) * (moved[3:] - plant.at_corners(moved))
    np.testing.assert_allclose(carried, -spring.mean(axis=1), atol=2.0)
    assert np.abs(carried).max() < 80.0 * ratio


def test_mounts_lie_between_no_mount_and_no_damper() -> None:
    t_s, road = np.linspace(0.701, 1.29, 500), bump(Excitation.WARP)
    bare = Imperfections(friction=Friction(40.0, 40.0), damper_front=SOFT, damper_rear=HARD)

    def moved(
        front: float, rear: float, car: Imperfections = bare, p: VehicleParameters = P
    ) -> Array:
        plant = load_car(p, AddedMass(), replace(car, mount_n_m=(front, rear)))
        return drive(plant, road, 1.3).at(t_s).acceleration

    without, soft, stiff = moved(inf, inf), moved(1e6, 1e6), moved(1e7, 1e7)
    assert np.abs(soft - without).max() > 0.5  # a mount of a real car is seen
    assert np.abs(stiff - without).max() < 0.2 * np.abs(soft - without).max()
    assert np.abs(moved(5e5, inf) - moved(5e5, 3e7)).max() < 0.15
    # A damper that does not yield moves with its wheel, and the mount is a spring between.
    hard = moved(5e3, 7e3, car=NONE, p=replace(P, c_sf=1e7, c_sr=1e7))
    springs = replace(P, k_sf=P.k_sf + 5e3, k_sr=P.k_sr + 7e3, c_sf=0.0, c_sr=0.0)
    np.testing.assert_allclose(hard, moved(inf, inf, car=NONE, p=springs), atol=0.1)
