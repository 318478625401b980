"""Predicts each run from all the others."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decays.onset import quiet_counts
from .estimation import Estimation
from .likelihood import covariance_of
from .uncertainty import determined

_LIMIT_SIGMAS = 5.0
_LEAST_EXCESS = 0.05
"""Excess of chi2/n that clocks fitted to arrival times and quantisation may cause in one run."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """A run left out of the fit and predicted by it."""

    label: str
    """Label of the run."""
    fitted: float
    """chi2/n of the run in the fit of all runs."""
    predicted: float
    """chi2/n with the parameters of all other runs and the run's own initial state and sensor
    offsets; NaN if the others do not determine the parameters."""
    limit: float
    """Upper limit of `predicted` if the model holds."""
    parameter: str
    """Parameter that moves most when the run is left out; empty if that is not known."""
    moved: float
    """Shift of that parameter, in its standard deviations."""

    @property
    def at_noise(self) -> bool:
        """True if the prediction leaves no more than noise."""
        return self.predicted <= self.limit


def leave_one_out(estimation: Estimation) -> tuple[Prediction, ...]:
    """Predict every run from all the others.

    The optimum without a run is one Gauss-Newton step from the optimum of all: what is left out
    moves the unknowns by a fraction of their standard deviation, over which the problem is linear.

    One prediction for each run; none if there is but one run.
    """
    box, fit, sigma = estimation.box, estimation.fit, estimation.sigma
    noise = estimation.noise
    if len(estimation.decays) < 2:
        return ()
    engine = estimation.engine
    parts = engine.normal_blocks(estimation.decays, sigma, fit.eta)
    whole = np.sum([part.information for part in parts.values()], axis=0)
    quiet = sum(quiet_counts(estimation.records).values()) if estimation.rest else 0
    n = len(box.parameters)
    result = []
    for decay, own in zip(estimation.decays, estimation.residuals, strict=True):
        part = parts[decay.label]
        covariance = covariance_of(whole - part.information)
        freedom = sum(own.freedom.values())
        fitted = _chi2(own.values, noise) / freedom
        kept = np.where(np.isfinite(covariance), covariance, 0.0)
        step = -kept @ part.gradient
        # Over a step that the others do not determine the problem is not linear, nor finite.
        left = None
        if determined(box, covariance).all():
            with suppress(FloatingPointError):
                (left,) = engine.residuals((decay,), sigma, fit.eta + step)
        if left is None:
            result.append(Prediction(decay.label, fitted, np.nan, np.nan, "", np.nan))
            continue
        spread = 2.0 / freedom + 2.0 / (quiet or freedom)
        unsure = float(np.trace(kept @ part.information)) / freedom
        limit = 1.0 + unsure + max(_LEAST_EXCESS, _LIMIT_SIGMAS * float(np.sqrt(spread)))
        # Parameters from fewer runs differ from those from all runs by the difference of the
        # variances.
        gain = np.diag(kept)[:n] - np.diag(fit.covariance)[:n]
        moves = step[:n] / np.sqrt(np.maximum(gain, 1e-300))
        moves[gain <= 1e-9 * np.diag(kept)[:n]] = 0.0  # the run says nothing of it
        most = int(np.argmax(np.abs(moves)))
        predicted = _chi2(left.values, noise) / freedom
        result.append(
            Prediction(
                decay.label, fitted, predicted, limit, box.parameters[most], float(moves[most])
            )
        )
    return tuple(result)


def _chi2(values: Mapping[str, NDArray[np.float64]], noise: Mapping[str, float]) -> float:
    return sum(float(column @ column) / noise[name] ** 2 for name, column in values.items())
