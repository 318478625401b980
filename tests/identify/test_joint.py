"""The joint fit of sessions against plain least squares on all of them at once."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.joint import Likelihood, Model, differences

Array = NDArray[np.float64]


def sessions(n: int) -> tuple[list[Array], list[Array], tuple[Likelihood, ...]]:
    """Return square roots of information, optima, and shares of sessions of three parameters."""
    rng = np.random.default_rng(n)
    roots = [rng.standard_normal((5, 3)) for _ in range(n)]
    optima = [rng.standard_normal(3) for _ in range(n)]
    shares = tuple(
        Likelihood(R.T @ R, R.T @ R @ x, np.zeros(0)) for R, x in zip(roots, optima, strict=True)
    )
    return roots, optima, shares


def solved(
    roots: list[Array], optima: list[Array], columns: list[Array]
) -> tuple[Array, float, Array]:
    """Return common parameters and differences, what is left, and the covariance of all."""
    rows = [R @ np.hstack([np.eye(3), block]) for R, block in zip(roots, columns, strict=True)]
    J, y = np.vstack(rows), np.concatenate([R @ x for R, x in zip(roots, optima, strict=True)])
    x = np.linalg.lstsq(J, y, rcond=None)[0]
    covariance = np.asarray(np.linalg.inv(J.T @ J), dtype=np.float64)
    return x, float(np.sum((y - J @ x) ** 2)), covariance


def test_of_two_sessions_one_parameter_differs() -> None:
    roots, optima, shares = sessions(2)
    model = Model((1,), (np.array([[0.0], [1.0]]),))
    found = differences(shares, model)
    none, one = np.zeros((3, 0)), np.array([[0.0], [1.0], [0.0]])
    x, left, covariance = solved(roots, optima, [0.0 * one, one])
    same, alike, _ = solved(roots, optima, [none, none])
    common, by, spread = found.best(np.array([0]))
    assert common == pytest.approx(x[:3])
    assert by == pytest.approx(x[3:])
    assert spread[0, 0] == pytest.approx(covariance[3, 3])
    assert found.gain(np.array([0])) == pytest.approx(alike - left)
    assert found.common == pytest.approx(same)
    assert found.shown.tolist() == [True]


def test_of_four_sessions_one_drifts_and_another_varies() -> None:
    """Parameter 2 by one step a session, parameter 0 by a difference of its own in each."""
    roots, optima, shares = sessions(4)
    line, free = np.arange(4.0)[:, None], np.eye(4)[:, 1:]
    model = Model((2, 0), (line, free))
    columns = []
    for session in range(4):
        block = np.zeros((3, 4))
        block[2, 0] = session
        if session:
            block[0, session] = 1.0
        assert model.columns(session, 3) == pytest.approx(block)
        columns.append(block)
    found = differences(shares, model)
    everything = np.arange(4)
    x, left, covariance = solved(roots, optima, columns)
    common, by, spread = found.best(everything)
    assert common == pytest.approx(x[:3])
    assert by == pytest.approx(x[3:])
    assert spread == pytest.approx(covariance[3:, 3:])
    _, alike, _ = solved(roots, optima, [np.zeros((3, 0))] * 4)
    assert found.gain(everything) == pytest.approx(alike - left)
    _, drift_only, _ = solved(roots, optima, [block[:, :1] for block in columns])
    assert found.gain(np.array([0])) == pytest.approx(alike - drift_only)
    assert found.gain(np.zeros(0, dtype=np.intp)) == 0.0
    sets = [np.array([0]), everything, np.zeros(0, dtype=np.intp)]
    assert found.gains(sets) == pytest.approx([alike - drift_only, alike - left, 0.0])


def test_a_parameter_that_one_session_only_tells_of_shows_no_difference() -> None:
    known = Likelihood(np.diag([4.0, 1.0, 1.0]), np.array([8.0, 0.0, 0.0]), np.zeros(0))
    blind = Likelihood(np.diag([0.0, 1.0, 1.0]), np.array([0.0, 3.0, 0.0]), np.zeros(0))
    design = np.array([[0.0], [1.0]])
    found = differences((known, blind), Model((0, 1), (design, design)))
    assert found.shown.tolist() == [False, True]
    assert found.common == pytest.approx(np.array([2.0, 1.5, 0.0]))
    # 3 and 0 with a variance of 1 each: their difference has 2.
    assert found.gain(np.array([0, 1])) == pytest.approx(9.0 / 2.0)
