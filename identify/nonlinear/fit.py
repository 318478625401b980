"""Levenberg-Marquardt on the reduced normal equations: the unknowns of the runs are eliminated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import process_time

import numpy as np
from numpy.typing import NDArray

from ..fit.varpro import pseudo_inverse
from ..model.matrices import Real
from .path import ROUGH, Grade, InitialState
from .problem import Normal, Point, Problem, point_at

_MOST_REFUSED = 8
"""Refused steps in a row after which the tangents count as useless."""
_LAST_FALL, _LAST_GAIN = 2.0, 0.05
"""Fall of the cost, over chi2/n, that a full step may still promise where every step is refused,
and the smallest gain of a step where no more than that is promised."""
_SHAPES_SIGMAS, _SHAPES_FALL = 0.2, 5.0
"""Standard deviations by which a full step may still move a parameter of the car, and the fall of
the cost, over chi2/n, that it may promise, if only the shapes of elements still move."""


@dataclass(frozen=True)
class Optimum:
    """The point where a fit ended."""

    point: Point
    information: Real
    """(F, F) reduced normal matrix, undamped."""
    iterations: int
    decrement: float
    """Fall of the cost that a full step would give if the problem were linear."""
    converged: bool

    @property
    def eta(self) -> Real:
        """All unknowns, (P,)."""
        return self.point.eta

    @property
    def cost(self) -> float:
        """Squared residuals in units of sigma, facts and priors included."""
        return self.point.cost


@dataclass
class Clock:
    """Processor time of a search from its first point on: machine code has been made by then."""

    seconds: float = np.inf
    began_s: float = np.nan
    unreached: list[str] = field(default_factory=list)
    """Parts of the search that it had no time for, in words."""

    def limit(self, share: float, work: str) -> Callable[[], bool]:
        """Return whether this share of the time has passed, as a function that a fit asks.

        `work`: what the fit does; it is unreached if the fit ends for want of time.
        """

        def is_over() -> bool:
            if np.isnan(self.began_s):
                self.began_s = process_time()
            is_late = process_time() - self.began_s > share * self.seconds
            if is_late and work not in self.unreached:
                self.unreached.append(work)
            return is_late

        return is_over


def reduced(
    equations: Normal, damping: float = 0.0, fixed: Sequence[Real] | None = None
) -> tuple[Real, Real, list[tuple[Real, Real]]]:
    """Return normal matrix, (F, F), and right-hand side, (F,), without the runs' own unknowns.

    Then a pair for each run: the step of its own unknowns, (own,), where the free ones keep still,
    and what a step of these takes from it, (own, F).

    `fixed`: steps of own unknowns that are given, (own,) for each run, NaN for the others; by
    default none is.
    """
    matrix, right = equations.matrix.copy(), equations.right.copy()
    own_steps, fixed = [], fixed or [np.full(len(b.A), np.nan) for b in equations.blocks]
    for b, given in zip(equations.blocks, fixed, strict=True):
        A = b.A + damping * np.diag(np.diag(b.A))
        is_given, is_free = np.isfinite(given), np.isnan(given)
        inverse_A = np.zeros_like(A)
        inverse_A[np.ix_(is_free, is_free)] = pseudo_inverse(A[np.ix_(is_free, is_free)])
        step = inverse_A @ (b.right_own - A[:, is_given] @ given[is_given])
        step[is_given] = given[is_given]
        by_free = inverse_A @ b.B
        matrix += b.C - b.B.T @ by_free
        right += b.right_free - b.B.T @ step
        own_steps.append((step, by_free))
    return matrix, right, own_steps


@dataclass(frozen=True, slots=True)
class _Step:
    """A damped step within all bounds."""

    free: Real
    """(F,) of the free unknowns."""
    own: tuple[Real, ...]
    """(18,) or with mounts (22,), of each run's own unknowns."""
    fall: float
    """Fall of the cost, if the problem were linear."""


def _step(
    equations: Normal, initials: tuple[InitialState, ...], damping: float, low: Real, high: Real
) -> _Step:
    """Return the damped step; a share of friction that would exceed 1 stops at 1.

    Segments of damper curves that are flat after the step have their terms in it, others do not.
    `low`, `high`: least and largest step of each free unknown, (F,).
    """
    fixed = [np.full(len(b.A), np.nan) for b in equations.blocks]
    flat = equations.deficits > 0.0
    # Each solution has more friction at its bound and other segments flat; eight at most.
    for _ in range(8):
        matrix, right, own_steps = reduced(equations.with_terms_of(flat), damping, fixed)
        free = _solve(matrix, right, damping, low, high)
        deficits = equations.deficits - equations.falls @ free
        moves = [step - by_free @ free for step, by_free in own_steps]
        any_stopped = False
        for x0, move, given in zip(initials, moves, fixed, strict=True):
            after = x0.friction + move[14:18]  # the shares of friction at the four corners
            excess = np.abs(after) - 1.0
            # The one furthest beyond sliding first: without it the others may stay within.
            stopped = np.flatnonzero(excess > max(1e-9, 0.5 * float(excess.max())))
            given[14 + stopped] = np.sign(after[stopped]) - x0.friction[stopped]
            any_stopped |= len(stopped) > 0
        if not any_stopped and ((deficits > 0.0) == flat).all():
            break
        flat = deficits > 0.0
    # The fall of the cost: of facts and priors, of segments that are flat before or after, of runs.
    no_segments = equations.with_terms_of(np.zeros_like(flat))
    fall = 2.0 * float(no_segments.right @ free) - float(free @ no_segments.matrix @ free)
    fall += float(np.sum(np.maximum(equations.deficits, 0.0) ** 2 - np.maximum(deficits, 0.0) ** 2))
    for b, move in zip(equations.blocks, moves, strict=True):
        fall += 2.0 * float(b.right_own @ move + b.right_free @ free) - float(
            move @ b.A @ move + 2.0 * move @ b.B @ free + free @ b.C @ free
        )
    return _Step(free, tuple(moves), fall)


def _solve(matrix: Real, right: Real, damping: float, low: Real, high: Real) -> Real:
    """Return the damped step, (F,), within bounds; an unknown that would leave them stops there.

    The others then take the step that is best with it: one unknown that the data hardly determine
    must not block all others.
    """
    information = np.diag(matrix)
    scale = np.sqrt(np.where(information > 0.0, information, 1.0))
    H = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
    step, within = np.zeros(len(scale)), np.ones(len(scale), dtype=bool)
    # Each solution has more unknowns stopped at their bounds; twelve at most.
    for _ in range(12):
        remaining = (right / scale - H @ (step * ~within * scale))[within]
        step[within] = np.linalg.solve(H[np.ix_(within, within)], remaining) / scale[within]
        beyond = within & ((step < low) | (step > high))
        if not beyond.any():
            break
        step[beyond] = np.clip(step, low, high)[beyond]
        within &= ~beyond
    return np.clip(step, low, high)


def _full_step(point: Point | None) -> _Step | None:
    """Return the undamped step from a point; None without finite path and tangents."""
    if point is None or not point.normal.finite:
        return None
    low, high = point.problem.bounds
    free_eta = point.eta[point.problem.free]
    return _step(point.normal, point.initials, 1e-12, low - free_eta, high - free_eta)


def fit(
    problem: Problem,
    eta: Real,
    initials: tuple[InitialState, ...],
    grade: Grade = ROUGH,
    tolerance: float = 0.05,
    rough: float = 0.0,
    max_iterations: int = 40,
    is_over: Callable[[], bool] = lambda: False,
) -> Optimum | None:
    """Return the optimum that is found from a start; None without finite path and tangents there.

    A fit has converged if a full step would lower the cost by less than `tolerance` times chi2/n:
    then no combination of unknowns is further off than the square root of that, in standard
    deviations.  It has also converged if no step, however strongly damped, lowers the cost itself
    (at corners of the force laws the tangents promise more than the paths give), or if only the gap
    of a stop or the knees of a curve still creep.  `rough`: a fall of the cost by less than this
    part of it ends the fit, too.  `is_over`: whether the time has passed; the fit then ends there.
    """
    current = point_at(problem, eta, initials, grade)
    full_step = _full_step(current)
    if current is None or full_step is None:
        return None
    low, high = problem.bounds
    n = sum(run.freedom for run in problem.runs)
    damping, refused, iterations, is_slow = 1e-3, 0, 0, False
    while True:
        decrement = full_step.fall
        free_eta = current.eta[problem.free]
        unit = max(1.0, current.cost / n)  # chi2/n, in which falls of the cost count
        small = is_slow or abs(decrement) < max(tolerance * unit, rough * current.cost)
        if small or iterations >= max_iterations or refused >= _MOST_REFUSED or is_over():
            matrix, _, _ = reduced(current.normal)
            converged = small or (refused >= _MOST_REFUSED and 0.0 <= decrement < _LAST_FALL * unit)
            # Where the car's parameters are held, or hardly move any more, only shapes do.
            of_car = problem.free < len(problem.model.box.parameters)
            std = np.sqrt(np.diag(pseudo_inverse(matrix))) if of_car.any() else np.inf
            hardly_moves = bool((np.abs(full_step.free) <= _SHAPES_SIGMAS * std)[of_car].all())
            converged |= 0.0 <= decrement < _SHAPES_FALL * unit and hardly_moves
            return Optimum(current, matrix, iterations, decrement, converged)
        is_near, is_last = decrement < unit, decrement < _LAST_FALL * unit
        # A step by which the cost falls less counts as refused.
        least_gain = unit * (min(_LAST_GAIN, tolerance) if is_last else 1e-3)
        # Near the optimum a step may raise the cost a little: the next one may lower it by more.
        most_rise, reach = 0.5 * unit if is_near else -least_gain, problem.reach
        while refused < _MOST_REFUSED and iterations < max_iterations:
            iterations += 1
            bounds = np.maximum(low - free_eta, -reach), np.minimum(high - free_eta, reach)
            step = _step(current.normal, current.initials, damping, *bounds)
            if is_last and step.fall < least_gain:  # damped more, it gains even less
                refused = _MOST_REFUSED
                break
            trial_eta = current.eta.copy()
            trial_eta[problem.free] += step.free
            initials = tuple(
                x0.moved(move) for x0, move in zip(current.initials, step.own, strict=True)
            )
            trial = point_at(problem, trial_eta, initials, grade)
            if trial is not None and trial.cost < current.cost + most_rise:
                next_step = _full_step(trial)
                # Where a curve falls, tangents grow until the full step is not a minimum any more.
                if next_step and next_step.fall > -tolerance * unit:
                    # A damping that has just proved necessary stays for one step.
                    damping = damping if refused else max(damping / 10.0, 1e-8)
                    # A rough fit goes on while a step gains half of what is rough.
                    is_slow = current.cost - trial.cost < 0.5 * rough * current.cost
                    refused, current, full_step = 0, trial, next_step
                    break
            refused += 1
            damping = max(damping * 10.0, 1e-3)
            reach = reach / 2.0


def gain_of(best: Optimum, eta: Real, extra: NDArray[np.intp]) -> tuple[Real, Real]:
    """Return to first order how far the cost falls with each further unknown free, and its size.

    `best`: optimum of the free unknowns.  `eta`, (P,): those of the optimum, except for some that
    do not act yet.  `extra`, (k,): positions of the further ones.  Returns (k,) each, with one
    unknown alone; zeros where path or tangents are not finite, or where the free unknowns have the
    same effect.
    """
    free = np.union1d(best.point.problem.free, extra)
    problem = replace(best.point.problem, free=free)
    point = point_at(problem, eta, best.point.initials, best.point.grade)
    if point is None or not point.normal.finite:
        return np.zeros(len(extra)), np.zeros(len(extra))
    matrix, right, _ = reduced(point.normal)
    new, old = np.searchsorted(free, extra), ~np.isin(free, extra)
    cross = matrix[np.ix_(new, old)] @ pseudo_inverse(matrix[np.ix_(old, old)])
    information = np.diag(matrix)[new]
    remaining = information - np.einsum("ij,ji->i", cross, matrix[np.ix_(old, new)])
    slope = right[new] - cross @ right[old]
    separate = remaining > 1e-10 * information  # less is rounding: the free ones do the same
    size = np.divide(slope, remaining, out=np.zeros(len(extra)), where=separate)
    return slope * size, size


# Covariance that holds where a little is unexplained: from the scatter of the scores --------------
#
# Where the model leaves motion unexplained, residuals are neither white nor as small as the noise.
# The scatter of the scores, which are correlated in time, shows how far the estimate may be off
# (heteroscedasticity and autocorrelation consistent covariance, Newey and West 1987).


def scatter(point: Point) -> Real:
    """Return the covariance of the scores, (F, F), by Bartlett's window of 0.2 s.

    Over longer than two periods of the wheels, residuals are not correlated.
    """
    runs, n_free = point.problem.runs, len(point.problem.free)
    covariance = np.zeros((n_free, n_free))
    bin_s, lags = 0.005, 40  # 0.2 s
    for run, predicted, block in zip(runs, point.predicted, point.normal.blocks, strict=True):
        n_own = len(block.A)
        own_by_free = pseudo_inverse(block.A) @ block.B
        bins = int(run.end_s / bin_s) + 2
        scores = np.zeros((bins, n_free))  # J^T residuals, summed over the samples of a bin
        of_recordings = (run.decay.recordings, predicted.residuals, block.jacobian)
        for r, residuals, J in zip(*of_recordings, strict=True):
            J_free = J[:, :, n_own:] - J[:, :, :n_own] @ own_by_free
            bin_index = np.clip((r.time_s / bin_s).astype(int), 0, bins - 1)
            np.add.at(scores, bin_index, np.einsum("ncf,nc->nf", J_free, residuals))
        covariance += scores.T @ scores
        for lag in range(1, min(lags + 1, bins)):
            term = (1.0 - lag / (lags + 1.0)) * (scores[lag:].T @ scores[:-lag])
            covariance += term + term.T
    return covariance


def widened(covariance: Real, scores: Real) -> Real:
    """Return the covariance with each standard deviation at least that from the scores' scatter."""
    robust = np.diag(covariance @ scores @ covariance)
    plain = np.diag(covariance)
    factor = np.sqrt(np.maximum(robust / np.maximum(plain, 1e-300), 1.0))
    return np.asarray(covariance * np.outer(factor, factor))
