"""The fit: its optimum, start values, noise levels and the start of each decay."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.random import Generator
from numpy.typing import NDArray

from daq.channels import Channel
from daq.runs import ADDED, BASELINE, Excitation
from daq.sessions import ArrayRun, Session, session_from_arrays
from daq.sim.car import NOISE, SensorTruth, measured, true_reading
from daq.sim.motion import Bump, Moving, load_car
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, Fact, HubWeight, MassState
from identify.decays.decay import Record
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate, generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import FACTS, HOLD, PRIORS, LinearEngine, fit
from identify.study.campaign import SENSOR_SETS, Campaign, records_of

from ..bumps import GROUP, MASS_STATES, TRUTH, noise_of, paper_records
from ..stress import ADDED_MASS, THREE, fitted, stress_channels

BOX = GreyBox((GROUP,), MASS_STATES, None)
CAR = generic_vehicles()[0]
START_S = 0.3 + 1e-9


def _errors_percent(eta: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((np.exp(eta) / TRUTH[: len(eta)] - 1) * 100)


def test_residuals_are_the_noise() -> None:
    records = paper_records(200.0, 30.0, 5)
    decays = tuple(r.decay(START_S) for r in records)
    sigma = noise_of(records, 200.0)
    best = fit(BOX, decays, sigma, BOX.unknowns(CAR))
    left = LinearEngine(BOX).residuals(decays, sigma, best.eta)
    squares = sum(float(v @ v) / sigma[n] ** 2 for d in left for n, v in d.values.items())
    assert squares == pytest.approx(best.cost, rel=1e-9)
    freedom = sum(sum(d.freedom.values()) for d in left)
    samples = sum(d.n_values for d in decays)
    assert freedom == pytest.approx(samples - 6 * (14 + 7), rel=1e-9)
    assert squares / freedom == pytest.approx(1.0, abs=0.06)


def test_a_weight_beside_its_place_moves_the_car_unless_its_place_is_uncertain() -> None:
    stated = (BodyWeight(65.0, 0.1, 0.6), BodyWeight(65.0, 0.1, -0.6), BodyWeight(65.0, -2.6, 0.3))
    hubs = tuple(HubWeight(5.0, corner) for corner in Corner)
    real = AddedMass((replace(stated[0], x_m=0.15, y_m=0.57), *stated[1:], *hubs))
    states = (MASS_STATES[0], MassState("added", real))
    decays = tuple(r.decay(START_S) for r in paper_records(200.0, 80.0, 9, mass_states=states))
    sigma = noise_of(paper_records(200.0, 80.0, 9), 200.0)
    far = {}
    for sigma_m in (0.0, 0.03):
        known = AddedMass((replace(stated[0], position_sigma_m=sigma_m), *stated[1:], *hubs))
        box = GreyBox((GROUP,), (MASS_STATES[0], MassState("added", known)), None)
        best = fit(box, decays, sigma, box.unknowns(TRUTH))
        std = np.sqrt(np.diag(best.covariance))
        far[sigma_m] = np.abs(best.eta[:15] - np.log(TRUTH)) / std[:15]
    assert np.max(far[0.0]) > 6.0
    assert np.max(far[0.03]) < 3.5
    # 50 mm forward and 30 mm to the right.
    assert box.corrections == ("x of weight 1 of state added", "y of weight 1 of state added")
    np.testing.assert_allclose(box.deviations(best.eta), [0.05 / 0.03, -1.0], atol=0.35)


def test_a_fit_ends_when_its_next_step_would_be_too_small() -> None:
    records = paper_records(200.0, 30.0, 3)
    decays, level = tuple(r.decay(START_S) for r in records), noise_of(records, 200.0)
    start = BOX.unknowns(1.02 * TRUTH)
    exact = fit(BOX, decays, level, start, tolerance=1e-9)
    usual = fit(BOX, decays, level, start, tolerance=1e-3)
    # Its last step is larger than the tolerance, and what is left to go far smaller.
    assert usual.converged
    assert usual.iterations == 3
    left = np.abs(usual.eta - exact.eta) / np.sqrt(np.diag(exact.covariance))
    assert np.max(left) < 1e-4


# From wherever the search begins, it ends at the optimum -----------------------------------------

STARTS = 10
"""Of the 200 that `tests.benchmarks.identify` tries."""
FACTOR = 3.0


@pytest.mark.parametrize(("damping", "order"), [(1.0, 3), (8.0, 2)])
def test_the_gradient_is_minus_half_the_slope_of_the_cost(damping: float, order: int) -> None:
    """Also for wheels that creep back instead of swinging, behind low-passes, late by a sigma.

    That of a run, of the facts and of the stated uncertainties, by central differences.
    """
    groups = tuple(
        replace(
            group,
            channels=tuple(
                replace(c, low_pass_hz=20.0, low_pass_order=order, delay_sigma_s=1e-3)
                for c in group.channels
            ),
        )
        for group in SENSOR_SETS["all"]
    )
    campaign = Campaign(noise_db=40.0, groups=groups)
    weights = AddedMass((BodyWeight(65.0, 0.1, 0.6, sigma_kg=3.0, position_sigma_m=0.02),))
    states = (MASS_STATES[0], MassState("added", weights))
    box = GreyBox(groups, states, None, facts=(Fact("total_mass_kg", 1500.0, 5.0),))
    (record,) = records_of(campaign, 1)[5:]
    decays = (record.decay(START_S).thinned(50.0),)
    sigma = {c.name: 1e-3 for group in groups for c in group.channels}
    theta = TRUTH.copy()
    theta[9:11] *= damping
    rng = np.random.default_rng(1)
    eta = box.unknowns(theta)
    eta = eta + np.minimum(0.05, box.prior_sigma) * rng.standard_normal(len(eta))
    here = LinearEngine(box).normal_blocks(decays, sigma, eta)
    assert set(here) == {record.label, FACTS, PRIORS}
    steps = 1e-3 * np.diag(np.minimum(1.0, box.prior_sigma))
    for unknown, step in enumerate(steps):
        up, down = (
            LinearEngine(box).normal_blocks(decays, sigma, eta + side * step)
            for side in (1.0, -1.0)
        )
        for part, block in here.items():
            slope = (up[part].cost - down[part].cost) / (2.0 * step[unknown])
            tolerance = 1e-4 * abs(up[part].cost)
            assert -2.0 * block.gradient[unknown] == pytest.approx(slope, rel=1e-4, abs=tolerance)


def test_any_start_within_a_factor_three_on_all_parameters_leads_to_the_optimum() -> None:
    records = paper_records(200.0, 30.0, 11)
    decays = tuple(r.decay(0.3 + 1e-9) for r in records)
    sigma = noise_of(records, 200.0)
    best = fit(BOX, decays, sigma, BOX.unknowns(TRUTH))
    std = np.sqrt(np.diag(best.covariance))
    assert np.max(np.abs(best.eta - np.log(TRUTH)) / std) < 4.0
    rng = np.random.default_rng(7)
    for _ in range(STARTS):
        start = TRUTH * FACTOR ** rng.uniform(-1.0, 1.0, len(TRUTH))
        found = fit(BOX, decays, sigma, BOX.unknowns(start), hold=HOLD)
        assert found.converged
        assert np.max(np.abs(found.eta - best.eta) / std) < 0.01


# Where a decay begins, and what its noise is ------------------------------------------------------


def _sigmas(result: Estimation) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(np.diag(result.fit.covariance)) * 100)


def _cut(record: Record, start_s: float) -> Record:
    return replace(record, recordings=tuple(r.between(start_s, 9.0) for r in record.recordings))


@pytest.mark.parametrize(
    ("noise_db", "bump_s", "latest_s", "is_later"),
    [
        (30.0, 0.2, 0.3011, False),
        (30.0, np.nan, 0.31, False),
        # In truth 0.2 s: the first 40 ms of the "decay" are still forced.
        (50.0, 0.15, 0.31, True),
    ],
    ids=["stated", "unknown", "longer than stated"],
)
def test_a_decay_begins_where_the_bump_ends(
    noise_db: float, bump_s: float, latest_s: float, is_later: bool
) -> None:
    records = paper_records(1000.0, noise_db, 4, bump_s=bump_s)
    result = estimate(BOX, records, generic_vehicles())
    assert all(0.2999 < decay.start_s < latest_s for decay in result.decays)
    assert (result.later_s > 0.0) is is_later
    assert result.rest
    assert result.holds
    assert np.all(np.abs(_errors_percent(result.fit.eta)) < 4 * _sigmas(result))


def test_without_accelerations_of_wheels_a_force_shows_late() -> None:
    groups = SENSOR_SETS["imu+travels"]
    records = records_of(Campaign(500.0, 40.0, groups=groups), 1)
    result = estimate(GreyBox(groups, MASS_STATES, None), records, generic_vehicles())
    assert all(0.3 < decay.start_s < 0.311 for decay in result.decays)
    assert np.all(np.abs(_errors_percent(result.fit.eta[:15])) < 4 * _sigmas(result)[:15])


def test_decays_without_a_quiet_stretch_take_the_noise_from_the_residuals() -> None:
    records = [_cut(r, 0.301) for r in paper_records(200.0, 30.0, 7, bump_s=np.nan)]
    result = estimate(BOX, records, generic_vehicles())
    assert not result.rest
    assert result.chi2_per_n == pytest.approx(1.0, abs=0.1)
    assert np.all(np.abs(_errors_percent(result.fit.eta)) < 4 * _sigmas(result))


# Sensors that share nothing: each its own rate, jittered instants, samples lost ------------------

Array = NDArray[np.float64]
CHANNELS = stress_channels()
RATES_HZ = (200.0, 100.0, 125.0, 250.0, 190.0, 160.0, 220.0)
JITTER = 0.3
"""Of the sampling period, to either side."""
LOST = 0.01
REST_S, BUMP_S, RUN_S = 0.6, 0.2, 3.3


@cache
def _motion(state: str, excitation: Excitation) -> Moving:
    car = load_car(FORD_GRANADA, ADDED_MASS[state])
    return car.drive(Bump(excitation, 0.05, REST_S, BUMP_S), RUN_S)


@cache
def _clean(channel: Channel, rate_hz: float, state: str, excitation: Excitation) -> Array:
    """Return jittered instants and what forces alone make of them, (2, n)."""
    rng = np.random.default_rng(round(rate_hz))
    tick = np.arange(1.0, (RUN_S - 0.02) * rate_hz)
    t_s = (tick + rng.uniform(-JITTER, JITTER, len(tick))) / rate_hz
    unloaded = load_car(FORD_GRANADA, ADDED_MASS[BASELINE])
    reading = true_reading(
        channel,
        SensorTruth(channel.x_m, channel.y_m, delay_s=0.0, bias=0.0),
        unloaded,
        _motion(state, excitation).at(t_s),
    )
    return np.stack([t_s, reading])


def _samples(
    channel: Channel, rate_hz: float, state: str, excitation: Excitation, rng: Generator
) -> tuple[Array, Array]:
    t_s, reading = _clean(channel, rate_hz, state, excitation)
    sensor = SensorTruth(channel.x_m, channel.y_m, delay_s=0.0, bias=0.0)
    values = measured(channel, sensor, NOISE, reading, rng)
    kept = rng.uniform(size=len(t_s)) > LOST
    return t_s[kept], values[kept]


def _session(seed: int) -> Session:
    rng = np.random.default_rng(seed)
    runs: list[ArrayRun] = [
        (
            state,
            excitation.value,
            {
                channel.name: _samples(channel, rate_hz, state, excitation, rng)
                for channel, rate_hz in zip(CHANNELS, RATES_HZ, strict=True)
            },
        )
        for state in (BASELINE, ADDED)
        for excitation in THREE
    ]
    return session_from_arrays(runs, CHANNELS, ADDED_MASS[ADDED], bump_s=BUMP_S)


@pytest.mark.parametrize(
    ("campaigns", "most", "held"),
    [(1, 3.0, (0.8, 1.0)), pytest.param(12, 1.6, (0.90, 0.99), marks=pytest.mark.long)],
)
def test_intervals_cover_whatever_the_clocks_do(
    campaigns: int, most: float, held: tuple[float, float]
) -> None:
    errors, stated = [], []
    for seed in range(campaigns):
        session = _session(seed)
        records = usable(session).records
        assert len(records[0].recordings) == len(CHANNELS)  # no clock is shared
        result = fitted(session)
        assert result.fit.converged
        assert result.holds
        errors.append(np.exp(result.fit.eta[:15]) / TRUTH - 1.0)
        stated.append(np.sqrt(np.diag(result.fit.covariance))[:15])
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    bound = np.mean(stated, axis=0)
    assert np.all(rms < most * bound)
    assert np.max(bound) < 0.03
    assert held[0] < np.mean(np.abs(errors) < 1.96 * np.array(stated)) <= held[1]
