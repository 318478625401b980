"""Finds sessions whose parameters lie apart from those of the other sessions of their vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_LEAST = 5
"""Least number of sessions of a vehicle to know its usual value."""
_APART = 3.5
"""Standard deviations, robust, beyond which a value counts as apart (Iglewicz and Hoaglin 1993)."""
_SIGMA_OF_MAD = 1.4826
"""Standard deviation of a normal variable whose median absolute deviation is 1."""


@dataclass(frozen=True, slots=True)
class Outlier:
    """One parameter of one session."""

    row: int
    parameter: int
    usual: float
    """Median of the vehicle's sessions, SI."""
    apart: float
    """Distance from the median in standard deviations: scatter of the sessions and own
    uncertainty."""


def outliers(
    vehicles: Sequence[str], values: NDArray[np.float64], stds: NDArray[np.float64]
) -> list[Outlier]:
    """Return values that are apart, the farthest first.

    `vehicles`: vehicle of each row.  `values` and `stds`, (n, p): SI, NaN where a row does not
    count.
    """
    found = []
    names = np.array(vehicles, dtype=object)
    for vehicle in dict.fromkeys(vehicles):
        mine = np.flatnonzero(names == vehicle)
        for p in range(values.shape[1]):
            rows = mine[np.isfinite(values[mine, p])]
            if len(rows) < _LEAST:
                continue
            usual = float(np.median(values[rows, p]))
            away = values[rows, p] - usual
            scatter = _SIGMA_OF_MAD * float(np.median(np.abs(away)))
            size = np.hypot(scatter, np.nan_to_num(stds[rows, p]))
            apart = away / np.where(size > 0.0, size, np.inf)
            beyond = np.flatnonzero(np.abs(apart) > _APART)
            found += [Outlier(int(rows[i]), p, usual, float(apart[i])) for i in beyond]
    return sorted(found, key=lambda one: -abs(one.apart))
