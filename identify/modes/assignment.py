"""Pairs the entries of two lists, each at most once, with the largest sum of values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def best_pairs(worth: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of the pairs with the largest sum, (min(n, m),) each.

    `worth`: value of each pair, (n, m).
    """
    if worth.size and len(worth) <= worth.shape[1]:
        columns = np.argmax(worth, axis=1)
        # Where no two rows want the same column, nothing can be worth more.
        if len(set(columns.tolist())) == len(columns):
            return np.arange(len(worth)), columns
    from scipy.optimize import linear_sum_assignment  # a third of a second to import

    rows, columns = linear_sum_assignment(worth, maximize=True)
    return rows, columns
