"""Gain of freeing each unknown that is still held, to first order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .fit import Optimum, inverse, reduced
from .problem import Problem, normal, point

_SEPARATE = 1e-10
"""Share of an unknown's information, beside that of the free ones, below which it has none."""


def gain_of(
    problem: Problem, best: Optimum, eta: NDArray[np.float64], extra: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by how much the cost would fall with each further unknown free, and its size.

    Parameters
    ----------
    problem : Problem
        Of the optimum.
    best : Optimum
        Where the free unknowns are.
    eta : (P,) float64
        All unknowns: those of the optimum, but for ones that do not act yet.
    extra : (k,) intp
        Positions of the further ones, none of them free.

    Returns
    -------
    gains, sizes : (k,) float64
        Each for one of them alone; zeros where path or tangents are not finite, or where the
        free unknowns do the same.
    """
    known = best.point.problem.free
    free = np.union1d(known, extra)
    at = point(problem.releasing(free), eta, best.point.owns, best.point.grade)
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
