"""All runs, facts and priors at one point of the unknowns: cost and normal equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE

from ..decays.decay import FreeDecay, Recording
from ..model.exponentials import low_pass_of
from ..model.matrices import COMPLEX_STEP, Full, stepped
from .car import KNEE_M_S, MOUNT, REACH, Car, Model, car
from .laws import secant_share
from .path import (
    Channels,
    Grade,
    InitialState,
    Path,
    filtered,
    for_each_run,
    path_of,
    sample,
    step_of,
    tangents,
)

# One run: the model's prediction of its samples, and its normal equations -------------------------

_LATE_S = 2e-4
"""Step, s, of the derivative of a channel by time."""
_EARLY_SIGMAS = 4.0


@dataclass(frozen=True)
class Run:
    """A free decay, with all that it needs from the problem."""

    decay: FreeDecay
    weights: tuple[NDArray[np.float64], ...]
    """Inverse standard deviation of each channel of each recording."""
    early_s: float
    """Time by which the path begins before the window, s, for sensors that may be late."""

    @cached_property
    def bases(self) -> tuple[NDArray[np.float64], ...]:
        """Orthonormal basis of the channels' own functions in each recording, (n, k)."""
        result = []
        for r in self.decay.recordings:
            own = low_pass_of(r.group.channels[0]).transients(r.time_s)
            result.append(np.linalg.qr(np.hstack([np.ones((len(r.time_s), 1)), own]))[0])
        return tuple(result)

    @property
    def freedom(self) -> float:
        """Number of samples less that of the channels' own unknowns."""
        pairs = zip(self.decay.recordings, self.bases, strict=True)
        return float(sum((len(q) - q.shape[1]) * r.values.shape[1] for r, q in pairs))

    @property
    def end_s(self) -> float:
        """Length of the path, s."""
        last = max(float(r.time_s[-1]) for r in self.decay.recordings)
        return last + 2.0 * self.early_s + 2e-3


def run_of(model: Model, decay: FreeDecay, sigma: Mapping[str, float]) -> Run:
    """Return a decay ready to be fitted."""
    weights = tuple(
        np.array([1.0 / sigma[c.name] for c in r.group.channels]) for r in decay.recordings
    )
    unsure = max((group.delay_sigma_s for group in model.box.groups), default=0.0)
    return Run(decay, weights, _EARLY_SIGMAS * unsure + 2.0 * _LATE_S * (unsure > 0.0))


@dataclass(frozen=True, slots=True)
class Rows:
    """Output rows of all channels on the seven motions at one point, with their derivatives."""

    rows: Mapping[str, NDArray[np.float64]]
    """(7,) of each channel."""
    slopes: Mapping[str, NDArray[np.float64]]
    """(F, 7)."""
    delays_s: NDArray[np.float64]
    """Lateness of each clock beyond its nominal one, s."""
    late: tuple[int | None, ...]
    """Index, among the free unknowns, of that lateness."""


def rows_of(model: Model, eta: NDArray[np.float64], free: NDArray[np.intp]) -> Rows:
    """Return the output rows at `eta`, (P,), and their derivatives by the unknowns at `free`."""
    points = stepped(eta)[np.concatenate([[0], 1 + free])]
    motions = model.box.motion_rows(points)
    box = model.box
    late = []
    for i in range(len(box.groups)):
        p = box.delay_index(i)
        late.append(int(np.flatnonzero(free == p)[0]) if p is not None and p in free else None)
    return Rows(
        {name: row[0].real for name, row in motions.items()},
        {name: row[1:].imag / COMPLEX_STEP for name, row in motions.items()},
        box.delays_s(eta),
        tuple(late),
    )


@dataclass(frozen=True, slots=True)
class Predicted:
    """A run's path, and the residuals that it leaves."""

    path: Path
    left: tuple[NDArray[np.float64], ...]
    """Measured less predicted of each recording, (n, channels) in units of sigma; the channels' own
    functions are projected out."""
    cost: float


def _times(run: Run, rows: Rows, model: Model, r: Recording) -> NDArray[np.float64]:
    return np.asarray(r.time_s - rows.delays_s[model.box.groups.index(r.group)] + run.early_s)


def _predicted(
    model: Model, rows: Rows, step_s: float, grade: Grade, run: Run, one: Car, own: InitialState
) -> Predicted | None:
    """Return a run's path and residuals; None if the path does not stay finite."""
    path = path_of(one, own, run.end_s, step_s, grade.path)
    if path is None:
        return None
    left = []
    for r, weight, basis in zip(run.decay.recordings, run.weights, run.bases, strict=True):
        error = (r.values - _values(one, rows, path, r, _times(run, rows, model, r))) * weight
        left.append(error - basis @ (basis.T @ error))
    return Predicted(path, tuple(left), float(sum(np.sum(e * e) for e in left)))


def _values(
    car: Car, rows: Rows, path: Path, r: Recording, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    low_pass = low_pass_of(r.group.channels[0])
    if not len(low_pass.poles):
        return _seen(rows, r, sample(car, path, times))
    return filtered(low_pass, _seen(rows, r, path), path.step_s, times)


def _seen(rows: Rows, r: Recording, sampled: Path) -> NDArray[np.float64]:
    columns = [
        sampled.motion(TIME_DERIVATIVE[c.quantity]) @ rows.rows[c.name] for c in r.group.channels
    ]
    return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True)
class Block:
    """Normal equations of one run: its own unknowns, then the free ones of the car."""

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    own: NDArray[np.float64]
    """Right-hand side of the run's own unknowns."""
    shared: NDArray[np.float64]
    jacobian: tuple[NDArray[np.float64], ...]
    """Jacobian of each recording, (n, channels, own + free), in units of sigma."""


# Terms that keep a damper's force from falling as the speed grows ---------------------------------
#
# A force that falls as the speed grows feeds energy into the car: no damper does it, and on a
# mount such a curve has no finite path.  The data do not prevent this at speeds that hardly occur,
# so one-sided terms raise slopes below a floor; slopes above it are not affected.

_FLOOR, _FLOOR_SD = 0.02, 0.01
"""Least slope of a damper's curve over its coefficient, and the deviation at which a smaller one
counts."""


def too_flat(
    model: Model, eta: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by how much each segment of the dampers' curves is flatter than the floor.

    `eta`: (P,).  Returns (segments,) float64, front first, in units of the floor's deviation,
    negative where a segment is steeper; and its fall per unit of each unknown, (segments, P).
    Negative values cost nothing.
    """
    value = model.element_values(stepped(eta))
    full = model.box.full(stepped(eta))
    knots = np.array(model.knots)
    # A knot acts at all speeds beyond it, outwards from rest; a knot at 0 acts in compression.
    edges = np.union1d(knots, [0.0])
    middles = 0.5 * (edges[1:] + edges[:-1])
    speeds = np.concatenate([[edges[0] - 1.0], middles, [edges[-1] + 1.0]])
    beyond = np.where(knots < 0.0, speeds[:, None] < knots, speeds[:, None] > knots)
    beyond = beyond - np.array([secant_share(knot, KNEE_M_S) for knot in model.knots])
    of_axles = []
    for axle, left in (("f", Full.C_S), ("r", Full.C_S + 2)):
        c = 0.5 * (full[:, left] + full[:, left + 1])
        h = np.stack([value[f"h_{axle}{j + 1}"] for j in range(len(knots))], axis=1)
        of_axles.append(1.0 + (h / c[:, None]) @ beyond.T)
    shares = np.concatenate(of_axles, axis=1)
    return (_FLOOR - shares[0].real) / _FLOOR_SD, shares[1:].imag.T / COMPLEX_STEP / _FLOOR_SD


# The problem --------------------------------------------------------------------------------------

_FRICTION_PRIOR = 10.0
"""Standard deviation of the share of friction that acts at the start: it keeps a share bounded
where there is no friction, and biases none.  Most suspensions move as the decay begins, so that the
share is -1 or 1; a prior of 1 about zero pulled all shares inwards, and moved wheels and tyres by
one of their standard deviations."""

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

    @cached_property
    def normal(self) -> Normal:
        """Normal equations at this point."""
        problem = self.problem
        blocks = for_each_run(
            partial(_block, self), problem.runs, self.cars, self.initials, self.predicted
        )
        n = len(problem.free)
        shared, right = np.zeros((n, n)), np.zeros(n)
        for misfits, slopes in (problem.fact_terms(self.eta), problem.prior_terms(self.eta)):
            shared += slopes.T @ slopes
            right += slopes.T @ misfits
        return Normal(blocks, shared, right, *problem.curve_terms(self.eta))


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
        return all(np.trace(b.A) + np.trace(b.C) < 1e100 for b in self.blocks)


def point(
    problem: Problem, eta: NDArray[np.float64], initials: tuple[InitialState, ...], grade: Grade
) -> Point | None:
    """Return the problem at `eta`, (P,); None if a path does not stay finite."""
    model = problem.model
    present = {run.decay.mass_state for run in problem.runs}
    states = {s.name: s for s in model.box.mass_states if s.name in present}
    cars = {name: car(model, eta, state, problem.free) for name, state in states.items()}
    rows = rows_of(model, eta, problem.free)
    each = tuple(cars[run.decay.mass_state] for run in problem.runs)
    along = partial(_predicted, model, rows, step_of(cars.values(), grade), grade)
    tried = for_each_run(along, problem.runs, each, initials)
    predicted = tuple(one for one in tried if one is not None)
    if len(predicted) < len(tried):
        return None
    cost = sum(one.cost for one in predicted)
    cost += sum(float(own.friction @ own.friction) / _FRICTION_PRIOR**2 for own in initials)
    for one, own in zip(each, initials, strict=True):
        if one.has_mount:
            cost += float(np.sum((own.mount / _mount_sd(one)) ** 2))
    for misfits, _ in (problem.fact_terms(eta), problem.prior_terms(eta)):
        cost += float(misfits @ misfits)
    return Point(problem, eta, initials, each, rows, predicted, cost, grade)


def _mount_sd(one: Car) -> NDArray[np.float64]:
    # The mount's first deflection beyond its force has a deviation of 5e8 sigma^2, m.
    return np.maximum(5e8 * one.corner[:, MOUNT] ** 2, 1e-9)


def _block(at: Point, run: Run, one: Car, own: InitialState, predicted: Predicted) -> Block:
    """Return the normal equations of a run, with the priors of its own unknowns."""
    jacobian = _jacobian(at, run, one, own, predicted.path)
    size = jacobian[0].shape[2]
    n_own = size - len(at.problem.free)
    normal, right = np.zeros((size, size)), np.zeros(size)
    with np.errstate(over="ignore", invalid="ignore"):  # `finite` says so
        for J, left in zip(jacobian, predicted.left, strict=True):
            flat = J.reshape(-1, size)
            normal += flat.T @ flat
            right += flat.T @ left.ravel()
    k = np.arange(14, 18)
    normal[k, k] += _FRICTION_PRIOR**-2
    right[k] -= own.friction * _FRICTION_PRIOR**-2
    if one.has_mount:
        k = np.arange(18, 22)
        weight = _mount_sd(one) ** -2
        normal[k, k] += weight
        right[k] -= own.mount * weight
    return Block(
        normal[:n_own, :n_own], normal[:n_own, n_own:], normal[n_own:, n_own:],
        right[:n_own], right[n_own:], jacobian,
    )  # fmt: skip


def _jacobian(
    at: Point, run: Run, one: Car, own: InitialState, path: Path
) -> tuple[NDArray[np.float64], ...]:
    """Return the derivatives of each recording, (n, channels, own + free), in units of sigma."""
    model, rows = at.problem.model, at.rows
    grid = np.arange(0.0, path.end_s + 1e-9, at.grade.filter_s)
    grid = grid[: len(grid) - (len(grid) + 1) % 2]
    seen = []
    for r in run.decay.recordings:
        filters = len(low_pass_of(r.group.channels[0]).poles) > 0
        orders = np.array([TIME_DERIVATIVE[channel.quantity] for channel in r.group.channels])
        of_motion = np.stack([rows.rows[channel.name] for channel in r.group.channels])
        times_s = grid if filters else _times(run, rows, model, r)
        seen.append(Channels(times_s, orders, of_motion))
    result = []
    for r, weight, basis, channels, J in zip(
        run.decay.recordings, run.weights, run.bases, seen,
        tangents(one, path, own, at.grade, seen), strict=True,
    ):  # fmt: skip
        n_own = J.shape[2] - len(at.problem.free)
        sampled = sample(one, path, channels.times_s)
        for c, channel in enumerate(r.group.channels):
            moves = np.flatnonzero(rows.slopes[channel.name].any(axis=1))
            motion = sampled.motion(int(channels.orders[c]))
            J[:, c, n_own + moves] += motion @ rows.slopes[channel.name][moves].T
        if channels.times_s is grid:
            low_pass = low_pass_of(r.group.channels[0])
            J = filtered(low_pass, J, at.grade.filter_s, _times(run, rows, model, r))
        late = rows.late[model.box.groups.index(r.group)]
        if late is not None:
            asked = _times(run, rows, model, r)
            both = np.concatenate([asked + _LATE_S, asked - _LATE_S])
            after, before = np.split(_values(one, rows, path, r, both), 2)
            J[:, :, n_own + late] -= (after - before) / (2.0 * _LATE_S)
        J *= weight[:, None]
        flat = J.reshape(len(J), -1)
        flat -= basis @ (basis.T @ flat)
        result.append(J)
    return tuple(result)
