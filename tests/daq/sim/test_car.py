"""The simulated car against closed forms, moments by hand, and Eqs. 3-10."""

from __future__ import annotations

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
