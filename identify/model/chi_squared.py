"""Chi-squared distribution of whole degrees of freedom, in closed form.

`scipy.special` has it too, but would take as long to import as the fit of a session takes.
"""

from __future__ import annotations

from functools import cache
from math import erfc, exp, lgamma, log, sqrt

_SAME = 1e-13
"""Relative change below which a step of Newton's method is the last."""


@cache
def exceeded_by_chance(freedom: int, chance: float) -> float:
    """Return the value that a chi-squared variable exceeds with a given probability.

    `freedom`: degrees of freedom, at least 1.  `chance`: at most 1/20.
    """
    rarity = -log(chance)
    # A bound from above (Laurent and Massart).  The logarithm of the tail is concave, nearly so for
    # one degree, and Newton's method comes down from there without a step too far.
    value = freedom + 2.0 * sqrt(freedom * rarity) + 2.0 * rarity
    while True:
        density, tail = _density_and_tail(freedom, value)
        step = (log(tail) + rarity) * tail / density
        value += step
        if abs(step) <= _SAME * value:
            return value


def chance_of_more(freedom: int, value: float) -> float:
    """Return the probability that a chi-squared variable is more than a value."""
    if value > freedom:
        return _density_and_tail(freedom, value)[1]
    # Where the tail is nearly 1, the part before it is summed instead.
    half, power, before = value / 2.0, freedom / 2.0, 0.0
    term = exp(power * log(half) - half - lgamma(power + 1.0)) if value > 0.0 else 0.0
    while term > _SAME * before:
        before += term
        power += 1.0
        term *= half / power
    return 1.0 - before


def _density_and_tail(freedom: int, value: float) -> tuple[float, float]:
    """Return the probability density at a value above the mean, and the probability of more."""
    half, power = value / 2.0, freedom / 2.0 - 1.0
    term = exp(power * log(half) - half - lgamma(power + 1.0))
    density, tail = term / 2.0, erfc(sqrt(half)) if freedom % 2 else 0.0
    while power > -0.5:
        tail += term
        term *= power / half
        power -= 1.0
    return density, tail
