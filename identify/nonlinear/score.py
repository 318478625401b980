"""Gain of freeing each unknown that is still held, to first order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .fit import Optimum, inverse, reduced
from .problem import Problem, normal, point

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
    equations = None if at is None else normal(at)
    if equations is None or not equations.finite:
        return np.zeros(len(extra)), np.zeros(len(extra))
    matrix, right, _ = reduced(equations, 0.0)
    new, old = np.searchsorted(free, extra), ~np.isin(free, extra)
    cross = matrix[np.ix_(new, old)] @ inverse(matrix[np.ix_(old, old)])
    alone = np.diag(matrix[np.ix_(new, new)])
    left = alone - np.einsum("ij,ji->i", cross, matrix[np.ix_(old, new)])
    push = right[new] - cross @ right[old]
    separate = left > _SEPARATE * alone
    size = np.divide(push, left, out=np.zeros(len(extra)), where=separate)
    return push * size, size
