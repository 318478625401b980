"""The closed form of a linear car: the same motion as the integrated one, or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.runs import Excitation
from daq.sim import linear, motion
from daq.sim.balance import static_pose
from daq.sim.excitation import Bump
from daq.sim.imperfections import Imperfections
from daq.sim.linear import Exponentials, in_touch
from daq.sim.load import load_car
from daq.sim.motion import SmoothMotion, drive
from daq.sim.plant import Plant
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight

WEIGHTS = AddedMass((BodyWeight(60.0, 0.2, 0.45), HubWeight(5.0, Corner.REAR_LEFT)))
SOFT_TYRES = Imperfections(tyre_damping_front_ns_m=150.0, tyre_damping_rear_ns_m=50.0)
T_S = np.linspace(0.0, 2.5, 2501)


def bump(excitation: Excitation, height_m: float = 0.05) -> Bump:
    return Bump(excitation, height_m, start_s=0.5, duration_s=0.2)


def driven(plant: Plant, road: Bump) -> SmoothMotion:
    found = drive(plant, road, 2.5)
    assert isinstance(found, SmoothMotion)
    return found


def integrated(plant: Plant, road: Bump, monkeypatch: pytest.MonkeyPatch) -> SmoothMotion:
    with monkeypatch.context() as patched:
        patched.setattr(motion, "in_touch", lambda *_: None)
        return driven(plant, road)


@pytest.mark.parametrize("imperfections", [Imperfections(), SOFT_TYRES], ids=["bare", "damped"])
@pytest.mark.parametrize("excitation", list(Excitation))
def test_it_is_the_integrated_motion(
    excitation: Excitation, imperfections: Imperfections, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant, road = load_car(FORD_GRANADA, WEIGHTS, imperfections), bump(excitation)
    found = driven(plant, road)
    assert isinstance(found.on_bump, Exponentials)
    assert isinstance(found.decay, Exponentials)
    known, expected = found.at(T_S), integrated(plant, road, monkeypatch).at(T_S)
    np.testing.assert_allclose(known.pose, expected.pose, atol=5e-11)
    np.testing.assert_allclose(known.velocity, expected.velocity, atol=5e-9)
    np.testing.assert_allclose(known.acceleration, expected.acceleration, atol=5e-7)


def test_it_goes_on_where_a_motion_was_left() -> None:
    plant, road = load_car(FORD_GRANADA, WEIGHTS), bump(Excitation.ROLL)
    whole = driven(plant, road)
    at_s = 1.1
    state = whole.states(np.array([at_s]))
    left = np.concatenate([state.pose[:, 0], state.velocity[:, 0]])
    later = in_touch(plant, road, static_pose(plant), at_s, 2.5, left)
    assert later is not None
    t_s = np.linspace(at_s, 2.5, 101)
    np.testing.assert_allclose(later(t_s), whole.decay(t_s), atol=1e-10)


def test_there_is_none_where_a_tyre_leaves_the_road(monkeypatch: pytest.MonkeyPatch) -> None:
    plant, road = load_car(FORD_GRANADA, AddedMass()), bump(Excitation.BOUNCE, 0.09)
    found = driven(plant, road)
    assert not isinstance(found.decay, Exponentials)
    expected = integrated(plant, road, monkeypatch).at(T_S)
    np.testing.assert_allclose(found.at(T_S).pose, expected.pose, atol=1e-9)


def test_a_tyre_that_relaxes_fast_ends_its_push_by_its_damping_alone() -> None:
    road, rising = bump(Excitation.BOUNCE), 1.0
    for damping, kept in ((0.0, True), (1e4, False)):
        tyres = Imperfections(tyre_damping_front_ns_m=damping, tyre_damping_rear_ns_m=damping)
        plant = load_car(FORD_GRANADA, AddedMass(), tyres)
        rest = static_pose(plant)
        state = np.concatenate([rest[:, 0], [0.0, 0.0, 0.0, rising, 0.0, 0.0, 0.0]])
        found = in_touch(plant, road, rest, 0.8, 0.802, state)
        assert (found is not None) is kept


def test_there_is_none_for_modes_that_cannot_be_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    plant, road = load_car(FORD_GRANADA, WEIGHTS), bump(Excitation.WARP)
    monkeypatch.setattr(linear, "_MOST_CONDITION", 1.0)
    assert not isinstance(driven(plant, road).decay, Exponentials)


def test_a_car_without_dampers_has_one_too(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = load_car(replace(FORD_GRANADA, c_sf=0.0, c_sr=0.0), WEIGHTS)
    road = bump(Excitation.PITCH, 0.01)
    found = driven(plant, road)
    assert isinstance(found.decay, Exponentials)
    expected = integrated(plant, road, monkeypatch).at(T_S)
    np.testing.assert_allclose(found.at(T_S).pose, expected.pose, atol=1e-9)
