"""Which samples before a start are free decay, on predictions worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from identify.fit.decay_start import _Early, _free_instants


def early(*error: float, variance: float = 3.0) -> _Early:
    """Return samples of one unknown of so much variance, of which each shows it by 1."""
    n = len(error)
    nothing = np.zeros((n, 1))
    time_s = -0.01 * np.arange(1.0, n + 1.0)
    return _Early(
        time_s, np.ones((n, 1)), np.array(error), nothing, nothing, np.array([[variance]])
    )


def test_each_prediction_has_learned_from_the_samples_that_were_accepted() -> None:
    """The mean of n values of variance 1, and of a zero of variance 3: 3 sum / (1 + 3 n)."""
    free, known, failed = _free_instants(early(4.0, 1.0, -2.0))
    assert (free, failed) == ([-0.01, -0.02, -0.03], None)
    assert [float(state[0]) for state, _ in known] == pytest.approx([0.0, 3.0, 15.0 / 7.0])
    assert [float(spread[0, 0]) for _, spread in known] == pytest.approx([3.0, 0.75, 3.0 / 7.0])


@pytest.mark.parametrize(("error", "failed"), [(9.87, None), (9.88, -0.01)])
def test_a_sample_is_forced_beyond_four_and_a_half_deviations_of_its_prediction(
    error: float, failed: float | None
) -> None:
    """By Wilson and Hilferty (7/9 + 4.5 sqrt(2/9))^3 = 24.367 = 9.873^2 / (1 + 3)."""
    assert _free_instants(early(error))[2] == failed
    assert _free_instants(early(-error))[2] == failed
