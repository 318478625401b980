"""The planner against the tables of an independent prototype, and against brute force.

Figures in per cent are standard deviations: docs/method.md, "Noise and the bound".
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.channels import Channel, Quantity, paper_channels
from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import (
    FORD_GRANADA,
    AddedMass,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
)
from dbc.words import InputError
from identify.model.matrices import matrices, physical_model, state_matrix
from identify.model.response import Bump, exact_response
from identify.plan.design import Plan, Runs, Sensor, candidates, sensor
from identify.plan.outlook import KnownRuns, Outlook, advise, expected

TRUTH = FORD_GRANADA.to_array()
PAPER_MASS = np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0])
STATES = (MassState(BASELINE), MassState(ADDED, AddedMass(matrix=PAPER_MASS)))
CASES = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
TAPE = tuple(
    Fact(q, 1.0, 1e-4)
    for q in (FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK)
)
SCALES = (Fact(FactQuantity.TOTAL_MASS, 1700.0, 1.0),)
IMU_HUBS = (
    Channel("az", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.05),
    Channel("pitch", Quantity.PITCH_RATE, "rad/s"),
    Channel("roll", Quantity.ROLL_RATE, "rad/s"),
    *(Channel(f"hub_{c}", Quantity.HUB_ACCELERATION, "m/s2", corner=c) for c in Corner),
)


def _runs(
    cases: tuple[Excitation, ...] = CASES, states: tuple[str, ...] = (BASELINE, ADDED)
) -> tuple[Runs, ...]:
    return tuple(Runs(state, case) for state in states for case in cases)


def _noise(rate_hz: float, decibels: float = 30.0) -> NDArray[np.float64]:
    """Return the noise of 30 dB (docs/method.md) of the paper's channels, (7,)."""
    powers = []
    for delta in (np.zeros((7, 7)), PAPER_MASS):
        model = physical_model(FORD_GRANADA).with_mass(delta)
        powers += [
            np.mean(exact_response(model, case, Bump(), rate_hz, 3.0).acceleration ** 2, axis=0)
            for case in CASES
        ]
    return np.asarray(10 ** (-decibels / 20) * np.sqrt(np.mean(powers, axis=0)))


def _paper_plan(rate_hz: float = 200.0, cases: tuple[Excitation, ...] = CASES) -> Plan:
    noise = _noise(rate_hz).tolist()
    sensors = tuple(
        Sensor(c, level, rate_hz) for c, level in zip(paper_channels(), noise, strict=True)
    )
    return Plan(TRUTH, sensors, STATES, _runs(cases), Bump(), 2.7)


def _bench_plan(channels: tuple[Channel, ...] = IMU_HUBS, facts: tuple[Fact, ...] = TAPE) -> Plan:
    sensors = tuple(sensor(channel, 200.0) for channel in channels)
    return Plan(TRUTH, sensors, STATES, _runs(), decay_s=2.7, facts=facts)


def outlook(plan: Plan) -> Outlook:
    return expected(KnownRuns().fisher(plan))


def _percent(plan: Plan) -> NDArray[np.float64]:
    """Return the expected standard deviation of each unknown parameter."""
    found = outlook(plan).parameters.values()
    return np.array([100.0 * e.std / e.value for e in found if e.std])


def _worst(plan: Plan) -> float:
    return float(_percent(plan).max())


def test_the_bound_of_the_papers_campaign() -> None:
    published = "0.64 0.74 0.82 0.76 0.71 0.77 0.68 0.73 0.67 0.73 0.67 0.52 0.34 1.14 0.84"
    expected = [float(figure) for figure in published.split()]
    np.testing.assert_allclose(_percent(_paper_plan()), expected, rtol=0.02)


@pytest.mark.parametrize(("rate_hz", "three", "with_warp"), [(100, 1.58, 1.03), (500, 0.73, 0.48)])
def test_rate_and_warp(rate_hz: float, three: float, with_warp: float) -> None:
    assert _worst(_paper_plan(rate_hz)) == pytest.approx(three, rel=0.02)
    warped = _paper_plan(rate_hz, (*CASES, Excitation.WARP))
    assert _worst(warped) == pytest.approx(with_warp, rel=0.02)


def test_geometry_scales_and_structure() -> None:
    plan = _paper_plan()
    known = replace(plan, geometry=FORD_GRANADA.geometry)
    assert _worst(known) == pytest.approx(0.64, rel=0.03)
    assert _worst(replace(known, facts=SCALES)) == pytest.approx(0.17, rel=0.05)
    free = replace(plan, structure=Structure(symmetric=False), facts=TAPE)
    assert _worst(free) == pytest.approx(0.76, rel=0.05)
    rolls = (Runs(BASELINE, Excitation.ROLL, 3), Runs(ADDED, Excitation.ROLL, 3))
    assert _worst(replace(plan, runs=rolls)) == pytest.approx(1.63, rel=0.03)
    windows = [_worst(replace(plan, decay_s=s)) for s in (0.5, 1.0, 2.0)]
    # A constant is fitted to each channel here, not in the prototype: a short window costs more.
    np.testing.assert_allclose(windows, [1.4, 1.17, 1.14], rtol=0.07)


def _decay_jacobian(case: Excitation, delta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return d(accelerations)/d(15 logarithms, 14 initial states, 7 constants) by differences."""
    rate_hz, duration_s = 100.0, 1.0
    model = physical_model(FORD_GRANADA).with_mass(delta)
    run = exact_response(model, case, Bump(), 1000.0, 0.3)
    start = np.concatenate([run.displacement[-1], run.velocity[-1]])
    count = int(duration_s * rate_hz)

    def seen(log_theta: NDArray[np.float64]) -> NDArray[np.float64]:
        M, C, K = (m.real for m in matrices(np.exp(log_theta)))
        A = state_matrix(M + delta, C, K)
        step, power = expm(A / rate_hz), np.eye(14)
        rows = []
        for _ in range(count):
            rows.append(A[7:] @ power)
            power = step @ power
        return np.array(rows)  # (n, 7, 14)

    log_truth, h = np.log(TRUTH), 1e-5
    by_theta = [
        ((seen(log_truth + h * e) - seen(log_truth - h * e)) @ start / (2 * h)).ravel()
        for e in np.eye(15)
    ]
    by_start = seen(log_truth).reshape(-1, 14)
    constants = np.tile(np.eye(7), (count, 1))
    return np.column_stack([*by_theta, by_start, constants])


def test_brute_force() -> None:
    noise = _noise(200.0)
    information = np.zeros((15, 15))
    for delta in (np.zeros((7, 7)), PAPER_MASS):
        for case in CASES:
            J = _decay_jacobian(case, delta) / np.tile(noise, 100)[:, None]
            scaled = J[:, 15:] / np.linalg.norm(J[:, 15:], axis=0)
            Q = np.linalg.qr(scaled)[0]
            left = J[:, :15] - Q @ (Q.T @ J[:, :15])
            information += left.T @ left
    expected = 100.0 * np.sqrt(np.diag(np.linalg.inv(information)))
    plan = _paper_plan()
    slower = tuple(replace(s, rate_hz=100.0) for s in plan.sensors)
    planned = replace(plan, sensors=slower, decay_s=1.0)
    np.testing.assert_allclose(_percent(planned), expected, rtol=1e-4)


def test_weights_of_uncertain_mass_and_sensors_of_uncertain_place_cost() -> None:
    exact = _bench_plan()

    def with_weights(sigma_kg: float) -> Plan:
        weights = tuple(HubWeight(5.0, corner, sigma_kg) for corner in Corner)
        return replace(exact, mass_states=(STATES[0], MassState(ADDED, AddedMass(weights))))

    assert _worst(with_weights(0.1)) > 1.05 * _worst(with_weights(0.0))
    az, *others = exact.sensors
    vague = replace(az, channel=replace(az.channel, position_sigma_m=0.05))
    assert _worst(replace(exact, sensors=(vague, *others))) > 1.001 * _worst(exact)


def test_bounce_and_pitch_leave_the_roll_undetermined() -> None:
    plan = replace(_bench_plan(facts=()), runs=_runs(CASES[:2]))
    advice = advise(plan, KnownRuns())
    now = advice.outlook
    assert set(now.undetermined) == {"I_xx", "t_f", "t_r"}
    assert now.open_directions == 3
    assert "I_xx, t_f, t_r" in now.reasons[0]
    assert np.isinf(now.parameters["I_xx"].std)
    assert np.isfinite(now.worst)
    assert advice.remedies == ("one roll run in mass state baseline",)
    assert not advice.steps[0].outlook.undetermined
    # What leaves the roll in the dark is no next step.
    assert not any("bounce" in step.action for step in advice.steps)


def test_without_added_mass_and_scales_there_is_no_scale() -> None:
    plan = replace(_bench_plan(), runs=_runs(states=(BASELINE,)))
    advice = advise(plan, KnownRuns())
    assert set(advice.outlook.undetermined) == set(outlook(plan).parameters) - {*"ab", "t_f", "t_r"}
    assert advice.outlook.open_directions == 1
    assert "scale" in advice.outlook.reasons[0]
    (remedy,) = advice.remedies
    assert "weigh" in remedy or ADDED in remedy
    unloaded = replace(plan, mass_states=(MassState(BASELINE),))
    actions = [
        step.action for step in advise(unloaded, KnownRuns()).steps if not step.outlook.undetermined
    ]
    assert any("on every hub" in action for action in actions)
    assert "weigh the vehicle to 1 kg" in actions


def test_steps_are_what_their_plans_will_show_sorted_and_few() -> None:
    plan = replace(_bench_plan(facts=()), bump=Bump(0.02))
    advice = advise(plan, KnownRuns())
    assert 6 <= len(advice.steps) <= 12
    worth = [step.outlook.worst * step.outlook.mean for step in advice.steps]
    assert worth == sorted(worth)
    assert worth[-1] < advice.outlook.worst * advice.outlook.mean
    assert "a bump of 50 mm instead of 20 mm" in [step.action for step in advice.steps]
    # What is reused from plan to plan is the same as what is computed for each.
    by_action = {c.action: c.plan for c in candidates(plan)}
    for step in advice.steps[:3]:
        alone = outlook(by_action[step.action])
        assert step.outlook.worst == pytest.approx(alone.worst, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate_hz": 1.0}, "1 samples a second"),
        ({"noise": 0.0}, "noise"),
        ({"sensors": ()}, "no sensor"),
        ({"runs": (Runs("laden", Excitation.ROLL),)}, "laden"),
        ({"bump": Bump(0.0)}, "0 mm"),
        ({"bump": Bump(float("nan"))}, "nan"),
        ({"decay_s": -1.0}, "free decay"),
        ({"mass_states": (*STATES, STATES[0])}, "baseline occurs twice"),
    ],
)
def test_plans_that_are_none(change: dict[str, Any], message: str) -> None:
    plan = _bench_plan()
    with pytest.raises(InputError, match=message):
        replace(plan.sensors[0] if {"rate_hz", "noise"} & change.keys() else plan, **change)
