"""Sensors that share nothing: each its own rate, jittered instants, samples lost."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.random import Generator
from numpy.typing import NDArray

from daq.arrays import ArrayRun, session_from_arrays
from daq.channels import Channel
from daq.runs import ADDED, BASELINE, Excitation
from daq.sessions import Session
from daq.sim.car import NOISE, SensorTruth, SimulatedCar
from daq.sim.motion import Bump, Motion, drive
from daq.sim.plant import load_car
from daq.sim.sensors import install, measured, true_reading
from daq.vehicle import FORD_GRANADA
from identify.decays.usable import usable
from identify.fit.estimation import estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.pipeline import grey_box

from ..bumps import TRUTH
from ..stress import ADDED_MASS, THREE, stress_channels

Array = NDArray[np.float64]
CHANNELS = stress_channels()
RATES_HZ = (200.0, 100.0, 125.0, 250.0, 190.0, 160.0, 220.0)
JITTER = 0.3
"""Of the sampling period, to either side."""
LOST = 0.01
REST_S, BUMP_S, RUN_S = 0.6, 0.2, 3.3


@cache
def _motion(state: str, excitation: Excitation) -> Motion:
    car = load_car(FORD_GRANADA, ADDED_MASS[state])
    return drive(car, Bump(excitation, 0.05, REST_S, BUMP_S), RUN_S)


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
        install(unloaded, SimulatedCar()),
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
    [(3, 2.2, (0.85, 1.0)), pytest.param(12, 1.6, (0.90, 0.99), marks=pytest.mark.long)],
)
def test_intervals_cover_whatever_the_clocks_do(
    campaigns: int, most: float, held: tuple[float, float]
) -> None:
    errors, stated = [], []
    for seed in range(campaigns):
        session = _session(seed)
        records = usable(session).records
        assert len(records[0].recordings) == len(CHANNELS)  # no clock is shared
        box = grey_box(session, records)
        result = estimate(box, records, generic_vehicles())
        assert result.fit.converged
        assert result.holds
        errors.append(np.exp(result.fit.eta[:15]) / TRUTH - 1.0)
        stated.append(np.sqrt(np.diag(result.fit.covariance))[:15])
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    bound = np.mean(stated, axis=0)
    assert np.all(rms < most * bound)
    assert np.max(bound) < 0.03
    assert held[0] < np.mean(np.abs(errors) < 1.96 * np.array(stated)) <= held[1]
