"""A step of the fit: the best one within its bounds."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from identify.nonlinear.fit import _is_settled, _Step, _step, inverse, unit_size
from identify.nonlinear.path import InitialState
from identify.nonlinear.problem import Block, Normal

N_OWN, N_SHARED = 18, 3
FREE = np.full(N_SHARED, np.inf)


def equations(pull: float) -> tuple[Normal, np.ndarray, np.ndarray]:
    """Return normal equations of one run that pull its first friction, and the whole of them."""
    rng = np.random.default_rng(4)
    root = rng.standard_normal((60, N_OWN + N_SHARED))
    H, g = root.T @ root, rng.standard_normal(N_OWN + N_SHARED)
    g[14] += pull
    block = Block(H[:N_OWN, :N_OWN], H[:N_OWN, N_OWN:], H[N_OWN:, N_OWN:], g[:N_OWN], g[N_OWN:], ())
    alone = np.zeros((N_SHARED, N_SHARED)), np.zeros(N_SHARED)
    return Normal((block,), *alone, np.zeros(0), np.zeros((0, N_SHARED))), H, g


def with_segments(given: Normal, lacks: np.ndarray, lifts: np.ndarray) -> Normal:
    """Return equations with segments of damper curves, those that are flat now in force."""
    flat = lacks > 0.0
    return replace(
        given,
        lacks=lacks,
        lifts=lifts,
        shared=lifts[flat].T @ lifts[flat],
        right=lifts[flat].T @ lacks[flat],
    )


def at_rest(friction: float) -> InitialState:
    return InitialState(np.zeros(14), np.array([friction, 0.0, 0.0, 0.0]), np.zeros(4))


def test_a_free_step_is_that_of_the_whole_equations() -> None:
    given, H, g = equations(1.0)
    found = _step(given, (at_rest(0.0),), 0.0, -FREE, FREE)
    whole = np.linalg.solve(H, g)
    assert found.shared == pytest.approx(whole[N_OWN:])
    assert found.initials[0] == pytest.approx(whole[:N_OWN])
    assert found.fall == pytest.approx(float(g @ whole))


def test_friction_that_acts_in_full_stops_and_the_others_step_with_it() -> None:
    given, H, g = equations(40.0)
    found = _step(given, (at_rest(0.75),), 0.0, -FREE, FREE)
    rest = np.delete(np.arange(N_OWN + N_SHARED), 14)
    with_it = np.linalg.solve(H[np.ix_(rest, rest)], g[rest] - 0.25 * H[rest, 14])
    assert found.initials[0][14] == pytest.approx(0.25)
    assert np.concatenate([np.delete(found.initials[0], 14), found.shared]) == pytest.approx(
        with_it
    )


def test_an_unknown_at_its_bound_does_not_hold_up_the_others() -> None:
    given, H, g = equations(1.0)
    whole = np.linalg.solve(H, g)
    high = FREE.copy()
    high[1] = whole[N_OWN + 1] - 0.5
    found = _step(given, (at_rest(0.0),), 0.0, -FREE, high)
    rest = np.delete(np.arange(N_OWN + N_SHARED), N_OWN + 1)
    with_it = np.linalg.solve(H[np.ix_(rest, rest)], g[rest] - high[1] * H[rest, N_OWN + 1])
    assert found.shared[1] == pytest.approx(high[1])
    assert np.delete(found.shared, 1) == pytest.approx(with_it[N_OWN:])


@pytest.mark.parametrize(
    ("room", "held"),
    [(0.9, True), (1.1, False)],
)
def test_a_damper_curve_is_held_up_where_the_step_would_make_it_too_flat(
    room: float, held: bool
) -> None:
    """`room`: the segment's slope above the floor, over what the free step takes of it."""
    given, H, g = equations(1.0)
    whole = np.linalg.solve(H, g)
    lifts = np.array([[0.0, 300.0, 0.0]]) * -np.sign(whole[N_OWN + 1])
    lacks = -room * np.abs(lifts @ whole[N_OWN:])
    found = _step(with_segments(given, lacks, lifts), (at_rest(0.0),), 0.0, -FREE, FREE)
    row = np.concatenate([np.zeros(N_OWN), lifts[0]])
    with_it = np.linalg.solve(H + held * np.outer(row, row), g + held * row * lacks[0])
    assert found.shared == pytest.approx(with_it[N_OWN:])
    cost = float(with_it @ H @ with_it - 2.0 * g @ with_it)
    cost += max(0.0, float(lacks[0] - row @ with_it)) ** 2
    assert found.fall == pytest.approx(-cost)


def test_a_damper_curve_that_the_step_lifts_by_itself_is_not_held() -> None:
    given, H, g = equations(1.0)
    whole = np.linalg.solve(H, g)
    lifts = np.array([[0.0, 300.0, 0.0]]) * np.sign(whole[N_OWN + 1])
    lacks = 0.5 * np.abs(lifts @ whole[N_OWN:])
    found = _step(with_segments(given, lacks, lifts), (at_rest(0.0),), 0.0, -FREE, FREE)
    assert found.shared == pytest.approx(whole[N_OWN:])
    assert found.fall == pytest.approx(float(g @ whole) + float(lacks[0]) ** 2)


@pytest.mark.parametrize("left_over", [0.0, -1e-18])
def test_an_unknown_without_information_stays_and_spoils_nothing(left_over: float) -> None:
    """What elimination leaves of it is rounding, also below zero and beside larger rounding."""
    information = np.array([[4.0, 1e-9], [1e-9, left_over]])
    np.testing.assert_allclose(inverse(information), [[0.25, 0.0], [0.0, 0.0]], atol=1e-6)
    np.testing.assert_array_equal(unit_size(information), [2.0, 1.0])


@pytest.mark.parametrize(("mass", "still"), [(0.019, True), (-0.021, False)])
def test_a_fit_stands_still_if_only_elements_would_move(mass: float, still: bool) -> None:
    """The mass has a standard deviation of 0.1; the gap beside it would move by 5 of its own."""
    model = SimpleNamespace(box=SimpleNamespace(parameters=("m_s",)))
    problem = cast(Any, SimpleNamespace(free=np.array([0, 40]), model=model))
    full = _Step(np.array([mass, 5.0]), (), 9.0)
    assert _is_settled(problem, full, np.diag([100.0, 1.0])) is still
