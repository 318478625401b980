"""Each imperfection against its closed form; a car without any is the car of the other tests."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import simpson

from daq.runs import Excitation
from daq.sim.balance import contact, forces, static_pose
from daq.sim.excitation import Bump, road_height, road_speed
from daq.sim.imperfections import NONE, Friction, Imperfections
from daq.sim.load import load_car
from daq.sim.masses import GRAVITY_M_S2
from daq.sim.motion import drive, standing
from daq.sim.plant import Plant, corner_motion
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner

G = GRAVITY_M_S2
P = FORD_GRANADA
STILL, FLAT = np.zeros((7, 1)), np.zeros((4, 1))


def car(imperfections: Imperfections, added: AddedMass | None = None) -> Plant:
    return load_car(P, added or AddedMass(), imperfections)


def suspension(plant: Plant, pose: dict[int, float], speed: dict[int, float]) -> list[float]:
    """Force in each corner beyond the static one, with some degrees of freedom moved."""
    rest = static_pose(plant)
    moved, moving = rest.copy(), STILL.copy()
    for dof, value in pose.items():
        moved[dof] += value
    for dof, value in speed.items():
        moving[dof] = value
    act = contact(plant, moved, moving, FLAT).suspension_n
    found = act - contact(plant, rest, STILL, FLAT).suspension_n
    return [float(force) for force in found[:, 0]]


def test_neutral_imperfections_change_no_bit() -> None:
    bump = Bump(Excitation.WARP, 0.05, 0.5, 0.2)
    t = np.linspace(0.0, 1.5, 301)
    plain = drive(load_car(P, AddedMass()), bump, 1.5).at(t)
    neutral = drive(car(Imperfections(friction=Friction(presliding_m=1e-3))), bump, 1.5).at(t)
    np.testing.assert_array_equal(plain.acceleration, neutral.acceleration)
    assert Imperfections() == NONE


def test_a_stuck_car_stands_where_friction_holds_it() -> None:
    plant = car(Imperfections(friction=Friction(60.0, 40.0)))
    free = static_pose(plant)
    np.testing.assert_array_equal(free, static_pose(car(NONE)))
    held = standing(plant, np.full((4, 1), 0.5)).pose
    # Half of the friction carries: the springs give up 30 and 20 N, the tyres nothing.
    lift = np.array([[30.0 / P.k_sf], [30.0 / P.k_sf], [20.0 / P.k_sr], [20.0 / P.k_sr]])
    np.testing.assert_allclose(corner_motion(plant, held - free), lift, rtol=1e-9)
    np.testing.assert_allclose(held[3:], free[3:], rtol=1e-12)


def test_a_damper_is_weaker_in_compression_than_in_rebound() -> None:
    plant = car(Imperfections(compression=1000 / 1500, rebound=2000 / 1500))
    np.testing.assert_allclose(
        suspension(plant, {}, {3: 0.3, 5: -0.3}), [300.0, 0.0, -600.0, 0.0], atol=1e-9
    )
    # A body going up leaves its wheels: rebound.
    np.testing.assert_allclose(suspension(plant, {}, {0: 0.2}), [-400.0] * 4, atol=1e-9)


def test_a_bar_holds_nothing_in_bounce_and_stiffens_roll() -> None:
    bars = Imperfections(bar_front_n_m=10e3, bar_rear_n_m=5e3)
    stiff, plain = car(bars), car(NONE)
    for pose in ({0: 0.02}, {1: 0.02}, {3: 0.01, 4: 0.01}):
        np.testing.assert_allclose(suspension(stiff, pose, {}), suspension(plain, pose, {}))
    # The travels of an axle differ by 2 t phi: the moment of its bar is k 2 t phi times 2 t.
    rest, rolled = static_pose(stiff), static_pose(stiff)
    rolled[2] += 0.01
    gained = forces(stiff, rolled, STILL, FLAT) - forces(plain, rolled, STILL, FLAT)
    gained -= forces(stiff, rest, STILL, FLAT) - forces(plain, rest, STILL, FLAT)
    assert gained[2, 0] == pytest.approx(-4 * (10e3 * P.t_f**2 + 5e3 * P.t_r**2) * 0.01, rel=1e-9)
    # One wheel up by 1 cm: 100 N through the bar on it, and as much the other way opposite.
    one = np.subtract(suspension(stiff, {3: 0.01}, {}), suspension(plain, {3: 0.01}, {}))
    np.testing.assert_allclose(one, [100.0, -100.0, 0.0, 0.0], atol=1e-8)


def test_a_tyre_damps_only_on_the_road() -> None:
    plant = car(Imperfections(tyre_damping_front_ns_m=150.0, tyre_damping_rear_ns_m=100.0))
    rest, falling, rising = static_pose(plant), STILL.copy(), STILL.copy()
    falling[3:], rising[3:] = -0.5, 60.0

    def tyre(
        pose: NDArray[np.float64],
        velocity: NDArray[np.float64],
        road_speed: NDArray[np.float64] | float = 0.0,
    ) -> NDArray[np.float64]:
        return contact(plant, pose, velocity, FLAT, road_speed).tyre_n[:, 0]

    gained = tyre(rest, falling) - tyre(rest, STILL)
    np.testing.assert_allclose(gained, [75.0, 75.0, 50.0, 50.0])
    # A road that rises does as much as a wheel that falls.
    np.testing.assert_allclose(tyre(rest, STILL, np.full((4, 1), 0.5)), tyre(rest, falling))
    # It can take the tyre's push away, but never pull; and in the air there is nothing to damp.
    assert (tyre(rest, rising) == 0.0).all()
    assert (tyre(rest + 0.5, falling) == 0.0).all()


def test_the_speed_of_the_road_is_the_slope_of_its_height() -> None:
    bump = Bump(Excitation.ROLL, 0.05, 0.5, 0.2)
    t = np.array([0.3, 0.51, 0.58, 0.66, 0.9])
    slope = (road_height(bump, t + 1e-7) - road_height(bump, t - 1e-7)) / 2e-7
    np.testing.assert_allclose(road_speed(bump, t), slope, atol=1e-6)
    assert road_speed(bump, np.array([0.5]))[0, 0] == pytest.approx(np.pi * 0.05 / 0.2)


def test_each_corner_may_differ() -> None:
    odd = car(
        Imperfections(
            suspension=(1.1, 1.0, 1.0, 1.0),
            damper=(1.0, 0.9, 1.0, 1.0),
            tyre=(1.0, 1.0, 1.2, 1.0),
            wheel=(1.0, 1.0, 1.0, 1.5),
        )
    )
    np.testing.assert_allclose(odd.suspension_n_m[:, 0], [1.1 * P.k_sf, P.k_sf, P.k_sr, P.k_sr])
    np.testing.assert_allclose(suspension(odd, {}, {4: 1.0}), [0.0, 1350.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(odd.tyre_n_m[:, 0], [192e3, 192e3, 230.4e3, 192e3])
    np.testing.assert_allclose(np.diag(odd.inertia)[3:], [40.5, 40.5, 45.4, 68.1])
    assert odd.weight_n[6, 0] == pytest.approx(-68.1 * G)


def test_a_cg_to_the_left_loads_the_left_wheels() -> None:
    y = 0.03
    weight = AddedMass((BodyWeight(60.0, -1.0, 0.4),))
    plant = car(Imperfections(cg_offset_m=y), weight)
    loads = contact(plant, static_pose(plant), STILL, FLAT).tyre_n[:, 0]
    left, right = loads[[0, 2]].sum(), loads[[1, 3]].sum()
    # Both axles are 0.74 m half wide: the difference of the sides carries the moment about y = 0.
    assert (left - right) * P.t_f == pytest.approx(G * (P.m_s * y + 60.0 * 0.4), rel=1e-9)
    # A weight turns about the CG: its arm is counted from there.
    assert plant.inertia[2, 2] == pytest.approx(P.I_xx + 60.0 * (0.4 - y) ** 2)
    np.testing.assert_allclose(
        plant.corner_y_m[:, 0], [P.t_f - y, -P.t_f - y, P.t_r - y, -P.t_r - y]
    )


@pytest.mark.parametrize(
    "imperfections",
    [
        Imperfections(compression=2 / 3, rebound=4 / 3),
        Imperfections(tyre_damping_front_ns_m=150.0, tyre_damping_rear_ns_m=150.0),
        Imperfections(bar_front_n_m=10e3, bar_rear_n_m=5e3, cg_offset_m=0.03),
    ],
)
def test_the_energy_lost_is_the_work_done(imperfections: Imperfections) -> None:
    """Springs, bars and tyres give back what they take; dampers, friction and tyre damping not."""
    plant = car(imperfections)
    motion = drive(plant, Bump(Excitation.ROLL, 0.05, 0.5, 0.2), 2.7)
    # Clear of the bump's end.
    t = np.linspace(0.7001, 2.7, 40001)
    k = motion.at(t)
    i, x, y = imperfections, plant.corner_x_m, plant.corner_y_m
    squeeze = k.pose[3:] - (k.pose[0] - x * k.pose[1] + y * k.pose[2])
    closing = k.velocity[3:] - (k.velocity[0] - x * k.velocity[1] + y * k.velocity[2])
    stored = 0.5 * np.sum(k.velocity * (plant.inertia @ k.velocity), axis=0)
    stored += 0.5 * np.sum([[P.k_sf], [P.k_sf], [P.k_sr], [P.k_sr]] * squeeze**2, axis=0)
    stored += 0.5 * np.sum(P.k_tf * k.pose[3:] ** 2, axis=0)
    stored += 0.5 * i.bar_front_n_m * (squeeze[0] - squeeze[1]) ** 2
    stored += 0.5 * i.bar_rear_n_m * (squeeze[2] - squeeze[3]) ** 2
    wheels = np.array([[P.m_uf], [P.m_uf], [P.m_ur], [P.m_ur]])
    stored += G * (P.m_s * k.pose[0] + np.sum(wheels * k.pose[3:], axis=0))
    damper = 1500.0 * np.where(closing > 0, i.compression, i.rebound)
    power = np.sum(damper * closing**2, axis=0)
    power += np.sum(i.tyre_damping_front_ns_m * k.velocity[3:] ** 2, axis=0)
    work = simpson(power, x=t)
    assert work > 10.0
    assert stored[0] - stored[-1] == pytest.approx(work, rel=1e-5)


def test_corners_stand_in_the_order_of_their_names() -> None:
    lopsided = load_car(P, AddedMass(), Imperfections(wheel=(1.0, 1.0, 2.0, 1.0)))
    heaviest = int(np.argmin(lopsided.weight_n[3:, 0]))
    assert heaviest == Corner.REAR_LEFT.position
