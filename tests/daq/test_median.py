"""The median equals NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from daq.median import median


@pytest.mark.parametrize(
    ("values", "middle"),
    [
        ([3.0], 3.0),
        ([4.0, 1.0], 2.5),
        ([9.0, -1.0, 2.0], 2.0),
        ([1.0, 8.0, 2.0, 4.0], 3.0),
        ([1.0, np.inf, 2.0], 2.0),
        ([[5.0, 1.0], [2.0, 7.0]], 3.5),
    ],
)
def test_half_of_the_numbers_are_on_either_side(values: list[float], middle: float) -> None:
    assert median(values) == middle == np.median(values)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_one_that_is_no_number_is_not_passed_over(n: int) -> None:
    for place in range(n):
        values = np.arange(float(n))
        values[place] = np.nan
        assert np.isnan(median(values))


def test_it_is_to_the_last_digit_that_of_numpy() -> None:
    rng = np.random.default_rng(7)
    for n in range(1, 40):
        values = rng.standard_normal(n)
        assert median(values) == np.median(values)
