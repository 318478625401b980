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
    delay_index: tuple[int | None, ...]
    """Index of that lateness among the free unknowns; None where it is known."""


def rows_of(model: Model, eta: NDArray[np.float64], free: NDArray[np.intp]) -> Rows:
    """Return the output rows at `eta`, (P,), and their derivatives by the unknowns at `free`."""
    points = stepped(eta)[np.concatenate([[0], 1 + free])]
    motions = model.box.motion_rows(points)
    box = model.box
    delay_index = []
    for i in range(len(box.groups)):
        position = box.delay_index(i)
        is_free = position is not None and position in free
        delay_index.append(int(np.flatnonzero(free == position)[0]) if is_free else None)
    return Rows(
        {name: row[0].real for name, row in motions.items()},
        {name: row[1:].imag / COMPLEX_STEP for name, row in motions.items()},
        box.delays_s(eta),
        tuple(delay_index),
    )


@dataclass(frozen=True, slots=True)
class Predicted:
    """A run's path, and the residuals that it leaves."""

    path: Path
    residuals: tuple[NDArray[np.float64], ...]
    """Measured less predicted of each recording, (n, channels) in units of sigma; the channels' own
    functions are projected out."""
    cost: float


def _path_times(run: Run, rows: Rows, model: Model, r: Recording) -> NDArray[np.float64]:
    """Return the time on the path, s, at which each sample of a recording was taken, (n,)."""
    return np.asarray(r.time_s - rows.delays_s[model.box.groups.index(r.group)] + run.early_s)


def _predicted(
    model: Model, rows: Rows, step_s: float, grade: Grade, run: Run, car: Car, initial: InitialState
) -> Predicted | None:
    """Return a run's path and residuals; None if the path does not stay finite."""
    path = path_of(car, initial, run.end_s, step_s, grade.path)
    if path is None:
        return None
    residuals = []
    for r, weight, basis in zip(run.decay.recordings, run.weights, run.bases, strict=True):
        times_s = _path_times(run, rows, model, r)
        misfit = (r.values - _values(car, rows, path, r, times_s)) * weight
        residuals.append(misfit - basis @ (basis.T @ misfit))
    return Predicted(path, tuple(residuals), float(sum(np.sum(e * e) for e in residuals)))


def _values(
    car: Car, rows: Rows, path: Path, r: Recording, times_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what the channels of a recording show at given times of the path, (n, channels)."""
    low_pass = low_pass_of(r.group.channels[0])
    if not len(low_pass.poles):
        return _seen(rows, r, sample(car, path, times_s))
    return filtered(low_pass, _seen(rows, r, path), path.step_s, times_s)


def _seen(rows: Rows, r: Recording, sampled: Path) -> NDArray[np.float64]:
    """Return what the channels see of a path before their low-pass, (n, channels)."""
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
    """`A`, `B`, `C`: normal matrix of the own, of own by free, and of the free unknowns."""
    own: NDArray[np.float64]
    shared: NDArray[np.float64]
    """`own`, `shared`: right-hand side of the own and of the free unknowns."""
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
    element = model.element_values(stepped(eta))
    full = model.box.full(stepped(eta))
    knots = np.array(model.knots)
    # A knot acts at all speeds beyond it, outwards from rest; a knot at 0 acts in compression.
    edges = np.union1d(knots, [0.0])
    middles = 0.5 * (edges[1:] + edges[:-1])
    speeds = np.concatenate([[edges[0] - 1.0], middles, [edges[-1] + 1.0]])
    slope_by_change = np.where(knots < 0.0, speeds[:, None] < knots, speeds[:, None] > knots)
    of_secant = np.array([secant_share(knot, KNEE_M_S) for knot in model.knots])
    slope_by_change = slope_by_change - of_secant
    relative_slopes = []
    for axle, left_damper in (("f", Full.C_S), ("r", Full.C_S + 2)):
        c_s = 0.5 * (full[:, left_damper] + full[:, left_damper + 1])
        slope_changes = np.stack([element[f"h_{axle}{j + 1}"] for j in range(len(knots))], axis=1)
        relative_slopes.append(1.0 + (slope_changes / c_s[:, None]) @ slope_by_change.T)
    relative = np.concatenate(relative_slopes, axis=1)
    return (_FLOOR - relative[0].real) / _FLOOR_SD, relative[1:].imag.T / COMPLEX_STEP / _FLOOR_SD


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
        inverse_sigma = 1.0 / self.prior[self.free]
        misfits = (self.centre - eta)[self.free] * inverse_sigma
        lacks, lifts = self.curve_terms(eta)
        flat = lacks > 0.0
        slopes = np.vstack([np.diag(inverse_sigma), lifts[flat]])
        return np.concatenate([misfits, lacks[flat]]), slopes

    def curve_terms(self, eta: NDArray[np.float64]) -> Terms:
        """Return the lack of slope of each segment of damper curves, (S,), and its fall, (S, F)."""
        lacks, lifts = too_flat(self.model, eta)
        return lacks, lifts[:, self.free]

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest value of each free unknown."""
        low, high = np.full(len(self.centre), -np.inf), np.full(len(self.centre), np.inf)
        for i, e in enumerate(self.model.elements, start=self.model.n_linear):
            low[i], high[i] = e.unknown(e.low), e.unknown(e.high)
        return low[self.free], high[self.free]

    @property
    def reach(self) -> NDArray[np.float64]:
        """Largest change of each free unknown in one step of a fit, (F,)."""
        reach = np.full(len(self.centre), REACH)
        reach[self.model.n_linear :] = [e.reach for e in self.model.elements]
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
        """True unless a tangent grew beyond all numbers, which it may on a finite path."""
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
    cars_of_runs = tuple(cars[run.decay.mass_state] for run in problem.runs)
    predict = partial(_predicted, model, rows, step_of(cars.values(), grade), grade)
    predictions = for_each_run(predict, problem.runs, cars_of_runs, initials)
    predicted = tuple(one for one in predictions if one is not None)
    if len(predicted) < len(predictions):
        return None
    cost = sum(one.cost for one in predicted)
    cost += sum(float(x0.friction @ x0.friction) / _FRICTION_PRIOR**2 for x0 in initials)
    for vehicle, initial in zip(cars_of_runs, initials, strict=True):
        if vehicle.has_mount:
            cost += float(np.sum((initial.mount / _mount_sd(vehicle)) ** 2))
    for misfits, _ in (problem.fact_terms(eta), problem.prior_terms(eta)):
        cost += float(misfits @ misfits)
    return Point(problem, eta, initials, cars_of_runs, rows, predicted, cost, grade)


def _mount_sd(car: Car) -> NDArray[np.float64]:
    # The mount's first deflection beyond its force has a deviation of 5e8 sigma^2, m.
    return np.maximum(5e8 * car.corner[:, MOUNT] ** 2, 1e-9)


def _block(at: Point, run: Run, car: Car, initial: InitialState, predicted: Predicted) -> Block:
    """Return the normal equations of a run, with the priors of its own unknowns."""
    jacobian = _jacobian(at, run, car, initial, predicted.path)
    size = jacobian[0].shape[2]
    n_own = size - len(at.problem.free)
    normal, right = np.zeros((size, size)), np.zeros(size)
    with np.errstate(over="ignore", invalid="ignore"):  # `finite` says so
        for J, residuals in zip(jacobian, predicted.residuals, strict=True):
            rows = J.reshape(-1, size)
            normal += rows.T @ rows
            right += rows.T @ residuals.ravel()
    index = np.arange(14, 18)  # of the shares of friction among the own unknowns
    normal[index, index] += _FRICTION_PRIOR**-2
    right[index] -= initial.friction * _FRICTION_PRIOR**-2
    if car.has_mount:
        index = np.arange(18, 22)  # of the mounts
        weight = _mount_sd(car) ** -2
        normal[index, index] += weight
        right[index] -= initial.mount * weight
    return Block(
        normal[:n_own, :n_own], normal[:n_own, n_own:], normal[n_own:, n_own:],
        right[:n_own], right[n_own:], jacobian,
    )  # fmt: skip


def _jacobian(
    at: Point, run: Run, car: Car, initial: InitialState, path: Path
) -> tuple[NDArray[np.float64], ...]:
    """Return the derivatives of each recording, (n, channels, own + free), in units of sigma."""
    model, rows = at.problem.model, at.rows
    filter_grid_s = np.arange(0.0, path.end_s + 1e-9, at.grade.filter_s)
    n_odd = len(filter_grid_s) - (len(filter_grid_s) + 1) % 2  # as `filtered` takes them
    filter_grid_s = filter_grid_s[:n_odd]
    of_recordings = []
    for r in run.decay.recordings:
        has_filter = len(low_pass_of(r.group.channels[0]).poles) > 0
        orders = np.array([TIME_DERIVATIVE[channel.quantity] for channel in r.group.channels])
        of_motion = np.stack([rows.rows[channel.name] for channel in r.group.channels])
        times_s = filter_grid_s if has_filter else _path_times(run, rows, model, r)
        of_recordings.append(Channels(times_s, orders, of_motion))
    result = []
    for r, weight, basis, channels, J in zip(
        run.decay.recordings, run.weights, run.bases, of_recordings,
        tangents(car, path, initial, at.grade, of_recordings), strict=True,
    ):  # fmt: skip
        n_own = J.shape[2] - len(at.problem.free)
        sampled = sample(car, path, channels.times_s)
        for c, channel in enumerate(r.group.channels):
            row_unknowns = np.flatnonzero(rows.slopes[channel.name].any(axis=1))
            motion = sampled.motion(int(channels.orders[c]))
            J[:, c, n_own + row_unknowns] += motion @ rows.slopes[channel.name][row_unknowns].T
        if channels.times_s is filter_grid_s:
            low_pass = low_pass_of(r.group.channels[0])
            J = filtered(low_pass, J, at.grade.filter_s, _path_times(run, rows, model, r))
        delay_index = rows.delay_index[model.box.groups.index(r.group)]
        if delay_index is not None:
            times_s = _path_times(run, rows, model, r)
            both_s = np.concatenate([times_s + _LATE_S, times_s - _LATE_S])
            later, earlier = np.split(_values(car, rows, path, r, both_s), 2)
            J[:, :, n_own + delay_index] -= (later - earlier) / (2.0 * _LATE_S)
        J *= weight[:, None]
        columns = J.reshape(len(J), -1)
        columns -= basis @ (basis.T @ columns)
        result.append(J)
    return tuple(result)
