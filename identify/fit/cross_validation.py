"""Predicts each run from all the others."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decays.decay import FreeDecay, quiet_counts
from .estimation import Estimation
from .likelihood import Residuals, covariance_of
from .uncertainty import determined
from .varpro import NormalBlock

_LIMIT_SIGMAS = 5.0
"""Standard deviations of a run's chi2/n beyond which its prediction leaves more than noise."""
_SAYS_NOTHING = 1e-9
"""Relative fall of a variance by a run below which the run says nothing of the parameter."""
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
    if len(estimation.decays) < 2:
        return ()
    fit = estimation.fit
    blocks = estimation.engine.normal_blocks(estimation.decays, estimation.sigma, fit.eta)
    whole = np.sum([block.information for block in blocks.values()], axis=0)
    return tuple(
        _predicted_run(estimation, decay, residuals, blocks[decay.label], whole)
        for decay, residuals in zip(estimation.decays, estimation.residuals, strict=True)
    )


def _predicted_run(
    estimation: Estimation,
    decay: FreeDecay,
    residuals: Residuals,
    block: NormalBlock,
    whole: NDArray[np.float64],
) -> Prediction:
    """Predict a run from all the others.

    `residuals`, `block`: those of the run in the fit of all.  `whole`, (P, P): information of all
    runs, facts and stated uncertainties.
    """
    box, fit, noise = estimation.box, estimation.fit, estimation.noise
    of_others = covariance_of(whole - block.information)
    freedom = sum(residuals.freedom.values())
    fitted = _chi2(residuals.values, noise) / freedom
    finite = np.where(np.isfinite(of_others), of_others, 0.0)
    step = -finite @ block.gradient
    # Over a step that the others do not determine the problem is not linear, nor finite.
    without = None
    if determined(box, of_others).all():
        with suppress(FloatingPointError):
            eta = fit.eta + step
            (without,) = estimation.engine.residuals((decay,), estimation.sigma, eta)
    if without is None:
        return Prediction(decay.label, fitted, np.nan, np.nan, "", np.nan)
    predicted = _chi2(without.values, noise) / freedom
    quiet = sum(quiet_counts(estimation.records).values()) if estimation.rest else 0
    spread = 2.0 / freedom + 2.0 / (quiet or freedom)
    by_parameters = float(np.trace(finite @ block.information)) / freedom
    limit = 1.0 + by_parameters + max(_LEAST_EXCESS, _LIMIT_SIGMAS * float(np.sqrt(spread)))
    # Parameters from fewer runs differ from those from all runs by the difference of the variances.
    n = len(box.parameters)
    gain = np.diag(finite)[:n] - np.diag(fit.covariance)[:n]
    moves = step[:n] / np.sqrt(np.maximum(gain, 1e-300))
    moves[gain <= _SAYS_NOTHING * np.diag(finite)[:n]] = 0.0
    most = int(np.argmax(np.abs(moves)))
    parameter, moved = box.parameters[most], float(moves[most])
    return Prediction(decay.label, fitted, predicted, limit, parameter, moved)


def _chi2(values: Mapping[str, NDArray[np.float64]], noise: Mapping[str, float]) -> float:
    """Return the squared residuals in units of the noise, summed over all channels."""
    return sum(float(column @ column) / noise[name] ** 2 for name, column in values.items())
