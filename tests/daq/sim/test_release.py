"""A car off blocks, pushed down and let go: poses and times by hand; true parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import bench_codec, load_bench
from daq.channels import Quantity
from daq.runs import BASELINE, Excitation
from daq.sim.acts import Acts
from daq.sim.balance import static_pose
from daq.sim.car import SimulatedCar
from daq.sim.dampers import Branch, Digressive
from daq.sim.ecu import rig_of
from daq.sim.imperfections import Friction, Imperfections
from daq.sim.load import load_car
from daq.sim.motion import Kinematics
from daq.sim.release import Release, dropped, pushed_down
from daq.sim.reported import present_parameters, true_parameters
from daq.vehicle import FORD_GRANADA, AddedMass, Corner
from tests.simulated.instruments import HUBS, IMU, TRAVELS, Fitting, channels

Array = NDArray[np.float64]
PLANT = load_car(FORD_GRANADA, AddedMass())
REST = static_pose(PLANT)


@dataclass(frozen=True)
class Constant:
    """A motion that is 9 in everything."""

    def at(self, t_s: Array) -> Kinematics:
        nine = np.full((7, len(t_s)), 9.0)
        return Kinematics(nine, nine, nine)


def test_hands_press_for_half_a_second_as_half_a_cosine_and_then_hold() -> None:
    release = Release(np.full((7, 1), 2.0), np.full((7, 1), 5.0), 1.0, 1.6, Constant())
    t_s = np.array([0.5, 1.0, 1.125, 1.25, 1.5, 1.55, 1.6, 1.601])
    found = release.at(t_s)
    turn = np.pi / 0.5
    quarter = np.cos(np.pi / 4)
    pose = [2.0, 2.0, 2.0 + 1.5 * (1 - quarter), 3.5, 5.0, 5.0, 5.0, 9.0]
    assert found.pose[3] == pytest.approx(pose)
    velocity = [0.0, 0.0, 1.5 * turn * quarter, 1.5 * turn, 0.0, 0.0, 0.0, 9.0]
    assert found.velocity[3] == pytest.approx(velocity)
    acceleration = [0.0, 0.0, 1.5 * turn**2 * quarter, 0.0, 0.0, 0.0, 0.0, 9.0]
    assert found.acceleration[3] == pytest.approx(acceleration, abs=1e-9)


def test_a_car_on_four_blocks_stands_as_much_higher_until_they_go() -> None:
    release = dropped(PLANT, Excitation.BOUNCE, 0.05, 1.0, 1.2)
    up = np.array([0.05, 0.0, 0.0, 0.05, 0.05, 0.05, 0.05])
    assert (release.held - REST)[:, 0] == pytest.approx(up, abs=1e-9)
    found = release.at(np.array([0.0, 0.999, 1.0, 1.1]))
    assert found.pose[0, :3] - REST[0] == pytest.approx([0.05] * 3)
    assert 0.0 < found.pose[0, 3] - REST[0, 0] < 0.05
    assert not found.velocity[:, :3].any()


def test_a_car_on_two_blocks_leans_away_from_them() -> None:
    held = (dropped(PLANT, Excitation.PITCH, 0.05, 1.0, 1.01).held - REST)[:, 0]
    assert held[1] < 0.0  # nose up
    assert held[3] > held[5] > -0.01
    assert held[3] == pytest.approx(held[4])


@pytest.mark.parametrize(
    ("kind", "x_m", "y_m"),
    [
        (Excitation.BOUNCE, 0.0, 0.0),
        (Excitation.PITCH, FORD_GRANADA.a, 0.0),
        (Excitation.ROLL, 0.0, (FORD_GRANADA.t_f + FORD_GRANADA.t_r) / 2),
    ],
)
def test_hands_push_the_body_down_by_so_much_where_they_are(
    kind: Excitation, x_m: float, y_m: float
) -> None:
    release = pushed_down(PLANT, kind, 0.04, 1.0, 1.61)
    sink = (release.held - REST)[:, 0]
    assert sink[0] - x_m * sink[1] + y_m * sink[2] == pytest.approx(-0.04)
    assert [release.start_s, release.go_s] == pytest.approx([1.0, 1.6])
    assert np.array_equal(release.rest, REST)


def test_hands_cannot_make_a_warp() -> None:
    with pytest.raises(ValueError, match="warp"):
        pushed_down(PLANT, Excitation.WARP, 0.04, 1.0, 1.61)


def test_a_push_is_as_strong_and_as_long_as_a_person_makes_them() -> None:
    bench = load_bench(None)
    acts = Acts(bench, rig_of(bench, bench_codec(bench), SimulatedCar(), 1))
    push = acts.push(BASELINE, Corner.REAR_LEFT)
    rest = acts.rest(BASELINE)
    acts.close()
    assert push.length_s == 1.2
    deepest = push.scene.motion.at(np.array([0.6])).pose - REST
    # The tyres of the Granada, 192 kN/m each, carry 400 N more.
    assert -192e3 * deepest[3:].sum() == pytest.approx(400.0, rel=1e-6)
    assert deepest[5, 0] == deepest[3:].min()
    still = rest.scene.motion.at(np.array([0.0, 0.5, 7.0]))
    assert still.pose == pytest.approx(np.tile(REST, 3))
    assert (rest.length_s, push.bump_s) == (np.inf, np.inf)


def test_true_parameters_are_means_of_the_corners_of_an_axle() -> None:
    imperfections = Imperfections(
        friction=Friction(40.0, 50.0, sides=(1.2, 1.0, 0.8, 1.0)),
        compression=0.8,
        rebound=1.4,
        bar_front_n_m=5e3,
        bar_rear_n_m=4e3,
        tyre_damping_front_ns_m=30.0,
        tyre_damping_rear_ns_m=20.0,
        suspension=(1.1, 1.1, 0.9, 1.0),
        damper=(1.0, 1.2, 1.0, 1.0),
        tyre=(1.0, 1.0, 1.2, 1.0),
        wheel=(1.0, 1.4, 1.0, 1.0),
        cg_offset_m=0.02,
    )
    p, truth = FORD_GRANADA, true_parameters(SimulatedCar(imperfections=imperfections))
    assert truth["k_sf"] == pytest.approx(1.1 * p.k_sf)
    assert truth["k_sr"] == pytest.approx(0.95 * p.k_sr)
    assert truth["c_sf"] == pytest.approx(1.1 * 1.1 * p.c_sf)  # the mean of both ways, then of both
    assert truth["c_sr"] == pytest.approx(1.1 * p.c_sr)
    assert [truth["k_tf"], truth["k_tr"]] == pytest.approx([p.k_tf, 1.1 * p.k_tr])
    assert [truth["m_uf"], truth["m_ur"]] == pytest.approx([1.2 * p.m_uf, p.m_ur])
    assert [truth["F_cf"], truth["F_cr"]] == pytest.approx([44.0, 45.0])
    named = [truth[name] for name in ("k_af", "k_ar", "c_tf", "c_tr", "y_s", "m_s")]
    assert named == [5e3, 4e3, 30.0, 20.0, 0.02, p.m_s]
    curve = Digressive(Branch(3e3, 1e3, 0.1), Branch(4e3, 2e3, 0.1))
    bent = true_parameters(SimulatedCar(imperfections=Imperfections(damper_front=curve)))
    # At the knee: 1000 v + 2000 x 0.1 tanh 1 one way, 2000 v + 2000 x 0.1 tanh 1 the other.
    assert bent["c_sf"] == pytest.approx((0.3e3 + 0.4e3 * np.tanh(1.0)) / 0.2, rel=1e-6)
    assert bent["c_sr"] == p.c_sr
    assert set(present_parameters(SimulatedCar())) == set(truth) - {
        "k_af", "k_ar", "c_tf", "c_tr", "y_s", "F_cf", "F_cr",
    }  # fmt: skip
    assert "F_cr" in present_parameters(SimulatedCar(imperfections=imperfections))


def test_sensors_are_fitted_device_by_device() -> None:
    fitting = Fitting(
        (IMU, HUBS[0], TRAVELS[1]), (-1.2, 0.3), 0.02, {IMU: 0.003, HUBS[0]: 0.001}, 0.0005,
        {HUBS[0]: 60.0},
    )  # fmt: skip
    made = {channel.name: channel for channel in channels(fitting)}
    assert list(made) == [
        "body_acc_z", "roll_rate", "pitch_rate", "hub_acc_fl", "hub_acc_fr", "travel_rl",
        "travel_rr",
    ]  # fmt: skip
    body, hub, travel = (made[name] for name in ("body_acc_z", "hub_acc_fr", "travel_rl"))
    assert (body.x_m, body.y_m, body.position_sigma_m) == (-1.2, 0.3, 0.02)
    assert (body.delay_s, hub.delay_s, travel.delay_s) == (0.003, 0.001, 0.0)
    assert (body.low_pass_hz, hub.low_pass_hz, travel.low_pass_hz) == (0.0, 60.0, 0.0)
    assert {channel.delay_sigma_s for channel in made.values()} == {0.0005}
    assert (hub.quantity, hub.corner, hub.signal) == (
        Quantity.HUB_ACCELERATION, Corner.FRONT_RIGHT, "HUB_Front.hub_acc_fr",
    )  # fmt: skip
    assert (made["roll_rate"].x_m, made["roll_rate"].position_sigma_m) == (0.0, 0.0)
    plain = channels(Fitting())
    assert len(plain) == 11
    assert (plain[0].x_m, plain[0].y_m) == (-1.05, 0.12)
