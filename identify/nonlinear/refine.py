"""The same damper curves on more knees: few find the car, more describe its dampers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..elements.damper import knee, secant_share
from .car import KNEE_M_S, Model
from .priors import weak_priors
from .problem import Problem

_FASTEST_M_S = 0.8


def refined(
    problem: Problem, eta: NDArray[np.float64], knots: tuple[float, ...]
) -> tuple[Problem, NDArray[np.float64]]:
    """Return the problem with knees at `knots`, m/s, and `eta` with nearly the same curves."""
    old = problem.model
    model = Model(old.box, knots)
    grid = np.linspace(-_FASTEST_M_S, _FASTEST_M_S, 321)
    change = np.linalg.lstsq(_bends(grid, knots), _bends(grid, old.knots))[0]
    head = len(old.names) - 2 * len(old.knots)
    front, rear = eta[head : head + len(old.knots)], eta[head + len(old.knots) :]
    moved = np.concatenate([eta[:head], change @ front, change @ rear])
    centre, prior = weak_priors(model, moved)
    # The priors of what both have stay where they began.
    centre[:head], prior[:head] = problem.centre[:head], problem.prior[:head]
    return replace(problem, model=model, centre=centre, prior=prior), moved


def _bends(speed: NDArray[np.float64], knots: tuple[float, ...]) -> NDArray[np.float64]:
    """Return what one unit of each knee's slope adds to a curve of given secant, (n, knots)."""
    columns = [knee(speed, at, KNEE_M_S) - secant_share(at, KNEE_M_S) * speed for at in knots]
    return np.stack(columns, axis=1)
