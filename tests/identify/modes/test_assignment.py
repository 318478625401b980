"""The best assignment is that of SciPy."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from identify.modes.assignment import best_pairs


def test_the_best_pairs_of_any_shape() -> None:
    rng = np.random.default_rng(0)
    for n, m in rng.integers(1, 10, (200, 2)):
        likeness = rng.random((n, m))
        rows, columns = linear_sum_assignment(likeness, maximize=True)
        found = best_pairs(likeness)
        np.testing.assert_array_equal(found[0], rows)
        np.testing.assert_array_equal(found[1], columns)
    assert [len(side) for side in best_pairs(np.zeros((0, 3)))] == [0, 0]
