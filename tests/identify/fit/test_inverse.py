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


def test_each_of_many_is_inverted_as_if_it_were_alone() -> None:
    """One is regular, one is what LAPACK calls singular, and one is singular but for rounding."""
    twins = np.array([[0.1, 0.3], [0.3, 0.9]])
    several = np.stack([np.array([[2.0, 1.0], [1.0, 3.0]]), np.diag([4.0, 0.0]), twins])
    found = pseudo_inverse(several)
    assert found[0] == pytest.approx(np.array([[3.0, -1.0], [-1.0, 2.0]]) / 5.0)
    assert found[1] == pytest.approx(np.diag([0.25, 0.0]))
    # Scaled to ones on the diagonal it is [[1, 1], [1, 1]], whose inverse is a quarter of that.
    assert found[2] == pytest.approx(0.25 / np.sqrt(np.outer([0.1, 0.9], [0.1, 0.9])))
    assert pseudo_inverse(several[:, None]) == pytest.approx(found[:, None])


def test_no_unknowns_have_an_inverse_too() -> None:
    assert pseudo_inverse(np.zeros((0, 0))).shape == (0, 0)
    assert pseudo_inverse(np.zeros((3, 0, 0))).shape == (3, 0, 0)


@pytest.mark.parametrize(("apart", "shown"), [(5e-12, False), (2e-11, True)])
def test_a_direction_counts_from_a_billionth_of_a_thousandth_of_the_strongest(
    apart: float, shown: bool
) -> None:
    """Ten unknowns that are alike but for so much: their sum has a strength of ten."""
    alike = np.full((10, 10), 1.0 - apart) + apart * np.eye(10)
    found = pseudo_inverse(alike)
    if shown:
        assert found[0, 0] == pytest.approx(0.9 / apart, rel=1e-3)
    else:
        assert found == pytest.approx(np.full((10, 10), 0.01), rel=1e-3)
