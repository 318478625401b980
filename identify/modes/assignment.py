"""Who goes with whom: the assignment whose likenesses add up to most.

By shortest augmenting paths (Kuhn, Munkres): the few modes of a vehicle take less time than the
import of a library that does it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def best_pairs(likeness: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows, ascending, and columns so that the sum of their likeness is largest.

    `likeness`: shape (n, m); each of the shorter side gets a partner.
    """
    if likeness.shape[0] > likeness.shape[1]:
        columns, rows = best_pairs(likeness.T)
        order = np.argsort(rows)
        return rows[order], columns[order]
    cost = -likeness
    n, m = cost.shape
    owner = np.full(m, -1)
    of_row, of_column = np.zeros(n), np.zeros(m)
    for row in range(n):
        _augment(cost, row, owner, of_row, of_column)
    columns = np.flatnonzero(owner >= 0)
    order = np.argsort(owner[columns])
    return owner[columns][order], columns[order]


def _augment(
    cost: NDArray[np.float64],
    row: int,
    owner: NDArray[np.intp],
    of_row: NDArray[np.float64],
    of_column: NDArray[np.float64],
) -> None:
    """Give one more row a column, along the path that costs least; the arrays are updated.

    `owner` (m,) is the row of each column or -1; `of_row` and `of_column` are the dual prices.
    """
    m = len(owner)
    distance, before, done = np.full(m, np.inf), np.full(m, -1), np.zeros(m, dtype=bool)
    reached, here, column = 0.0, row, -1
    while True:
        through = reached + cost[here] - of_row[here] - of_column
        nearer = ~done & (through < distance)
        distance[nearer], before[nearer] = through[nearer], column
        column = int(np.argmin(np.where(done, np.inf, distance)))
        reached = float(distance[column])
        done[column] = True
        if owner[column] < 0:
            break
        here = int(owner[column])
    spare = np.where(done, reached - distance, 0.0)
    taken = done & (owner >= 0)
    of_row[owner[taken]] += spare[taken]
    of_row[row] += reached
    of_column -= spare
    while column >= 0:
        previous = int(before[column])
        owner[column] = owner[previous] if previous >= 0 else row
        column = previous
