"""Against SciPy's, and against the printed tables."""

from __future__ import annotations

import pytest
from scipy.special import chdtrc, chdtri

from identify.model.chi_squared import chance_of_more, exceeded_by_chance


@pytest.mark.parametrize(
    ("freedom", "chance", "value"),
    [(1, 0.05, 3.841), (2, 0.05, 5.991), (3, 0.001, 16.266), (10, 0.01, 23.209)],
)
def test_the_printed_tables(freedom: int, chance: float, value: float) -> None:
    assert exceeded_by_chance(freedom, chance) == pytest.approx(value, abs=5e-4)
    assert chance_of_more(freedom, value) == pytest.approx(chance, rel=1e-3)


@pytest.mark.parametrize("freedom", [1, 2, 7, 40, 301, 2000])
def test_like_scipy_from_one_degree_to_thousands(freedom: int) -> None:
    for chance in (0.05, 1e-3, 1e-6, 1e-12):
        value = exceeded_by_chance(freedom, chance)
        assert value == pytest.approx(chdtri(freedom, chance), rel=1e-12)
        assert chance_of_more(freedom, value) == pytest.approx(chance, rel=1e-9)
    for value in (0.1, 0.5 * freedom, 1.5 * freedom):
        assert chance_of_more(freedom, value) == pytest.approx(chdtrc(freedom, value), rel=1e-9)


def test_nothing_is_less_than_zero() -> None:
    assert chance_of_more(3, 0.0) == 1.0
    assert chance_of_more(0, 0.0) == 1.0
