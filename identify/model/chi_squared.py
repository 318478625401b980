"""Chi-squared distribution of whole degrees of freedom, in closed form.

`scipy.special` has it too, but would take as long to import as the fit of a session takes.
"""

from __future__ import annotations

from functools import cache
from math import erfc, exp, lgamma, log, sqrt


@cache
def exceeded_by_chance(freedom: int, chance: float) -> float:
    """Return the value that a chi-squared variable exceeds with a given probability.

    `freedom`: degrees of freedom, at least 1.  `chance`: at most 1/20.
    """
    minus_log_chance = -log(chance)
    # A bound from above (Laurent and Massart).  The logarithm of the tail is concave, nearly so for
    # one degree, and Newton's method comes down from there without a step too far.
    value = step = freedom + 2.0 * sqrt(freedom * minus_log_chance) + 2.0 * minus_log_chance
    while abs(step) > 1e-13 * value:  # some rounding errors
        tail = chance_of_more(freedom, value)
        density = exp(_log_term(freedom / 2.0 - 1.0, value / 2.0)) / 2.0
        step = (log(tail) + minus_log_chance) * tail / density
        value += step
    return value


def chance_of_more(freedom: int, value: float) -> float:
    """Return the probability that a chi-squared variable is more than a value."""
    if value <= 0.0:
        return 1.0
    powers = [freedom / 2.0 - 1.0 - k for k in range(freedom // 2)]
    odd_term = erfc(sqrt(value / 2.0)) if freedom % 2 else 0.0
    return odd_term + sum(exp(_log_term(power, value / 2.0)) for power in powers)


def _log_term(power: float, half: float) -> float:
    """Return the logarithm of ``exp(-half) half^power / gamma(power + 1)``, a term of the tail."""
    return power * log(half) - half - lgamma(power + 1.0)
