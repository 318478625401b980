"""Least squares of a few unknowns beside SciPy's, and the paper's order of estimation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize

from daq.vehicle import FORD_GRANADA
from identify.model.matrices import PhysicalModel, physical_model
from identify.paper.closed_form import least_squares, sequential_vehicle

Array = NDArray[np.float64]
TIME = np.linspace(0.0, 3.0, 40)
NOISY = 3.0 * np.exp(-1.3 * TIME) + 0.05 * np.random.default_rng(0).standard_normal(40)


def left(x: Array) -> Array:
    return np.asarray(x[0] * np.exp(-x[1] * TIME) - NOISY)


def slopes(x: Array) -> Array:
    wave = np.exp(-x[1] * TIME)
    return np.column_stack([wave, -x[0] * TIME * wave])


@pytest.mark.parametrize("start", [(3.0, 1.3), (1.0, 0.2), (20.0, 4.0), (0.1, 3.0)])
def test_a_decay_in_noise_is_fitted_to_rounding(start: tuple[float, float]) -> None:
    found = least_squares(left, slopes, np.array(start))
    best = optimize.least_squares(left, [3.0, 1.3], jac=slopes, xtol=1e-15, gtol=1e-15)
    assert found is not None
    assert found == pytest.approx(best.x, rel=1e-6)
    # At the optimum nothing is left along the derivatives.
    assert slopes(found).T @ left(found) == pytest.approx(np.zeros(2), abs=1e-8)


def test_rosenbrocks_valley_is_followed_to_its_end() -> None:
    def valley(x: Array) -> Array:
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])

    def jacobian(x: Array) -> Array:
        return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])

    found = least_squares(valley, jacobian, np.array([-1.2, 1.0]))
    assert found == pytest.approx(np.ones(2), rel=1e-10)


def test_unknowns_that_run_away_have_no_fit() -> None:
    assert least_squares(lambda x: np.exp(-x), lambda x: np.diag(-np.exp(-x)), np.ones(1)) is None


GRANADA = physical_model(FORD_GRANADA)


def identified(name: str, row: int, column: int, factor: float) -> Array:
    """Return the parameters, over the true ones, where one element came out otherwise."""
    matrices = {key: getattr(GRANADA, key).copy() for key in ("M", "C", "K")}
    matrices[name][row, column] *= factor
    found = sequential_vehicle(PhysicalModel(**matrices))
    return np.asarray(found.to_array() / FORD_GRANADA.to_array())


def test_exact_matrices_give_the_exact_vehicle() -> None:
    assert sequential_vehicle(GRANADA).to_array() == pytest.approx(FORD_GRANADA.to_array())


@pytest.mark.parametrize(
    ("name", "row", "column", "moved"),
    [
        ("M", 0, 0, {0}),
        ("M", 2, 2, {2}),
        ("M", 3, 3, {3}),  # half of it: the mean of both wheels
        ("M", 6, 6, {4}),
        ("M", 0, 1, set()),  # of M the diagonal only
        ("K", 1, 1, set()),  # holds squares of the lengths
        ("K", 2, 2, set()),
        ("K", 1, 2, set()),
        ("K", 1, 3, {11}),  # pitch and a front wheel: a, and by K[1, 0] b
        ("C", 1, 1, set()),
        ("C", 1, 0, set()),  # damping is taken from what holds no length
    ],
)
def test_each_parameter_is_read_from_the_elements_of_the_paper(
    name: str, row: int, column: int, moved: set[int]
) -> None:
    factor = identified(name, row, column, 1.1)
    away = {i for i, value in enumerate(factor) if abs(value - 1.0) > 1e-9}
    assert moved <= away
    assert away <= moved | ({11, 12} if moved == {11} else set())


def test_wheels_count_by_their_mean() -> None:
    assert identified("M", 3, 3, 1.1)[3] == pytest.approx(1.05)
    assert identified("M", 6, 6, 1.1)[4] == pytest.approx(1.05)


def test_the_damping_of_an_axle_is_the_mean_over_its_elements() -> None:
    """c_sf stands in C[0, 3], C[3, 0], C[3, 3], the same of the right, and twice in C[0, 0]."""
    found = identified("C", 3, 3, 1.1)
    assert found[9] == pytest.approx(identified("C", 4, 4, 1.1)[9])
    assert 1.0 < found[9] < 1.1
