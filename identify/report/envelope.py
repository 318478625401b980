"""Thins curves for drawing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def envelope(
    time_s: NDArray[np.float64], values: NDArray[np.float64], bins: int
) -> NDArray[np.float64]:
    """Keep the lowest and highest point of each of `bins` stretches, so that no spike is hidden.

    Parameters
    ----------
    time_s, values : (n,) float64
        The curve.
    bins : int
        Number of stretches; a curve of no more than two points in each is kept as it is.

    Returns
    -------
    (2, m) float64
        Times over values, m <= max(2 bins, n).
    """
    n = len(values)
    if n <= 2 * bins:
        return np.stack([time_s, values])
    edges = np.linspace(0, n, bins + 1).astype(int)
    stretch = np.repeat(np.arange(bins), np.diff(edges))
    lowest, highest = (f.reduceat(values, edges[:-1])[stretch] for f in (np.minimum, np.maximum))
    kept = (np.flatnonzero(values == extreme) for extreme in (lowest, highest))
    chosen = np.union1d(*(at[np.unique(stretch[at], return_index=True)[1]] for at in kept))
    return np.stack([time_s[chosen], values[chosen]])
