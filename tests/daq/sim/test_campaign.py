"""Campaigns without frames: what the samples are, and what a session states of them."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from daq.runs import ADDED, BASELINE, Excitation
from daq.sim.car import SimulatedCar, Spread
from daq.sim.imperfections import Friction, Imperfections
from daq.vehicle import AddedMass, BodyWeight, Corner, HubWeight, MassState
from tests.simulated.campaign import Plan, PlannedBump, Simulated, simulate
from tests.simulated.instruments import HUBS, IMU, MESSAGES, Fitting, channels

SILENT = Spread(0.0, 0.0, 0.0, 0.0, 0.0)
WEIGHTS = AddedMass(
    (
        BodyWeight(80.0, -0.3, 0.4, sigma_kg=0.2, position_sigma_m=0.01),
        HubWeight(4.0, Corner.REAR_LEFT),
    )
)
CAR = SimulatedCar(noise=SILENT, bias=SILENT)
PLAN = Plan(
    bumps=(
        PlannedBump(BASELINE, Excitation.BOUNCE, 0.05),
        PlannedBump(ADDED, Excitation.ROLL, 0.03),
        PlannedBump(ADDED, Excitation.ROLL, 0.05),
    ),
    channels=channels(Fitting()),
    mass_states=(MassState(BASELINE), MassState(ADDED, WEIGHTS)),
    rates_hz={IMU: 100.0, HUBS[0]: 500.0},
    rest_s=0.3,
    decay_s=0.6,
)


def column(simulated: Simulated, run: int, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the instants and values of a channel."""
    (group,) = [g for g in simulated.session.runs[run].groups if name in g.values]
    return group.time_s, group.values[name]


def test_samples_are_the_motion_at_their_instants() -> None:
    simulated = simulate(CAR, PLAN, 1)
    assert pickle.loads(pickle.dumps(simulated.session)).provenance == {"source": "simulation"}
    for run in range(3):
        t, rate = column(simulated, run, "pitch_rate")
        assert len(t) == 110
        np.testing.assert_allclose(
            rate, simulated.motions[run].at(t).velocity[1], atol=1e-5, rtol=1e-5
        )
        t, hub = column(simulated, run, "hub_acc_fl")
        assert len(t) == 550
        expected = simulated.motions[run].at(t).acceleration[3] + 9.80665
        away = np.abs(t - 0.3) + np.abs(t - 0.5) > 0.201  # the road has corners there
        np.testing.assert_allclose(hub[away], expected[away], atol=2e-3)
    assert [run.label for run in simulated.session.runs] == [
        "baseline_bounce_1",
        "added_roll_1",
        "added_roll_2",
    ]


def test_a_late_sensor_shows_what_was() -> None:
    late = replace(PLAN, channels=channels(Fitting(delay_s={HUBS[0]: 0.004})))
    prompt, delayed = simulate(CAR, PLAN, 1), simulate(CAR, late, 1)
    t, value = column(delayed, 0, "hub_acc_fr")
    was = delayed.motions[0].at(t - 0.004).acceleration[4] + 9.80665
    after = t > 0.52
    np.testing.assert_allclose(value[after], was[after], atol=2e-3)
    rear, same = (column(simulated, 0, "hub_acc_rl")[1] for simulated in (prompt, delayed))
    np.testing.assert_allclose(same, rear, rtol=1e-9)


def test_records_may_begin_with_the_decay() -> None:
    fitting = Fitting(delay_s=dict.fromkeys(MESSAGES, 0.003), delay_sigma_s=0.001)
    cut = replace(PLAN, channels=channels(fitting), from_decay=True)
    simulated = simulate(CAR, cut, 3)
    for run in simulated.session.runs:
        for group in run.groups:
            late = max(simulated.truth.sensors[name].delay_s for name in group.values)
            assert 0.5 + late < group.time_s[0] < 0.5 + late + 0.0101


def test_the_session_states_what_people_know_and_not_what_is() -> None:
    simulated = simulate(CAR, PLAN, 5)
    stated = simulated.session.mass_states[1].added.weights[0]
    real = simulated.truth.mass_states[ADDED].weights[0]
    assert isinstance(stated, BodyWeight)
    assert isinstance(real, BodyWeight)
    assert (stated.mass_kg, stated.x_m, stated.y_m) == (80.0, -0.3, 0.4)
    assert 0.0 < abs(real.mass_kg - 80.0) < 1.0
    assert 0.0 < abs(real.x_m + 0.3) < 0.05
    assert 0.0 < abs(real.y_m - 0.4) < 0.05
    assert simulated.truth.mass_states[ADDED].weights[1] == stated_hub(simulated)


def stated_hub(simulated: Simulated) -> object:
    return simulated.session.mass_states[1].added.weights[1]


def test_noise_and_stuck_corners_are_drawn_by_the_seed() -> None:
    rough = SimulatedCar(imperfections=Imperfections(friction=Friction(60.0, 60.0)))
    short = replace(PLAN, bumps=PLAN.bumps[:2], decay_s=0.1, stuck=0.5)
    one, same, other = (simulate(rough, short, seed) for seed in (1, 1, 2))
    for run in range(2):
        values = [column(s, run, "body_acc_z")[1] for s in (one, same, other)]
        np.testing.assert_array_equal(values[0], values[1])
        assert np.std(values[0][:20]) == pytest.approx(0.03, rel=0.5)
        share = one.motions[run].states(np.array([0.0])).memory.friction
        assert 0.01 < np.abs(share).max() <= 0.5
        assert not np.array_equal(values[0][:10], values[2][:10])
    first, second = (m.states(np.array([0.0])).memory.friction for m in one.motions)
    assert not np.array_equal(first, second)


def test_a_bump_needs_its_mass_state() -> None:
    lost = replace(PLAN, mass_states=(MassState(BASELINE),))
    with pytest.raises(ValueError, match="there is no mass state added"):
        simulate(CAR, lost, 1)


def test_sensors_are_fitted_as_stated() -> None:
    fitting = Fitting(
        messages=(IMU, *HUBS),
        imu_m=(-1.2, 0.1),
        place_sigma_m=0.01,
        delay_s={IMU: 0.002},
        low_pass_hz={HUBS[1]: 40.0},
    )
    found = {channel.name: channel for channel in channels(fitting)}
    assert len(found) == 7
    imu = found["body_acc_z"]
    assert (imu.x_m, imu.y_m, imu.position_sigma_m, imu.delay_s) == (-1.2, 0.1, 0.01, 0.002)
    assert found["pitch_rate"].delay_s == 0.002
    assert found["hub_acc_rl"].low_pass_hz == 40.0
    assert found["hub_acc_fl"].low_pass_hz == 0.0
    assert not math.isnan(found["hub_acc_fl"].delay_s)
