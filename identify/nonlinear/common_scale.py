"""Finds the common factor of all masses and forces, which the motion does not show.

If all masses, inertias, springs, dampers and friction of a car and of the weights on it are larger
by one factor, it moves as before: only stated weights and facts determine the factor.  A search
creeps along this curved valley in steps of 0.1 % (a formula car stayed 10 % too light, with weights
36 standard deviations off, and 25 steps in a row promised to lower the cost by 3600).  Because the
valley is known, the functions here go to its lowest point at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..fit.grey_box import SIGNED, GreyBox
from .problem import Problem

LENGTHS = ("a", "b", "t_f", "t_r", "y_s")
"""Parameters that a common factor of masses and forces does not change."""
_WIDEST = 1.5
"""Logarithm of the largest factor that is tried."""
_FINE = 1e-5
"""Precision of the logarithm of the factor: finer than any known scale."""
_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


def scaled(box: GreyBox, linear: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Return unknowns of a grey box, (P,), with its masses and forces times a factor."""
    result = linear.copy()
    for i, name in enumerate(box.parameters):
        if name in SIGNED and name not in LENGTHS:
            result[i] *= factor
        elif name not in LENGTHS:
            result[i] += np.log(factor)
    return result


def all_scaled(problem: Problem, eta: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Return all unknowns, (P,), with car and weights times a factor: the motion stays the same."""
    model = problem.model
    box = model.box
    result = eta.copy()
    result[: model.first] = scaled(box, eta[: model.first], factor)
    for i, kg in box.weight_masses.items():
        result[i] = factor * (kg + eta[i]) - kg
    if model.names[model.first - 1] == "cross weight":
        result[model.first - 1] *= factor
    for i, element in enumerate(model.elements, start=model.first):
        if element.unit.startswith("N"):
            result[i] *= factor
        elif element.unit.endswith("/N"):
            result[i] /= factor
    return result


def at_likely_scale(problem: Problem, eta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unknowns, (P,), times the factor that weights, facts and priors make most likely.

    They are unchanged where a weight is held at its stated value, because it then holds the factor,
    too.
    """
    box = problem.model.box
    weights = sum(len(state.added.weights) for state in box.mass_states)
    if len(np.intersect1d(list(box.weight_masses), problem.free)) < weights:
        return eta

    def cost(s: float) -> float:
        there = all_scaled(problem, eta, float(np.exp(s)))
        terms = (problem.fact_terms(there)[0], problem.prior_terms(there)[0])
        return sum(float(misfits @ misfits) for misfits in terms)

    low, high = -_WIDEST, _WIDEST
    inner = [high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)]
    costs = [cost(s) for s in inner]
    while high - low > _FINE:
        if costs[0] < costs[1]:
            high, inner[1], costs[1] = inner[1], inner[0], costs[0]
            inner[0] = high - _GOLDEN * (high - low)
            costs[0] = cost(inner[0])
        else:
            low, inner[0], costs[0] = inner[0], inner[1], costs[1]
            inner[1] = low + _GOLDEN * (high - low)
            costs[1] = cost(inner[1])
    best = 0.5 * (low + high)
    return all_scaled(problem, eta, float(np.exp(best))) if cost(best) < cost(0.0) else eta
