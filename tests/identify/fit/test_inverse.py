"""Inverses of normal matrices: directions that the data do not show stay zero."""

from __future__ import annotations

import numpy as np
import pytest

from identify.fit.varpro import pseudo_inverse
from identify.nonlinear.fit import inverse


def test_a_normal_matrix_is_inverted_whatever_the_units() -> None:
    normal = np.array([[4e12, 2.0], [2.0, 3e-12]])
    for found in (pseudo_inverse(normal), inverse(normal)):
        assert found @ normal == pytest.approx(np.eye(2), abs=1e-9)
        assert found == pytest.approx(found.T)


def test_what_the_data_do_not_show_stays_zero() -> None:
    assert pseudo_inverse(np.diag([4.0, 0.0])) == pytest.approx(np.diag([0.25, 0.0]))
    assert inverse(np.diag([4.0, 0.0])) == pytest.approx(np.diag([0.25, 0.0]))
    # Two unknowns that only their sum shows: the half of it each.
    twins = np.array([[2.0, 2.0], [2.0, 2.0]])
    assert pseudo_inverse(twins) == pytest.approx(np.full((2, 2), 1.0 / 8.0))
    assert inverse(twins) == pytest.approx(np.full((2, 2), 1.0 / 8.0))


def test_no_unknowns_have_an_inverse_too() -> None:
    assert pseudo_inverse(np.zeros((0, 0))).shape == (0, 0)
