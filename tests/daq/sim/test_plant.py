"""The plant against closed forms, moments by hand, and the matrices of Eqs. 3-10."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.sim.balance import contact, forces, static_pose
from daq.sim.load import load_car
from daq.sim.masses import GRAVITY_M_S2
from daq.sim.plant import Plant
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight, VehicleParameters
from identify.model.matrices import PhysicalModel, delta_mass, physical_model

G = GRAVITY_M_S2
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
PAPER_BASELINE = [
    (1.0511, 0.2663),
    (1.3078, 0.2502),
    (1.6516, 0.3596),
    (10.7678, 0.2541),
    (10.7712, 0.2506),
    (11.2859, 0.2600),
    (11.2881, 0.2651),
]
PAPER_ADDED = [
    (1.0021, 0.2540),
    (1.2456, 0.2383),
    (1.5664, 0.3412),
    (10.2375, 0.2377),
    (10.2395, 0.2399),
    (10.7774, 0.2489),
    (10.7818, 0.2526),
]
PAPER_MATRIX = AddedMass(matrix=np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]))


def linearised(plant: Plant) -> PhysicalModel:
    """M from the accelerations that unit forces make; C and K as slopes of the forces at rest."""
    rest, still, flat = static_pose(plant), np.zeros((7, 1)), np.zeros((4, 1))
    h = 1e-3
    stiffness = np.hstack(
        [
            (forces(plant, rest - d, still, flat) - forces(plant, rest + d, still, flat)) / (2 * h)
            for d in h * np.eye(7)[:, :, None]
        ]
    )
    damping = np.hstack(
        [
            (forces(plant, rest, -d, flat) - forces(plant, rest, d, flat)) / (2 * h)
            for d in h * np.eye(7)[:, :, None]
        ]
    )
    mass = np.asarray(np.linalg.inv(plant.mobility), dtype=np.float64)
    return PhysicalModel(mass, damping, stiffness)


def modes(state_matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Frequency in Hz and damping ratio of each conjugate pair, ascending."""
    poles = np.linalg.eigvals(state_matrix)
    poles = poles[poles.imag > 0]
    table = np.stack([np.abs(poles) / (2 * np.pi), -poles.real / np.abs(poles)], axis=1)
    return table[np.argsort(table[:, 0])]


@pytest.mark.parametrize("parameters", [FORD_GRANADA, UNEQUAL])
@pytest.mark.parametrize("added", [AddedMass(), LOPSIDED, PAPER_MATRIX])
def test_linearised_plant_is_equations_3_to_10(
    parameters: VehicleParameters, added: AddedMass
) -> None:
    expected = physical_model(parameters).with_mass(delta_mass(added, parameters.a).real)
    found = linearised(load_car(parameters, added))
    for name in ("M", "C", "K"):
        truth = getattr(expected, name)
        np.testing.assert_allclose(getattr(found, name), truth, atol=1e-9 * np.abs(truth).max())


@pytest.mark.parametrize(
    ("added", "published"), [(AddedMass(), PAPER_BASELINE), (PAPER_MATRIX, PAPER_ADDED)]
)
def test_poles_are_those_of_the_method_paper(
    added: AddedMass, published: list[tuple[float, float]]
) -> None:
    found = modes(linearised(load_car(FORD_GRANADA, added)).A)
    np.testing.assert_allclose(found, np.array(sorted(published)), atol=6e-5)


def tyre_loads(plant: Plant) -> NDArray[np.float64]:
    act = contact(plant, static_pose(plant), np.zeros((7, 1)), np.zeros((4, 1)))
    return act.tyre_n[:, 0]


def test_corner_loads_of_the_unloaded_car_follow_from_moments() -> None:
    p = FORD_GRANADA
    front = p.m_s * G * p.b / (p.a + p.b) / 2
    rear = p.m_s * G * p.a / (p.a + p.b) / 2
    plant = load_car(p, AddedMass())
    loads = tyre_loads(plant)
    wheels = np.array([p.m_uf, p.m_uf, p.m_ur, p.m_ur]) * G
    np.testing.assert_allclose(loads, np.array([front, front, rear, rear]) + wheels, rtol=1e-12)
    pose = static_pose(plant)[:, 0]
    np.testing.assert_allclose(-pose[3:], loads / 192e3, rtol=1e-12)
    corner = pose[0] + np.array([-p.a, -p.a, p.b, p.b]) * pose[1]
    squeeze = np.array([front / p.k_sf, front / p.k_sf, rear / p.k_sr, rear / p.k_sr])
    np.testing.assert_allclose(pose[3:] - corner, squeeze, rtol=1e-12)
    assert pose[2] == pytest.approx(0.0, abs=1e-15)


def test_loads_under_lopsided_weights_balance_force_and_moments() -> None:
    p = UNEQUAL
    loads = tyre_loads(load_car(p, LOPSIDED))
    # Point loads (mass, x from the front axle, y): the body, the wheels, the weights.
    masses = [(p.m_s, -p.a, 0.0)]
    x = np.array([0.0, 0.0, -p.a - p.b, -p.a - p.b])
    y = np.array([p.t_f, -p.t_f, p.t_r, -p.t_r])
    masses += [(m, *xy) for m, *xy in zip([p.m_uf, p.m_uf, p.m_ur, p.m_ur], x, y, strict=True)]
    masses += [(40.0, 0.3, 0.5), (75.0, -1.7, -0.37), (21.0, -3.1, 0.2)]
    masses += [(4.0, 0.0, p.t_f), (6.5, -p.a - p.b, -p.t_r)]
    m, mx, my = np.array(masses).T
    assert loads.sum() == pytest.approx(G * m.sum(), rel=1e-12)
    assert loads @ x == pytest.approx(G * m @ mx, rel=1e-12)
    assert loads @ y == pytest.approx(G * m @ my, rel=1e-9)


def test_a_weight_front_left_lowers_that_corner_most() -> None:
    plant = load_car(FORD_GRANADA, AddedMass((BodyWeight(50.0, 0.0, 0.5),)))
    sag = static_pose(plant) - static_pose(load_car(FORD_GRANADA, AddedMass()))
    heave, pitch, roll = sag[:3, 0]
    assert heave < 0
    assert pitch > 0  # nose down
    assert roll < 0  # left side down
    assert np.argmin(sag[3:, 0]) == Corner.FRONT_LEFT.position


def test_a_matrix_has_inertia_but_no_gravity() -> None:
    plain, heavy = load_car(FORD_GRANADA, AddedMass()), load_car(FORD_GRANADA, PAPER_MATRIX)
    np.testing.assert_array_equal(static_pose(plain), static_pose(heavy))


def test_tyres_push_and_never_pull() -> None:
    plant = load_car(FORD_GRANADA, AddedMass())
    high = np.zeros((7, 1))
    high[3:, 0] = [0.01, -0.01, 0.0, -0.02]
    act = contact(plant, high, np.zeros((7, 1)), np.zeros((4, 1)))
    np.testing.assert_allclose(act.tyre_n[:, 0], [0.0, 1920.0, 0.0, 3840.0])


def test_damper_force_opposes_compression_and_rebound() -> None:
    plant = load_car(FORD_GRANADA, AddedMass())
    rising = np.zeros((7, 1))
    rising[3:, 0] = [0.5, 0.0, 0.0, -0.5]
    act = contact(plant, np.zeros((7, 1)), rising, np.zeros((4, 1)))
    np.testing.assert_allclose(act.suspension_n[:, 0], [750.0, 0.0, 0.0, -750.0])


def test_a_car_that_would_tip_over_is_refused() -> None:
    with pytest.raises(ValueError, match="off the ground"):
        static_pose(load_car(FORD_GRANADA, AddedMass((BodyWeight(2000.0, 2.0, 0.0),))))
