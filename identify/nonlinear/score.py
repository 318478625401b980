"""Gain of freeing each unknown that is still held, to first order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .fit import Optimum, inverse, reduced
from .path import travel_speeds
from .problem import Point, Problem, point

_SEPARATE = 1e-10
"""Share of an unknown's information that the free ones must leave for it to count as separate."""


def gain_of(
    problem: Problem, best: Optimum, eta: NDArray[np.float64], extra: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the fall of the cost with each further unknown free, and the size of that unknown.

    Parameters
    ----------
    problem : Problem
        Problem of the optimum.
    best : Optimum
        Optimum of the free unknowns.
    eta : (P,) float64
        All unknowns: those of the optimum, except for some that do not act yet.
    extra : (k,) intp
        Positions of the further ones, none of them free.

    Returns
    -------
    gains, sizes : (k,) float64
        Each with one unknown alone; zeros where path or tangents are not finite, or where the free
        unknowns have the same effect.
    """
    known = best.point.problem.free
    free = np.union1d(known, extra)
    at = point(problem.releasing(free), eta, best.point.initials, best.point.grade)
    if at is None or not at.normal.finite:
        return np.zeros(len(extra)), np.zeros(len(extra))
    matrix, right, _ = reduced(at.normal, 0.0)
    new, old = np.searchsorted(free, extra), ~np.isin(free, extra)
    cross = matrix[np.ix_(new, old)] @ inverse(matrix[np.ix_(old, old)])
    alone = np.diag(matrix[np.ix_(new, new)])
    left = alone - np.einsum("ij,ji->i", cross, matrix[np.ix_(old, new)])
    push = right[new] - cross @ right[old]
    separate = left > _SEPARATE * alone
    size = np.divide(push, left, out=np.zeros(len(extra)), where=separate)
    return push * size, size


# Covariance that holds where a little is unexplained: from the scatter of the scores --------------
#
# Where the model leaves motion unexplained, residuals are neither white nor as small as the noise.
# The scatter of the scores, correlated over `LAG_S`, shows how far the estimate may be off
# (heteroscedasticity and autocorrelation consistent covariance, Newey and West 1987).

LAG_S = 0.2
"""Longest time, s, over which residuals may be correlated: two periods of the wheels."""
_BIN_S = 0.005


def scatter(at: Point) -> NDArray[np.float64]:
    """Return the covariance of the scores, (F, F), by Bartlett's window of `LAG_S`."""
    size = len(at.problem.free)
    total = np.zeros((size, size))
    lags = round(LAG_S / _BIN_S)
    for run, predicted, b in zip(at.problem.runs, at.predicted, at.normal.blocks, strict=True):
        own = len(b.A)
        through = inverse(b.A) @ b.B
        bins = int(run.end_s / _BIN_S) + 2
        scores = np.zeros((bins, size))
        for r, left, J in zip(run.decay.recordings, predicted.left, b.jacobian, strict=True):
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


# Finds the gap at which the bump stop of each axle begins in a fit --------------------------------

_STOOD_IN = ("k_2", "k_3")
"""Unknowns that imitate an axle's stop while it is missing.  They begin again at zero when it
joins: from a spring stiffened as much as the missing stop required, the search did not return in 40
steps; from zero it needs 4 to 8."""
_SHARES = (0.97, 0.93, 0.86, 0.77, 0.66, 0.54, 0.42, 0.3)
"""Gaps at which a bump stop is tried, in shares of the axle's largest compression: the cost of a
stop that is not touched has no slope by its gap, and a fit does not reach a gap of 40 mm from 33
mm while a progressive spring imitates the stop."""
_SHORTEST_M = 0.01
"""Compression that is assumed at least: a gap has no logarithm at zero."""
_LARGEST_RATE = 1.5
"""Rate, 1e5 N/m, that a bump stop begins with at most."""


def begin_stops(best: Optimum, log: Callable[[str], None]) -> NDArray[np.float64] | None:
    """Return the unknowns, (P,), with each axle's bump stop where it would lower the cost most.

    None where no stop would lower it by more than chance.  `log`: receives a line.
    """
    problem = best.point.problem
    names = problem.model.names
    n = sum(run.freedom for run in problem.runs)
    rates = np.array([names.index(f"k_b{axle}") for axle in "fr"])
    gaps = np.array([names.index(f"g_b{axle}") for axle in "fr"])
    largest = _largest_compressions(best.point)
    result = best.eta.copy()
    most = np.full(2, 2.0 * np.log(n) * max(1.0, best.cost / n))
    for share in _SHARES:
        tried = best.eta.copy()
        tried[gaps] = np.log(share * largest)
        gains, sizes = gain_of(problem, best, tried, rates)
        for i, axle in enumerate("fr"):
            if sizes[i] > 0.0 and gains[i] > most[i]:
                most[i] = gains[i]
                result[gaps[i]] = tried[gaps[i]]
                result[rates[i]] = min(sizes[i], _LARGEST_RATE)
                result[[names.index(f"{kind}{axle}") for kind in _STOOD_IN]] = 0.0
    begun = [f"{1e3 * np.exp(result[gaps[i]]):.0f} mm" for i in np.flatnonzero(result[rates])]
    log(f"bump_stops: begin at {', '.join(begun) or 'nothing'}")
    return result if begun else None


def _largest_compressions(at: Point) -> NDArray[np.float64]:
    """Return the largest compression of the front and the rear suspensions in all runs, (2,) m."""
    corners = [
        travel_speeds(car, run.path.states, 0).max(axis=0)
        for car, run in zip(at.cars, at.predicted, strict=True)
    ]
    front_rear = np.max(corners, axis=0).reshape(2, 2).max(axis=1)
    return np.asarray(np.maximum(front_rear, _SHORTEST_M))
