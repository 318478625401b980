"""The integrated run: energy, matrix exponential, lift-off, the road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import simpson
from scipy.linalg import expm

from daq.runs import Excitation
from daq.sim.balance import contact
from daq.sim.excitation import Bump, road_height
from daq.sim.load import load_car
from daq.sim.masses import GRAVITY_M_S2
from daq.sim.motion import Kinematics, Motion, drive
from daq.sim.plant import Plant
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight
from identify.model.matrices import delta_mass, physical_model

WEIGHTS = AddedMass((BodyWeight(60.0, 0.2, 0.45), HubWeight(5.0, Corner.REAR_LEFT)))


def bump(excitation: Excitation, height_m: float = 0.05) -> Bump:
    return Bump(excitation, height_m, start_s=0.5, duration_s=0.2)


def tyres(motion: Motion, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    k = motion.at(t_s)
    return contact(motion.plant, k.pose, k.velocity, road_height(motion.bump, t_s)).tyre_n


def energy(plant: Plant, k: Kinematics) -> NDArray[np.float64]:
    """Kinetic, elastic and potential energy of masses, springs and tyres on a flat road, (n,)."""
    z, theta, phi = k.pose[:3]
    p = FORD_GRANADA
    total = 0.5 * np.sum(k.velocity * (plant.inertia @ k.velocity), axis=0)
    for i, (x, y) in enumerate(
        [(p.a, p.t_f), (p.a, -p.t_f), (-p.b, p.t_r), (-p.b, -p.t_r)],
    ):
        squeeze = k.pose[3 + i] - (z - x * theta + y * phi)
        total += 0.5 * (p.k_sf if i < 2 else p.k_sr) * squeeze**2
        total += 0.5 * (p.k_tf if i < 2 else p.k_tr) * k.pose[3 + i] ** 2
        total += (p.m_uf if i < 2 else p.m_ur) * GRAVITY_M_S2 * k.pose[3 + i]
    total += p.m_s * GRAVITY_M_S2 * z
    for weight in WEIGHTS.weights:
        if isinstance(weight, BodyWeight):
            lift = z - (weight.x_m + p.a) * theta + weight.y_m * phi
        else:
            lift = k.pose[3 + weight.corner.position]
        total += weight.mass_kg * GRAVITY_M_S2 * lift
    return np.asarray(total)


def test_without_dampers_energy_is_kept() -> None:
    plant = load_car(replace(FORD_GRANADA, c_sf=0.0, c_sr=0.0), WEIGHTS)
    # Low enough that no tyre leaves the ground, where the energy of the tyre would need its clamp.
    motion = drive(plant, bump(Excitation.ROLL, 0.01), 3.7)
    t = np.linspace(0.0, 3.7, 3701)
    assert tyres(motion, t).min() > 0
    level = energy(plant, motion.at(np.array([0.0])))[0]
    stored = energy(plant, motion.at(np.linspace(0.7, 3.7, 3001))) - level
    assert stored[0] > 1.0  # J that the bump put in
    assert np.ptp(stored) < 1e-8 * stored[0]


def test_with_dampers_the_loss_is_their_work() -> None:
    plant = load_car(FORD_GRANADA, WEIGHTS)
    motion = drive(plant, bump(Excitation.WARP), 3.7)
    t = np.linspace(0.7, 3.7, 30001)
    k = motion.at(t)
    stored = energy(plant, k)
    act = contact(plant, k.pose, k.velocity, road_height(motion.bump, t))
    still = contact(plant, k.pose, np.zeros_like(k.velocity), road_height(motion.bump, t))
    damper = act.suspension_n - still.suspension_n
    work = simpson(np.sum(damper**2 / 1500.0, axis=0), x=t)  # force times speed, c = 1500 N s/m
    assert work > 10.0
    assert stored[0] - stored[-1] == pytest.approx(work, rel=1e-7)


@pytest.mark.parametrize("excitation", list(Excitation))
def test_free_decay_is_the_matrix_exponential(excitation: Excitation) -> None:
    motion = drive(load_car(FORD_GRANADA, WEIGHTS), bump(excitation), 3.7)
    rest = motion.at(np.array([0.0])).pose
    system = physical_model(FORD_GRANADA).with_mass(delta_mass(WEIGHTS, FORD_GRANADA.a).real).A
    t = np.array([0.7, 0.713, 0.9, 1.5, 3.7])
    k = motion.at(t)
    state = np.vstack([k.pose - rest, k.velocity])
    for i, elapsed in enumerate(t - 0.7):
        expected = expm(system * elapsed) @ state[:, 0]
        np.testing.assert_allclose(state[:, i], expected, atol=1e-9)
        np.testing.assert_allclose(k.acceleration[:, i], (system @ expected)[7:], atol=1e-6)


def test_the_car_rests_until_the_bump() -> None:
    motion = drive(load_car(FORD_GRANADA, WEIGHTS), bump(Excitation.BOUNCE), 1.0)
    k = motion.at(np.array([0.0, 0.2, 0.5]))
    assert np.abs(k.acceleration).max() < 1e-9
    assert not k.velocity.any()


def test_velocity_and_acceleration_are_derivatives_of_the_pose() -> None:
    motion = drive(load_car(FORD_GRANADA, WEIGHTS), bump(Excitation.PITCH), 1.5)
    for middle in (0.55, 0.63, 0.8, 1.2):
        h = 1e-4
        k = motion.at(np.array([middle - h, middle, middle + h]))
        slope = (k.pose[:, 2] - k.pose[:, 0]) / (2 * h)
        bend = (k.velocity[:, 2] - k.velocity[:, 0]) / (2 * h)
        np.testing.assert_allclose(k.velocity[:, 1], slope, atol=2e-5)
        np.testing.assert_allclose(k.acceleration[:, 1], bend, atol=2e-3)


def test_a_90_mm_bump_lifts_the_rear_wheels_and_a_50_mm_bump_does_not() -> None:
    plant = load_car(FORD_GRANADA, AddedMass())
    t = np.linspace(0.5, 2.0, 15001)
    low = [tyres(drive(plant, bump(case, 0.05), 2.0), t).min() for case in Excitation]
    # The reference has 1464 N with g = 9.81 m/s2; it is the roll case that unloads a tyre most.
    assert min(low) == pytest.approx(1464.0 - 3511.0 * 0.00034, abs=1.0)
    high = tyres(drive(plant, bump(Excitation.BOUNCE, 0.09), 2.0), t)
    assert (high[2:].min(axis=1) == 0.0).all()
    assert (high[:2] > 0.0).all()
    rolled = tyres(drive(plant, bump(Excitation.ROLL, 0.09), 2.0), t)
    assert rolled[2].min() == 0.0
    assert rolled[3].min() > 0.0


@pytest.mark.parametrize(
    ("excitation", "wheels"),
    [
        (Excitation.BOUNCE, [1, 1, 1, 1]),
        (Excitation.PITCH, [1, 1, 0, 0]),
        (Excitation.ROLL, [1, 0, 1, 0]),
        (Excitation.WARP, [1, 0, 0, 1]),
        (Excitation.REAR_PITCH, [0, 0, 1, 1]),
    ],
)
def test_the_road_is_equation_34_under_the_chosen_wheels(
    excitation: Excitation, wheels: list[int]
) -> None:
    t = np.array([0.0, 0.1, 0.15, 0.2, 0.3, 1.0])
    road = road_height(Bump(excitation, 0.09, 0.1, 0.2), t)
    rise = 0.09 * np.sin(5 * np.pi * (t - 0.1))  # as the paper prints it
    rise[[0, 1, 4, 5]] = 0.0
    np.testing.assert_allclose(road, np.outer(wheels, rise), atol=1e-15)
