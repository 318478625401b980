"""Covariance that holds where a little is unexplained: from the scatter of the scores.

Where the model leaves motion unexplained, residuals are neither white nor as small as the noise.
The scatter of the scores, correlated over `LAG_S`, shows how far the estimate may be off
(heteroscedasticity and autocorrelation consistent covariance, Newey and West 1987).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .fit import inverse
from .problem import Normal, Point

LAG_S = 0.2
"""Longest time, s, over which residuals may be correlated: two periods of the wheels."""
_BIN_S = 0.005


def scatter(at: Point, equations: Normal) -> NDArray[np.float64]:
    """Return the covariance of the scores, (F, F), by Bartlett's window of `LAG_S`."""
    size = len(at.problem.free)
    total = np.zeros((size, size))
    lags = round(LAG_S / _BIN_S)
    for run, found, b in zip(at.problem.runs, at.predicted, equations.blocks, strict=True):
        own = len(b.A)
        through = inverse(b.A) @ b.B
        bins = int(run.end_s / _BIN_S) + 2
        scores = np.zeros((bins, size))
        for r, left, J in zip(run.decay.recordings, found.left, b.jacobian, strict=True):
            reduced = J[:, :, own:] - J[:, :, :own] @ through
            which = np.clip((r.time_s / _BIN_S).astype(int), 0, bins - 1)
            np.add.at(scores, which, np.einsum("ncf,nc->nf", reduced, left))
        total += scores.T @ scores
        for lag in range(1, min(lags + 1, bins)):
            part = (1.0 - lag / (lags + 1.0)) * (scores[lag:].T @ scores[:-lag])
            total += part + part.T
    return total


def widened(covariance: NDArray[np.float64], scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the covariance with each standard deviation at least that from the scores' scatter."""
    robust = np.diag(covariance @ scores @ covariance)
    plain = np.diag(covariance)
    factor = np.sqrt(np.maximum(robust / np.maximum(plain, 1e-300), 1.0))
    return np.asarray(covariance * np.outer(factor, factor))
