"""Fine steps of many runs at once, against exact solutions, energy and themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import Excitation
from daq.sim.balance import contact
from daq.sim.dampers import Branch, Digressive
from daq.sim.excitation import Bump, road_height
from daq.sim.imperfections import Friction, Imperfections
from daq.sim.load import load_car
from daq.sim.motion import Motion, SteppedMotion, drive, drive_all, standing
from daq.sim.plant import Plant, corner_motion, side_by_side
from daq.sim.stepping import step_all
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight

P = FORD_GRANADA
WEIGHTS = AddedMass((BodyWeight(80.0, -0.2, 0.45),))
SOFT = Digressive(Branch(1500.0, 500.0, 0.08), Branch(2600.0, 1400.0, 0.1))
REAL = Imperfections(
    friction=Friction(50.0, 35.0, presliding_m=0.4e-3, static_ratio=1.2),
    damper_front=SOFT,
    damper_rear=SOFT,
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
    return Bump(excitation, height_m, 0.1, 0.2)


def stepped(plant: Plant, road: Bump, end_s: float, step_s: float) -> SteppedMotion:
    rest = standing(plant)
    return SteppedMotion(
        plant, road, rest, step_all(side_by_side([plant]), [road], end_s, rest, step_s), 0
    )


@pytest.mark.parametrize("excitation", [Excitation.BOUNCE, Excitation.WARP])
def test_a_linear_car_moves_as_its_exact_solution(excitation: Excitation) -> None:
    plant = load_car(P, WEIGHTS)
    t = np.linspace(0.301, 0.8, 1000)
    exact = drive(plant, bump(excitation), 0.85).at(t)
    errors = []
    for step_s in (2e-4, 1e-4):
        found = stepped(plant, bump(excitation), 0.85, step_s).at(t)
        errors.append(np.abs(found.acceleration - exact.acceleration).max())
        np.testing.assert_allclose(found.pose, exact.pose, atol=1e-6)
        np.testing.assert_allclose(found.velocity, exact.velocity, atol=1e-4)
    # A hundredth of the quietest sensor's noise, and four times less with half the step.
    assert errors[1] < 1e-3
    assert errors[1] < 0.4 * errors[0]


@pytest.mark.long
def test_a_real_car_hardly_depends_on_the_step() -> None:
    plant = load_car(P, WEIGHTS, REAL)
    t = np.linspace(0.305, 0.55, 500)
    rough, fine = (
        stepped(plant, bump(Excitation.ROLL), 0.6, step_s).at(t) for step_s in (1e-4, 2.5e-5)
    )
    np.testing.assert_allclose(rough.acceleration[:3], fine.acceleration[:3], atol=0.01)
    np.testing.assert_allclose(rough.acceleration[3:], fine.acceleration[3:], atol=0.05)
    np.testing.assert_allclose(rough.pose, fine.pose, atol=2e-6)


def test_runs_side_by_side_are_the_runs_alone() -> None:
    plants = [load_car(P, AddedMass(), REAL), load_car(P, WEIGHTS, REAL)]
    roads = [bump(Excitation.BOUNCE), bump(Excitation.PITCH, 0.03)]
    t = np.linspace(0.0, 0.5, 400)
    together = drive_all(plants, roads, 0.55)
    for plant, road, motion in zip(plants, roads, together, strict=True):
        alone = drive(plant, road, 0.55).at(t)
        np.testing.assert_allclose(motion.at(t).acceleration, alone.acceleration, atol=1e-9)


def test_cars_that_are_not_built_alike_do_not_go_together() -> None:
    with pytest.raises(ValueError, match="have different elements"):
        side_by_side([load_car(P, AddedMass()), load_car(P, AddedMass(), REAL)])


def test_a_real_car_rests_until_its_bump() -> None:
    motion = drive(load_car(P, WEIGHTS, REAL), bump(Excitation.BOUNCE), 0.2)
    early = motion.at(np.array([0.0, 0.05, 0.0999]))
    assert not early.velocity.any()
    assert np.abs(early.acceleration).max() < 1e-6
    rest = standing(motion.plant).pose
    np.testing.assert_allclose(early.pose, rest * np.ones(3), atol=1e-9)


def powers(motion: Motion, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what dampers, tyres and friction take together, W, (n,)."""
    plant, state = motion.plant, motion.states(t_s)
    closing = state.velocity[3:] - corner_motion(plant, state.velocity)
    act = contact(plant, state.pose, state.velocity, np.zeros((4, 1)), 0.0, state.memory)
    still = contact(plant, state.pose, 0.0 * state.velocity, np.zeros((4, 1)), 0.0)
    tyre = (act.tyre_n - still.tyre_n) * -state.velocity[3:]
    suspension = (act.suspension_n - still.suspension_n) * closing
    return np.asarray((tyre + suspension).sum(axis=0))


def stored(motion: Motion, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return kinetic energy, and that of springs, stops, bars, tyres and gravity, J, (n,)."""
    plant, i, state = motion.plant, REAL, motion.states(t_s)
    pose, velocity = state.pose, state.velocity
    energy = 0.5 * np.sum(velocity * (plant.inertia @ velocity), axis=0)
    energy -= (plant.weight_n * pose).sum(axis=0)
    squeeze = pose[3:] - corner_motion(plant, pose)
    bent = plant.progression
    assert bent is not None
    u, c = squeeze - bent.ride_m, -pose[3:] - bent.squash_m
    k2 = np.array([[i.quadratic_n_m2[x]] for x in (0, 0, 1, 1)])
    k3 = np.array([[i.cubic_n_m3[x]] for x in (0, 0, 1, 1)])
    kb = np.array([[i.stop_n_m[x]] for x in (0, 0, 1, 1)])
    gap = np.array([[i.stop_gap_m[x]] for x in (0, 0, 1, 1)])
    beta = np.array([[i.tyre_progression_per_m[x]] for x in (0, 0, 1, 1)])
    energy += np.sum(plant.suspension_n_m * squeeze**2 / 2 + k2 * u**3 / 3 + k3 * u**4 / 4, axis=0)
    energy += np.sum(kb * np.maximum(u - gap, 0.0) ** 2 / 2, axis=0)
    energy += np.sum(plant.tyre_n_m * (pose[3:] ** 2 / 2 + beta * c**3 / 3), axis=0)
    energy += i.bar_front_n_m * (squeeze[0] - squeeze[1]) ** 2 / 2
    return np.asarray(energy + i.bar_rear_n_m * (squeeze[2] - squeeze[3]) ** 2 / 2)


def test_the_energy_lost_is_what_dampers_tyres_and_friction_take() -> None:
    """With friction and mounts: what they store is small beside what is lost."""
    plant = load_car(P, WEIGHTS, REAL)
    motion = drive(plant, bump(Excitation.ROLL), 1.3)
    t = 0.301 + 1e-4 * (np.arange(9_900, dtype=np.float64) + 0.5)
    assert (motion.states(t).pose[3:] < 0.0).all()  # no tyre leaves the ground
    work = np.sum(powers(motion, t)) * 1e-4
    assert work > 5.0
    energy = stored(motion, t[[0, -1]])
    assert energy[0] - energy[1] == pytest.approx(work, rel=1e-3)


def test_added_mass_sinks_into_progressive_springs_and_tyres() -> None:
    """The bare car defines where springs bend; weights press it further, by their own law."""
    even = replace(P, a=1.4, b=1.4, k_sf=20e3, k_sr=20e3, k_tf=2e5, k_tr=2e5)
    bent = Imperfections(
        quadratic_n_m2=(4e4, 4e4), cubic_n_m3=(5e5, 5e5), tyre_progression_per_m=(5.0, 5.0)
    )
    weight = AddedMass((BodyWeight(200.0, -1.4, 0.0),))
    bare, loaded = (standing(load_car(even, mass, bent)).pose for mass in (AddedMass(), weight))
    np.testing.assert_allclose(bare, standing(load_car(even, AddedMass())).pose, atol=1e-12)
    share = 50.0 * 9.80665
    sunk = (bare - loaded)[3, 0]
    assert 2e5 * sunk * (1.0 + 5.0 * sunk) == pytest.approx(share, rel=1e-9)
    u = (bare - loaded)[0, 0] - sunk
    assert 20e3 * u + 4e4 * u**2 + 5e5 * u**3 == pytest.approx(share, rel=1e-9)


def spring_load(
    plant: Plant, pose: NDArray[np.float64], road: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what the tyres of `REAL` would carry by their springs alone, if they could pull."""
    k = np.array([[P.k_tf], [P.k_tf], [P.k_tr], [P.k_tr]])
    beta = np.array([[4.0], [4.0], [2.0], [2.0]])
    beyond = standing(plant).pose[3:] - (pose[3:] - road)
    return np.asarray(k * (-standing(plant).pose[3:] + beyond) + k * beta * beyond**2)


def test_a_tyre_in_the_air_carries_nothing() -> None:
    motion = drive(load_car(P, AddedMass(), REAL), bump(Excitation.BOUNCE, 0.13), 0.6)
    t = np.linspace(0.2, 0.58, 2000)
    state, road = motion.states(t), road_height(motion.bump, t)
    loads = contact(motion.plant, state.pose, state.velocity, road, 0.0, state.memory).tyre_n
    airborne = spring_load(motion.plant, state.pose, road) < 0.0
    assert airborne.any()
    assert (loads[airborne] == 0.0).all()
    assert loads.min() >= 0.0
    # The load ends where the wheel leaves, without a jump: 20 mm further down it carries 4 kN.
    leaves = np.diff(airborne.astype(int), axis=1) == 1
    assert leaves.any()
    assert loads[:, :-1][leaves].max() < 100.0
    # With nothing under it a wheel falls by its own weight and what the suspension presses on it.
    act = contact(motion.plant, state.pose, state.velocity, road, 0.0, state.memory)
    masses = np.array([[P.m_uf], [P.m_uf], [P.m_ur], [P.m_ur]])
    expected = -act.suspension_n / masses - 9.80665
    errors = np.abs(motion.at(t).acceleration[3:] - expected)[airborne]
    assert np.quantile(errors, 0.99) < 0.01  # the steps in which it leaves or lands are neither


def test_a_relieved_tyre_never_hardens_again() -> None:
    plant = load_car(P, AddedMass(), Imperfections(tyre_progression_per_m=(12.0, 12.0)))
    rest = standing(plant).pose
    heights = np.linspace(0.0, 0.2, 400)
    lifted = rest + np.vstack([np.zeros((3, 400)), np.tile(heights, (4, 1))])
    loads = contact(plant, lifted, np.zeros((7, 400)), np.zeros((4, 1))).tyre_n
    assert (np.diff(loads, axis=1) <= 0.0).all()
