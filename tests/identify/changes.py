"""Sessions of the paper's car before and after a change, each fitted from the truth on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES, VehicleParameters
from identify.decays.decay import FreeDecay, Record, Recording
from identify.fit.estimation import Estimation
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import LinearEngine, fit
from identify.model.matrices import PhysicalModel, delta_mass, physical_model
from identify.model.response import exact_response
from identify.modes.modal_model import sensor_rows
from identify.study.campaign import (
    BUMP,
    PAPER_CASES,
    PAPER_MASS_STATES,
    Campaign,
    box_of,
    noise_levels,
)

RATE_HZ = 100.0
START_S = 0.3 + 1e-9


@cache
def box(rate_hz: float) -> GreyBox:
    """Return the problem that every session poses."""
    return box_of(Campaign(rate_hz=rate_hz))


@cache
def sigma(rate_hz: float) -> dict[str, float]:
    """Return the noise of each channel, 30 dB below its motion."""
    return noise_levels(Campaign(rate_hz=rate_hz))


@cache
def clean(
    changed: tuple[tuple[str, float], ...], k_stray: float, rate_hz: float
) -> tuple[tuple[str, str, NDArray[np.float64], NDArray[np.float64]], ...]:
    """Return label, mass state, times and accelerations of the six runs of a changed car.

    `changed`: parameters, and by which share each is larger.  `k_stray`: a spring between the front
    wheels, N/m, that no parameter describes.
    """
    values = {name: getattr(FORD_GRANADA, name) * (1.0 + share) for name, share in changed}
    car: VehicleParameters = replace(FORD_GRANADA, **values)
    stray = np.zeros((7, 7))
    stray[3:5, 3:5] = k_stray * np.array([[1.0, -1.0], [-1.0, 1.0]])
    (group,) = Campaign(rate_hz=rate_hz).groups
    rows = sensor_rows(group.channels, car.geometry)
    runs = []
    for state in PAPER_MASS_STATES:
        bare = physical_model(car).with_mass(delta_mass(state.added, car.a).real)
        model = PhysicalModel(bare.M, bare.C, bare.K + stray)
        for case in PAPER_CASES:
            run = exact_response(model, case, BUMP, rate_hz, 2.0)
            runs.append((f"{state.name}_{case}", state.name, run.time_s, run.acceleration @ rows.T))
    return tuple(runs)


def session(
    changed: dict[str, float], seed: int, k_stray: float = 0.0, rate_hz: float = RATE_HZ
) -> Estimation:
    """Return the fit of a session of six runs of a changed car."""
    return _fitted(tuple(changed.items()), seed, k_stray, rate_hz)


@lru_cache(maxsize=64)
def _fitted(
    changed: tuple[tuple[str, float], ...], seed: int, k_stray: float, rate_hz: float
) -> Estimation:
    rng = np.random.default_rng(seed)
    problem, noise = box(rate_hz), sigma(rate_hz)
    (group,) = Campaign(rate_hz=rate_hz).groups
    level = np.array([noise[c.name] for c in group.channels])
    decays: list[FreeDecay] = []
    for label, state, time_s, values in clean(changed, k_stray, rate_hz):
        noisy = values + level * rng.standard_normal(values.shape)
        record = Record(label, state, BUMP.duration_s, (Recording(group, time_s, noisy),))
        decays.append(record.decay(START_S))
    shares = dict(changed)
    truth = FORD_GRANADA.to_array() * [1.0 + shares.get(name, 0.0) for name in PARAMETER_NAMES]
    found = fit(problem, tuple(decays), noise, problem.unknowns(truth))
    left = LinearEngine(problem).residuals(tuple(decays), noise, found.eta)
    freedom = sum(sum(one.freedom.values()) for one in left) - len(truth)
    chi2 = found.cost / freedom
    return Estimation(problem, (), found, tuple(decays), noise, {}, left, chi2)
