"""The limit that chance seldom exceeds: upper quantile of the chi-squared distribution.

For whole degrees of freedom its tail is a finite sum of positive terms (Abramowitz and Stegun
26.4.4 and 26.4.5).  `scipy.special` has it as well, and takes as long to import as a fit takes.
"""

from __future__ import annotations

from functools import cache
from math import erfc, exp, lgamma, log, sqrt

_PRECISE = 1e-14
"""Relative step below which the search has ended."""


@cache
def upper_quantile(freedom: int, chance: float) -> float:
    """Return what the sum of `freedom` squared standard normal deviates exceeds with `chance`.

    Newton's method on the logarithm of the tail, which is nearly straight.
    """
    x = float(freedom)
    for _ in range(100):
        tail = _tail(freedom, x)
        density = exp(_log_term(freedom / 2.0 - 1.0, x / 2.0)) / 2.0
        step = tail / density * log(tail / chance)
        x = max(x + step, x / 2.0)
        if abs(step) <= _PRECISE * x:
            break
    return x


def _tail(freedom: int, x: float) -> float:
    """Return the chance that the sum exceeds `x`."""
    odd = freedom % 2
    first = erfc(sqrt(x / 2.0)) if odd else 0.0
    return first + sum(exp(_log_term(i + odd / 2.0, x / 2.0)) for i in range(freedom // 2))


def _log_term(power: float, y: float) -> float:
    return power * log(y) - y - lgamma(power + 1.0)
