"""The simulated car against closed forms, moments by hand and Eqs. 3-10; those of the tests."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.runs import Excitation
from daq.sim.motion import (
    GRAVITY_M_S2,
    Bump,
    Plant,
    dropped,
    load_car,
    pushed,
    pushed_down,
)
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight, VehicleParameters
from identify.model.matrices import PhysicalModel, delta_mass, physical_model

from ...simulated.elements import NONE, Branch, DamperCurve, Friction, Imperfections
from ...simulated.elements import load_car as load_real_car
from ...simulated.engine import RealPlant, drive, forces, standing

Array = NDArray[np.float64]
P, G = FORD_GRANADA, GRAVITY_M_S2
WEIGHTS = AddedMass((BodyWeight(60.0, 0.2, 0.45), HubWeight(5.0, Corner.REAR_LEFT)))
LOPSIDED = AddedMass(
    (
        BodyWeight(40.0, 0.3, 0.5, height_m=0.4),
        BodyWeight(75.0, -1.7, -0.37),
        BodyWeight(21.0, -3.1, 0.2, height_m=-0.15),
        HubWeight(4.0, Corner.FRONT_LEFT),
        HubWeight(6.5, Corner.REAR_RIGHT),
    )
)
UNEQUAL = VehicleParameters(
    1210.0, 2100.0, 410.0, 38.0, 52.0, 19e3, 26e3, 170e3, 210e3, 1300.0, 1750.0, 1.1, 1.6, 0.7, 0.78
)
PAPER_MATRIX = AddedMass(matrix=np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]))


def bump(excitation: Excitation, height_m: float = 0.05) -> Bump:
    return Bump(excitation, height_m, start_s=0.5, duration_s=0.2)


def linearised(plant: Plant) -> PhysicalModel:
    """Return M from the accelerations of unit forces; C and K as slopes of the forces."""
    unit, still, flat = np.eye(7), np.zeros((7, 7)), np.zeros((4, 7))
    at_rest = plant.forces(still, still, flat)
    stiffness = at_rest - plant.forces(unit, still, flat)
    damping = at_rest - plant.forces(still, unit, flat)
    mass = np.asarray(np.linalg.inv(plant.mobility), dtype=np.float64)
    return PhysicalModel(mass, damping, stiffness)


@pytest.mark.parametrize("parameters", [P, UNEQUAL])
@pytest.mark.parametrize("added", [AddedMass(), LOPSIDED, PAPER_MATRIX])
def test_linearised_plant_is_equations_3_to_10(
    parameters: VehicleParameters, added: AddedMass
) -> None:
    expected = physical_model(parameters).with_mass(delta_mass(added, parameters.a).real)
    found = linearised(load_car(parameters, added))
    for name in ("M", "C", "K"):
        truth = getattr(expected, name)
        np.testing.assert_allclose(getattr(found, name), truth, atol=1e-9 * np.abs(truth).max())


def test_loads_under_lopsided_weights_balance_force_and_moments() -> None:
    p, plant = UNEQUAL, load_car(UNEQUAL, LOPSIDED)
    loads = -plant.static_pose()[3:, 0] * np.repeat([p.k_tf, p.k_tr], 2)
    x = np.array([0.0, 0.0, -p.a - p.b, -p.a - p.b])
    y = np.array([p.t_f, -p.t_f, p.t_r, -p.t_r])
    # Point loads (mass, x from the front axle, y): the body, the wheels, the weights.
    masses = [(p.m_s, -p.a, 0.0), (40.0, 0.3, 0.5), (75.0, -1.7, -0.37), (21.0, -3.1, 0.2)]
    masses += [(m, *xy) for m, *xy in zip([p.m_uf, p.m_uf, p.m_ur, p.m_ur], x, y, strict=True)]
    masses += [(4.0, 0.0, p.t_f), (6.5, -p.a - p.b, -p.t_r)]
    m, mx, my = np.array(masses).T
    assert loads.sum() == pytest.approx(G * m.sum(), rel=1e-11)
    assert loads @ x == pytest.approx(G * m @ mx, rel=1e-11)
    assert loads @ y == pytest.approx(G * m @ my, rel=1e-9)
    with pytest.raises(ValueError, match="off the ground"):
        load_car(P, AddedMass((BodyWeight(2000.0, 2.0, 0.0),))).static_pose()


@pytest.mark.parametrize("excitation", list(Excitation))
def test_bump_and_free_decay_are_matrix_exponentials(excitation: Excitation) -> None:
    """On the bump state and road together follow z' = M z; after it the state alone does."""
    motion = load_car(P, WEIGHTS).drive(bump(excitation), 2.2)
    rest = motion.at(np.array([0.0]))
    assert np.abs(rest.acceleration).max() < 1e-9
    model, turn = physical_model(P).with_mass(delta_mass(WEIGHTS, P.a).real), np.pi / 0.2
    lifted = np.zeros(7)
    lifted[3:] = bump(excitation).crest_m[:, 0] * np.repeat([P.k_tf, P.k_tr], 2)
    system = np.zeros((16, 16))
    system[:14, :14] = model.A
    system[7:14, 14] = np.linalg.solve(model.M, lifted)
    system[14, 15], system[15, 14] = turn, -turn
    start, end = np.eye(16)[15], expm(system * 0.2) @ np.eye(16)[15]
    times_s = np.array([0.55, 0.6, 0.7, 0.713, 0.9, 1.5, 2.2])
    found = motion.at(times_s)
    for i, time_s in enumerate(times_s):
        expected = expm(system * (time_s - 0.5)) @ start
        if time_s > 0.7:
            expected = np.append(expm(model.A * (time_s - 0.7)) @ end[:14], [0.0, 0.0])
        np.testing.assert_allclose(found.pose[:, i] - rest.pose[:, 0], expected[:7], atol=1e-9)
        np.testing.assert_allclose(found.velocity[:, i], expected[7:14], atol=1e-9)
        if time_s != 0.7:  # where the road has its corner
            rate = (system @ expected)[7:14]
            np.testing.assert_allclose(found.acceleration[:, i], rate, atol=1e-6)


def test_the_road_is_equation_34_under_the_chosen_wheels() -> None:
    t = np.array([0.0, 0.1, 0.15, 0.2, 0.3, 1.0])
    rise = 0.09 * np.sin(5 * np.pi * (t - 0.1))  # as the paper prints it
    rise[[0, 1, 4, 5]] = 0.0
    for kind, wheels in (
        (Excitation.BOUNCE, [1, 1, 1, 1]), (Excitation.PITCH, [1, 1, 0, 0]),
        (Excitation.ROLL, [1, 0, 1, 0]), (Excitation.WARP, [1, 0, 0, 1]),
        (Excitation.REAR_PITCH, [0, 0, 1, 1]),
    ):  # fmt: skip
        road_m = Bump(kind, 0.09, 0.1, 0.2).road_m(t)
        np.testing.assert_allclose(road_m, np.outer(wheels, rise), atol=1e-15)


@pytest.mark.parametrize(
    ("kind", "x_m", "y_m"),
    [
        (Excitation.BOUNCE, 0.0, 0.0),
        (Excitation.PITCH, P.a, 0.0),
        (Excitation.ROLL, 0.0, (P.t_f + P.t_r) / 2),
    ],
)
def test_hands_push_the_body_down_by_so_much_where_they_are(
    kind: Excitation, x_m: float, y_m: float
) -> None:
    plant = load_car(P, AddedMass())
    release, rest = pushed_down(plant, kind, 0.04, 1.0), plant.static_pose()[:, 0]
    sink = release.at(np.array([1.6])).pose[:, 0] - rest
    assert sink[0] - x_m * sink[1] + y_m * sink[2] == pytest.approx(-0.04)
    half = release.at(np.array([1.25, 1.55]))  # pressed for 0.5 s as half a cosine, then held
    np.testing.assert_allclose(half.pose[:, 0] - rest, sink / 2, atol=1e-12)
    np.testing.assert_allclose(half.pose[:, 1] - rest, sink, atol=1e-12)
    with pytest.raises(ValueError, match="warp"):
        pushed_down(plant, Excitation.WARP, 0.04, 1.0)


def test_a_push_is_in_balance_with_the_springs() -> None:
    push = pushed(load_car(P, AddedMass()), Corner.FRONT_LEFT, 400.0, 1.2)
    deepest = push.at(np.array([0.6])).pose - push.rest
    # The tyres carry the push, and about the corner's axes nothing else turns the car.
    tyres = 192e3 * -deepest[3:, 0]
    assert tyres.sum() == pytest.approx(400.0)
    x, y = np.array([P.a, P.a, -P.b, -P.b]), np.array([P.t_f, -P.t_f, P.t_r, -P.t_r])
    assert x @ tyres == pytest.approx(400.0 * P.a)
    assert y @ tyres == pytest.approx(400.0 * P.t_f)


def test_a_car_on_blocks_stands_higher_until_they_go() -> None:
    plant = load_car(P, AddedMass())
    rest = plant.static_pose()
    release = dropped(plant, Excitation.BOUNCE, 0.05, 1.0)
    up = np.array([0.05, 0.0, 0.0, 0.05, 0.05, 0.05, 0.05])
    found = release.at(np.array([0.0, 0.999, 1.0, 1.1]))
    assert (found.pose[:, [0]] - rest)[:, 0] == pytest.approx(up, abs=1e-9)
    assert found.pose[0, :3] - rest[0] == pytest.approx([0.05] * 3)
    assert 0.0 < found.pose[0, 3] - rest[0, 0] < 0.05
    tilted = dropped(plant, Excitation.PITCH, 0.05, 1.0).at(np.array([1.0])).pose
    nose_up = (tilted - rest)[:, 0]
    assert nose_up[1] < 0.0
    assert nose_up[3] > nose_up[5] > -0.01


# The cars of the tests, with elements beyond the linear one ---------------------------------------

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


def axles(front: float, rear: float) -> Array:
    return np.array([[front], [front], [rear], [rear]])


def linearised_at_rest(plant: RealPlant) -> PhysicalModel:
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
    linear = load_car(P, WEIGHTS).drive(bump(excitation), 2.2).at(t_s)
    found = drive(load_real_car(P, WEIGHTS), bump(excitation), 2.2).at(t_s)
    for row, exact in zip(found, linear, strict=True):
        np.testing.assert_allclose(row, exact, atol=1e-6)


def test_imperfections_act_corner_by_corner() -> None:
    """Springs, tyres, wheels, bars and the CG off the middle, as slopes of the forces at rest."""
    car = Imperfections(
        suspension=(1.1, 0.9, 1.0, 1.2), tyre=(1.0, 1.1, 0.9, 1.0), wheel=(1.2, 1.0, 1.0, 0.9),
        damper=(1.0, 1.3, 0.8, 1.0), bar_front_n_m=5e3, bar_rear_n_m=-2e3, cg_offset_m=0.04,
        tyre_damping_front_ns_m=120.0,
    )  # fmt: skip
    found = linearised_at_rest(load_real_car(P, AddedMass(), car))
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
    plant = load_real_car(P, AddedMass())
    high, rising = np.zeros((7, 1)), np.zeros((7, 1))
    high[3:, 0], rising[3:, 0] = [0.01, -0.01, 0.0, -0.02], [0.5, 0.0, 0.0, -0.5]
    suspension_n, tyre_n, _ = forces(plant, high, rising, np.zeros((4, 1)))
    np.testing.assert_allclose(tyre_n[:, 0], [0.0, 1920.0, 0.0, 3840.0])
    springs = np.array([0.01 * P.k_sf, -0.01 * P.k_sf, 0.0, -0.02 * P.k_sr])
    np.testing.assert_allclose(suspension_n[:, 0] - springs, [750.0, 0.0, 0.0, -750.0])
    soft = load_real_car(P, AddedMass(), Imperfections(tyre_progression_per_m=(12.0, 12.0)))
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
    plant = load_real_car(
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
    plant, i = load_real_car(P, WEIGHTS, REAL), REAL
    bare = load_real_car(P, AddedMass(), REAL).static_pose()
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
    plant = load_real_car(even, AddedMass(), rough)
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
    plant, late_s = load_real_car(P, AddedMass(), rough), np.linspace(2.0, 3.0, 101)
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
        plant = load_real_car(p, AddedMass(), replace(car, mount_n_m=(front, rear)))
        return drive(plant, road, 1.3).at(t_s).acceleration

    without, soft, stiff = moved(inf, inf), moved(1e6, 1e6), moved(1e7, 1e7)
    assert np.abs(soft - without).max() > 0.5  # a mount of a real car is seen
    assert np.abs(stiff - without).max() < 0.2 * np.abs(soft - without).max()
    assert np.abs(moved(5e5, inf) - moved(5e5, 3e7)).max() < 0.15
    # A damper that does not yield moves with its wheel, and the mount is a spring between.
    hard = moved(5e3, 7e3, car=NONE, p=replace(P, c_sf=1e7, c_sr=1e7))
    springs = replace(P, k_sf=P.k_sf + 5e3, k_sr=P.k_sr + 7e3, c_sf=0.0, c_sr=0.0)
    np.testing.assert_allclose(hard, moved(inf, inf, car=NONE, p=springs), atol=0.1)
