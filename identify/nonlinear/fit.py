"""Levenberg-Marquardt on the reduced normal equations: the unknowns of the runs are eliminated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .path import Own
from .problem import Normal, Point, Problem, normal, point

_MAX_STEP = 0.5
"""Largest change of an unknown in one iteration."""
_REFUSED = 4
"""Refused steps in a row after which the tangents count as spent."""


@dataclass(frozen=True)
class Optimum:
    """Where a fit ended."""

    point: Point
    normal: Normal
    information: NDArray[np.float64]
    """(F, F) reduced normal matrix, undamped."""
    iterations: int
    decrement: float
    """By how much the cost would fall if the problem were linear."""
    converged: bool

    @property
    def eta(self) -> NDArray[np.float64]:
        """All unknowns, (P,)."""
        return self.point.eta

    @property
    def cost(self) -> float:
        """Squared residuals in units of sigma, facts and priors included."""
        return self.point.cost


def inverse(matrix: NDArray[np.float64], rank: float = 1e-13) -> NDArray[np.float64]:
    """Invert a positive matrix after scaling; directions without information stay zero."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    good = values > rank * values[-1]
    return np.asarray(
        (vectors[:, good] / values[good]) @ vectors[:, good].T * np.outer(scale, scale)
    )


def reduced(
    given: Normal, damping: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[NDArray[np.float64]]]:
    """Eliminate the runs' own unknowns: matrix, right-hand side, damped inverse of each A."""
    matrix, right = given.shared.copy(), given.right.copy()
    inverses = []
    for b in given.blocks:
        A = b.A + damping * np.diag(np.diag(b.A))
        inverses.append(inverse(A))
        X = b.B.T @ inverses[-1]
        matrix += b.C - X @ b.B
        right += b.shared - X @ b.own
    return matrix, right, inverses


def _solve(
    matrix: NDArray[np.float64],
    right: NDArray[np.float64],
    damping: float,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the damped step within its bounds; what would leave them stops there."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    H = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
    step, held = np.zeros(len(scale)), np.zeros(len(scale), dtype=bool)
    for _ in range(6):
        loose = ~held
        rest = right / scale - H @ (step * held * scale)
        step[loose] = np.linalg.solve(H[np.ix_(loose, loose)], rest[loose]) / scale[loose]
        out = loose & ((step < low) | (step > high))
        if not out.any():
            break
        step[out] = np.clip(step, low, high)[out]
        held |= out
    return step


def fit(
    problem: Problem,
    eta: NDArray[np.float64],
    owns: tuple[Own, ...],
    polish: bool = False,
    tolerance: float = 0.05,
    rough: float = 0.0,
    max_iterations: int = 40,
    log: Callable[[str], None] = lambda text: None,
) -> Optimum | None:
    """Find the optimum from a start; None if the start has no finite path.

    Converged is a fit whose cost a full step would lower by less than `tolerance` times chi2/n:
    then no combination of unknowns is further off than the root of that, in standard deviations.
    """
    at = point(problem, eta, owns, polish)
    if at is None:
        return None
    low, high = problem.bounds
    n = sum(run.freedom for run in problem.runs)
    damping, refused, iterations = 1e-3, 0, 0
    equations = normal(at)
    while True:
        matrix, right, _ = reduced(equations, 0.0)
        now = at.eta[problem.free]
        full = _solve(matrix, right, 1e-12, low - now, high - now)
        decrement = float(2.0 * right @ full - full @ matrix @ full)
        small = decrement < max(tolerance * max(1.0, at.cost / n), rough * at.cost)
        if small or iterations >= max_iterations or refused >= _REFUSED:
            return Optimum(at, equations, matrix, iterations, decrement, small)
        trial = None
        while refused < _REFUSED:
            iterations += 1
            damped, downhill, inverses = reduced(equations, damping)
            step = _solve(damped, downhill, damping, low - now, high - now)
            share = min(1.0, _MAX_STEP / max(float(np.max(np.abs(step), initial=0.0)), 1e-300))
            step *= share
            moved = at.eta.copy()
            moved[problem.free] += step
            owns = tuple(
                own.moved(A @ (share * b.own - b.B @ step))
                for own, A, b in zip(at.owns, inverses, equations.blocks, strict=True)
            )
            trial = point(problem, moved, owns, polish)
            log(
                f"  {iterations} cost {at.cost:.2f} -> {trial.cost if trial else np.nan:.2f} "
                f"decr {decrement:.3g} lambda {damping:.0e} share {share:.2f}"
            )
            near = decrement < 1.0 and damping <= 1e-3
            if trial is not None and trial.cost < at.cost + (1.0 if near else 0.0):
                damping, refused = max(damping / 10.0, 1e-8), 0
                break
            refused += 1
            damping = max(damping * 10.0, 1e-3)
        if refused >= _REFUSED or trial is None:
            continue
        at = trial
        equations = normal(at)
