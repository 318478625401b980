"""All runs, facts and priors at one point of the unknowns: cost and normal equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from . import integrator
from .car import MOUNT, Car, Model, car
from .falling import too_flat
from .level import Grade
from .path import InitialState, step_of
from .run import Block, Predicted, Rows, Run, block, predict, rows_of
from .tangent import acting
from .threads import for_each_run
from .unknowns import REACH

_FRICTION_PRIOR = 10.0
"""Standard deviation of the share of friction that acts at the start: it keeps a share bounded
where there is no friction, and biases none.  Most suspensions move as the decay begins, so that the
share is -1 or 1; a prior of 1 about zero pulled all shares inwards, and moved wheels and tyres by
one of their standard deviations."""
_MOUNT_PRIOR_M = 5e8
"""Standard deviation, m, of the mount's first deflection beyond its force, over sigma squared."""
_LARGEST = 1e100
"""Information beyond which a tangent counts as lost."""

Terms = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Known values less those predicted by the unknowns, and the slopes of the latter, in sigmas."""


@dataclass(frozen=True)
class Problem:
    """The decays that are fitted, and the unknowns that are free."""

    model: Model
    runs: tuple[Run, ...]
    centre: NDArray[np.float64]
    """(P,) mean of each prior."""
    prior: NDArray[np.float64]
    """(P,) its standard deviation; infinite where there is none."""
    free: NDArray[np.intp]
    """(F,) positions of the unknowns that are fitted."""

    def releasing(self, free: NDArray[np.intp]) -> Problem:
        """Return the problem with other free unknowns."""
        return replace(self, free=free)

    def fact_terms(self, eta: NDArray[np.float64]) -> Terms:
        """Return misfits, (n,), of the facts, and slopes, (n, F)."""
        misfits, slopes = self.model.fact_misfits(eta)
        return misfits, slopes[:, self.free]

    def prior_terms(self, eta: NDArray[np.float64]) -> Terms:
        """Return misfits and slopes of the priors, and of damper curves that would fall."""
        root = 1.0 / self.prior[self.free]
        pull = (self.centre - eta)[self.free] * root
        lacks, lifts = self.curve_terms(eta)
        flat = lacks > 0.0
        return np.concatenate([pull, lacks[flat]]), np.vstack([np.diag(root), lifts[flat]])

    def curve_terms(self, eta: NDArray[np.float64]) -> Terms:
        """Return the lack of slope of each segment of damper curves, (S,), and its fall, (S, F)."""
        lacks, lifts = too_flat(self.model, eta)
        return lacks, lifts[:, self.free]

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest value of each free unknown."""
        low, high = np.full(len(self.centre), -np.inf), np.full(len(self.centre), np.inf)
        for i, e in enumerate(self.model.elements, start=self.model.first):
            low[i], high[i] = e.unknown(e.low), e.unknown(e.high)
        return low[self.free], high[self.free]

    @property
    def reach(self) -> NDArray[np.float64]:
        """Largest change of each free unknown in one step of a fit, (F,)."""
        reach = np.full(len(self.centre), REACH)
        reach[self.model.first :] = [e.reach for e in self.model.elements]
        return reach[self.free]


@dataclass(frozen=True)
class Point:
    """The problem at one point; its blocks are made on demand."""

    problem: Problem
    eta: NDArray[np.float64]
    initials: tuple[InitialState, ...]
    cars: tuple[Car, ...]
    """Car of each run's mass state."""
    rows: Rows
    predicted: tuple[Predicted, ...]
    cost: float
    grade: Grade


@dataclass(frozen=True)
class Normal:
    """Normal equations at a point."""

    blocks: tuple[Block, ...]
    shared: NDArray[np.float64]
    """(F, F) normal matrix of facts and priors alone."""
    right: NDArray[np.float64]
    """(F,) right-hand side of facts and priors alone."""
    lacks: NDArray[np.float64]
    """Lack of slope of each segment of the damper curves, (S,); negative for steep segments."""
    lifts: NDArray[np.float64]
    """Fall of these lacks per unit of each unknown, (S, F)."""

    def holding(self, flat: NDArray[np.bool_]) -> Normal:
        """Return the equations with the given segments, (S,), held up instead of the flat ones."""
        sign = flat.astype(float) - (self.lacks > 0.0)
        signed = self.lifts.T * sign
        return replace(
            self, shared=self.shared + signed @ self.lifts, right=self.right + signed @ self.lacks
        )

    @property
    def finite(self) -> bool:
        """True unless a tangent grew beyond all numbers: a path may be finite where it is not."""
        return all(np.trace(b.A) + np.trace(b.C) < _LARGEST for b in self.blocks)


def point(
    problem: Problem, eta: NDArray[np.float64], initials: tuple[InitialState, ...], grade: Grade
) -> Point | None:
    """Return the problem at `eta`, (P,); None if a path does not stay finite."""
    model = problem.model
    present = {run.decay.mass_state for run in problem.runs}
    states = {s.name: s for s in model.box.mass_states if s.name in present}
    cars = {name: car(model, eta, state, problem.free) for name, state in states.items()}
    rows = rows_of(model, eta, problem.free)
    step_s = step_of(list(cars.values()), grade)
    each = tuple(cars[run.decay.mass_state] for run in problem.runs)
    paths = integrator.integrate(
        each, initials, [run.end_s for run in problem.runs], step_s, grade.path
    )
    whole = [path for path in paths if path is not None]
    if len(whole) < len(paths):
        return None
    found = for_each_run(partial(predict, model, rows), problem.runs, each, whole)
    cost = sum(one.cost for one in found)
    cost += sum(float(own.friction @ own.friction) / _FRICTION_PRIOR**2 for own in initials)
    for one, own in zip(each, initials, strict=True):
        if one.has_mount:
            cost += float(np.sum((own.mount / _mount_sd(one)) ** 2))
    for misfits, _ in (problem.fact_terms(eta), problem.prior_terms(eta)):
        cost += float(misfits @ misfits)
    return Point(problem, eta, initials, each, rows, found, cost, grade)


def _mount_sd(one: Car) -> NDArray[np.float64]:
    return np.maximum(_MOUNT_PRIOR_M * one.corner[:, MOUNT] ** 2, 1e-9)


def normal(at: Point) -> Normal:
    """Return the normal equations at a point."""
    problem = at.problem
    acts = acting(list({id(one): one for one in at.cars}.values()))
    blocks = for_each_run(
        partial(_block, at, acts), problem.runs, at.cars, at.initials, at.predicted
    )
    n = len(problem.free)
    shared, right = np.zeros((n, n)), np.zeros(n)
    for misfits, slopes in (problem.fact_terms(at.eta), problem.prior_terms(at.eta)):
        shared += slopes.T @ slopes
        right += slopes.T @ misfits
    return Normal(blocks, shared, right, *problem.curve_terms(at.eta))


def _block(
    at: Point, acts: NDArray[np.intp], run: Run, one: Car, own: InitialState, found: Predicted
) -> Block:
    """Return the normal equations of a run, with the priors of its own unknowns."""
    with np.errstate(over="ignore", invalid="ignore"):  # `finite` says so
        given = block(at.problem.model, run, one, at.rows, own, found, acts, at.grade)
    A, right = given.A.copy(), given.own.copy()
    k = np.arange(14, 18)
    A[k, k] += _FRICTION_PRIOR**-2
    right[k] -= own.friction * _FRICTION_PRIOR**-2
    if one.has_mount:
        k = np.arange(18, 22)
        weight = _mount_sd(one) ** -2
        A[k, k] += weight
        right[k] -= own.mount * weight
    return replace(given, A=A, own=right)
