"""The quantile is that of SciPy."""

from __future__ import annotations

import pytest
from scipy.special import chdtri

from identify.model.chi_squared import upper_quantile


@pytest.mark.parametrize("freedom", [1, 2, 3, 8, 17, 62, 400, 3001])
@pytest.mark.parametrize("chance", [0.9, 0.05, 1e-3, 1e-9])
def test_quantiles_of_any_freedom(freedom: int, chance: float) -> None:
    assert upper_quantile(freedom, chance) == pytest.approx(chdtri(freedom, chance), rel=1e-12)
