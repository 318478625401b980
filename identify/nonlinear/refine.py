"""Describes the same damper curves by more knees, which only the last steps of a fit need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..elements.damper import knee
from .car import Model
from .priors import weak_priors
from .problem import Problem

_FASTEST_M_S = 1.0
_SHARP_M_S = 1e-9
"""Rounding of knees where chords are drawn: a knee that is kept does not change then."""


def refined(
    problem: Problem, eta: NDArray[np.float64], knots: tuple[float, ...]
) -> tuple[Problem, NDArray[np.float64]]:
    """Return the problem with knees at `knots`, m/s, and `eta` with nearly the same curves.

    They pass through the points of the old curves at the new knees, so that no curve falls where
    the old one does not: on a mount, tangents would grow until they are useless.
    """
    old = problem.model
    model = Model(old.box, knots)
    change = _bends(knots, old.knots)
    head = len(old.names) - 2 * len(old.knots)
    front, rear = eta[head : head + len(old.knots)], eta[head + len(old.knots) :]
    moved = np.concatenate([eta[:head], change @ front, change @ rear])
    centre, prior = weak_priors(model, moved)
    # The priors of unknowns that both problems have stay the same.
    centre[:head], prior[:head] = problem.centre[:head], problem.prior[:head]
    return replace(problem, model=model, centre=centre, prior=prior), moved


def _bends(knots: tuple[float, ...], old: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the change of slope of the old curve's chords at each knot by each old knee."""
    speeds = np.array([-_FASTEST_M_S, *knots, _FASTEST_M_S])
    forces = np.stack([knee(speeds, at, _SHARP_M_S) for at in old], axis=1)
    slopes = np.diff(forces, axis=0) / np.diff(speeds)[:, None]
    return np.where(np.array(knots) < 0.0, -1.0, 1.0)[:, None] * np.diff(slopes, axis=0)
