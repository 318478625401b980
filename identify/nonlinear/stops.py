"""Finds the gap at which the bump stop of each axle begins in a fit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .fit import Optimum
from .path import travel_speeds
from .problem import Point
from .score import gain_of

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
