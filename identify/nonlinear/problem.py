"""All runs, facts and priors at one point of the unknowns: cost and normal equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE

from ..decays.decay import ChannelGroup, FreeDecay, Recording
from ..model.exponentials import low_pass_of
from ..model.matrices import COMPLEX_STEP, Full, Real, stepped
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

_STEP_S = 2e-4
"""Step, s, of the derivative of a channel by time."""


@dataclass(frozen=True)
class Run:
    """A free decay, with all that it needs from the problem."""

    decay: FreeDecay
    weights: tuple[Real, ...]
    """Inverse standard deviation of each channel of each recording."""
    early_s: float
    """Time by which the path begins before the window, s, for sensors that may be late."""

    @cached_property
    def bases(self) -> tuple[Real, ...]:
        """Orthonormal basis in each recording, (n, k), of an offset and transients of the low-pass.

        Every channel has its own sizes of them.
        """
        result = []
        for r in self.decay.recordings:
            transients = low_pass_of(r.group.channels[0]).transients(r.time_s)
            result.append(np.linalg.qr(np.hstack([np.ones((len(r.time_s), 1)), transients]))[0])
        return tuple(result)

    @property
    def freedom(self) -> float:
        """Number of samples less that of the channels' own unknowns."""
        pairs = zip(self.decay.recordings, self.bases, strict=True)
        return float(sum((len(q) - q.shape[1]) * r.values.shape[1] for r, q in pairs))

    @property
    def end_s(self) -> float:
        """Length of the path, s, with 2 ms to spare."""
        last_s = max(float(r.time_s[-1]) for r in self.decay.recordings)
        return last_s + 2.0 * self.early_s + 2e-3


def run_of(model: Model, decay: FreeDecay, sigma: Mapping[str, float]) -> Run:
    """Return a decay ready to be fitted; `sigma`: standard deviation of each channel's noise."""
    weights = tuple(
        np.array([1.0 / sigma[c.name] for c in r.group.channels]) for r in decay.recordings
    )
    delay_sigma_s = max((group.delay_sigma_s for group in model.box.groups), default=0.0)
    # Room for a lateness of four sigma, and for the step of its derivative.
    early_s = 4.0 * delay_sigma_s + 2.0 * _STEP_S if delay_sigma_s > 0.0 else 0.0
    return Run(decay, weights, early_s)


@dataclass(frozen=True, slots=True)
class Rows:
    """Output rows of all channels on the seven motions at one point, with their derivatives."""

    rows: Mapping[str, Real]
    """(7,) of each channel."""
    slopes: Mapping[str, Real]
    """(F, 7) of each channel, by the free unknowns."""
    delays_s: Mapping[ChannelGroup, float]
    """Lateness of each clock beyond its nominal one, s."""


def rows_of(model: Model, eta: Real, free: NDArray[np.intp]) -> Rows:
    """Return the output rows at `eta`, (P,), and their derivatives by the unknowns at `free`."""
    motions = model.box.motion_rows(stepped(eta)[np.concatenate([[0], 1 + free])])
    return Rows(
        {name: row[0].real for name, row in motions.items()},
        {name: row[1:].imag / COMPLEX_STEP for name, row in motions.items()},
        dict(zip(model.box.groups, model.box.delays_s(eta).tolist(), strict=True)),
    )


@dataclass(frozen=True, slots=True)
class Predicted:
    """A run's path, and the residuals that it leaves."""

    path: Path
    residuals: tuple[Real, ...]
    """Measured less predicted of each recording, (n, channels) in units of sigma; offsets and
    transients are projected out."""
    cost: float
    """Sum of the squared residuals."""


def _path_times(run: Run, rows: Rows, r: Recording) -> Real:
    """Return the time on the path, s, at which each sample of a recording was taken, (n,)."""
    return np.asarray(r.time_s - rows.delays_s[r.group] + run.early_s)


def _predicted(
    rows: Rows, step_s: float, grade: Grade, run: Run, car: Car, initial: InitialState
) -> Predicted | None:
    """Return a run's path and residuals; None if the path does not stay finite."""
    path = path_of(car, initial, run.end_s, step_s, grade.path)
    if path is None:
        return None
    residuals = []
    for r, weight, basis in zip(run.decay.recordings, run.weights, run.bases, strict=True):
        misfit = (r.values - _values(car, rows, path, r, _path_times(run, rows, r))) * weight
        residuals.append(misfit - basis @ (basis.T @ misfit))
    return Predicted(path, tuple(residuals), float(sum(np.sum(e * e) for e in residuals)))


def _values(car: Car, rows: Rows, path: Path, r: Recording, times_s: Real) -> Real:
    """Return what the channels of a recording show at given times of the path, (n, channels)."""
    channels = r.group.channels
    low_pass = low_pass_of(channels[0])
    has_filter = len(low_pass.poles) > 0
    sampled = path if has_filter else sample(car, path, times_s)
    columns = [sampled.motion(TIME_DERIVATIVE[c.quantity]) @ rows.rows[c.name] for c in channels]
    values = np.stack(columns, axis=1)
    return filtered(low_pass, values, path.step_s, times_s) if has_filter else values


@dataclass(frozen=True, slots=True)
class Block:
    """Normal equations of one run: its own unknowns, then the free ones of the car.

    `A`, `B`, `C`: normal matrix of the own, of own by free, and of the free unknowns.  `right_own`,
    `right_free`: right-hand side of the own and of the free unknowns.
    """

    A: Real
    B: Real
    C: Real
    right_own: Real
    right_free: Real
    jacobian: tuple[Real, ...]
    """Jacobian of each recording, (n, channels, own + free), in units of sigma."""


# Terms that keep a damper's force from falling as the speed grows ---------------------------------
#
# A force that falls as the speed grows feeds energy into the car: no damper does it, and on a
# mount such a curve has no finite path.  The data do not prevent this at speeds that hardly occur,
# so one-sided terms raise slopes below a floor; slopes above it are not affected.


def slope_deficits(model: Model, eta: Real) -> tuple[Real, Real]:
    """Return by how much each segment of the dampers' curves is flatter than the floor, (S,).

    The floor is 0.02 +- 0.01 of the damper's coefficient; in units of that deviation, front first.
    Negative values, of steeper segments, cost nothing.  Then the fall of each per unit of each
    unknown, (S, P).  `eta`: (P,).
    """
    element = model.element_values(stepped(eta))
    full = model.box.full(stepped(eta))
    knots = np.array(model.knots)
    edges = np.union1d(knots, [0.0])
    middles = 0.5 * (edges[1:] + edges[:-1])
    # A speed within each segment; the first and the last one have no end.  (S, 1)
    speeds = np.concatenate([[edges[0] - 1.0], middles, [edges[-1] + 1.0]])[:, None]
    # A knot acts at all speeds beyond it, outwards from rest; a knot at 0 acts in compression.
    slope_by_change = np.where(knots < 0.0, speeds < knots, speeds > knots)  # (S, knots)
    slope_by_change = slope_by_change - [secant_share(knot, KNEE_M_S) for knot in model.knots]
    relative_slopes = []
    for axle, left_damper in (("f", Full.C_S), ("r", Full.C_S + 2)):
        c_s = 0.5 * (full[:, left_damper] + full[:, left_damper + 1])
        slope_changes = np.stack([element[f"h_{axle}{j + 1}"] for j in range(len(knots))], axis=1)
        relative_slopes.append(1.0 + (slope_changes / c_s[:, None]) @ slope_by_change.T)
    relative = np.concatenate(relative_slopes, axis=1)
    return (0.02 - relative[0].real) / 0.01, relative[1:].imag.T / COMPLEX_STEP / 0.01


# The problem --------------------------------------------------------------------------------------

_FRICTION_PRIOR = 10.0
"""Standard deviation of the share of friction that acts at the start: it keeps a share bounded
where there is no friction, and biases none.  Most suspensions move as the decay begins, so that the
share is -1 or 1; a prior of 1 about zero pulled all shares inwards, and moved wheels and tyres by
one of their standard deviations."""


@dataclass(frozen=True)
class Problem:
    """The decays that are fitted, and the unknowns that are free."""

    model: Model
    runs: tuple[Run, ...]
    centre: Real
    """(P,) mean of each prior."""
    prior: Real
    """(P,) its standard deviation; infinite where there is none."""
    free: NDArray[np.intp]
    """(F,) positions of the unknowns that are fitted."""

    def fact_terms(self, eta: Real) -> tuple[Real, Real]:
        """Return stated less predicted value of each fact, (n,), in sigmas, and slopes, (n, F)."""
        misfits, slopes = self.model.fact_misfits(eta)
        return misfits, slopes[:, self.free]

    def prior_terms(self, eta: Real) -> tuple[Real, Real]:
        """Return misfits, (n,), and slopes, (n, F), of priors, then of flat segments of curves."""
        inverse_sigma = 1.0 / self.prior[self.free]
        misfits = (self.centre - eta)[self.free] * inverse_sigma
        deficits, falls = self.curve_terms(eta)
        flat = deficits > 0.0
        slopes = np.vstack([np.diag(inverse_sigma), falls[flat]])
        return np.concatenate([misfits, deficits[flat]]), slopes

    def curve_terms(self, eta: Real) -> tuple[Real, Real]:
        """Return `slope_deficits`, (S,), and their fall by each free unknown, (S, F)."""
        deficits, falls = slope_deficits(self.model, eta)
        return deficits, falls[:, self.free]

    @property
    def bounds(self) -> tuple[Real, Real]:
        """Lowest and highest value of each free unknown, (F,) each."""
        low, high = np.full(len(self.centre), -np.inf), np.full(len(self.centre), np.inf)
        for i, e in enumerate(self.model.elements, start=self.model.n_linear):
            low[i], high[i] = e.unknown(e.low), e.unknown(e.high)
        return low[self.free], high[self.free]

    @property
    def reach(self) -> Real:
        """Largest change of each free unknown in one step of a fit, (F,)."""
        reach = np.full(len(self.centre), REACH)
        reach[self.model.n_linear :] = [e.reach for e in self.model.elements]
        return reach[self.free]


@dataclass(frozen=True)
class Point:
    """The problem at one point; its blocks are made on demand."""

    problem: Problem
    eta: Real
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
        matrix, right = np.zeros((n, n)), np.zeros(n)
        for misfits, slopes in (problem.fact_terms(self.eta), problem.prior_terms(self.eta)):
            matrix += slopes.T @ slopes
            right += slopes.T @ misfits
        return Normal(blocks, matrix, right, *problem.curve_terms(self.eta))


@dataclass(frozen=True)
class Normal:
    """Normal equations at a point."""

    blocks: tuple[Block, ...]
    matrix: Real
    """(F, F) normal matrix of facts and priors alone, the terms of flat segments included."""
    right: Real
    """(F,) right-hand side of the same."""
    deficits: Real
    """`slope_deficits` of the segments of the damper curves, (S,)."""
    falls: Real
    """Fall of these deficits per unit of each free unknown, (S, F)."""

    def with_terms_of(self, flat: NDArray[np.bool_]) -> Normal:
        """Return the equations with the terms of the given segments, (S,), in place of the flat."""
        sign = flat.astype(float) - (self.deficits > 0.0)  # 1 for terms to add, -1 to take out
        signed = self.falls.T * sign
        matrix = self.matrix + signed @ self.falls
        return replace(self, matrix=matrix, right=self.right + signed @ self.deficits)

    @property
    def finite(self) -> bool:
        """True unless a tangent grew beyond all numbers, which it may on a finite path."""
        return all(np.trace(b.A) + np.trace(b.C) < 1e100 for b in self.blocks)


def point_at(
    problem: Problem, eta: Real, initials: tuple[InitialState, ...], grade: Grade
) -> Point | None:
    """Return the problem at `eta`, (P,); None if a path does not stay finite."""
    model = problem.model
    present = {run.decay.mass_state for run in problem.runs}
    states = {s.name: s for s in model.box.mass_states if s.name in present}
    cars = {name: car(model, eta, state, problem.free) for name, state in states.items()}
    rows = rows_of(model, eta, problem.free)
    cars_of_runs = tuple(cars[run.decay.mass_state] for run in problem.runs)
    predict = partial(_predicted, rows, step_of(cars.values(), grade), grade)
    of_runs = for_each_run(predict, problem.runs, cars_of_runs, initials)
    predicted = tuple(of_run for of_run in of_runs if of_run is not None)
    if len(predicted) < len(of_runs):
        return None
    cost = sum(of_run.cost for of_run in predicted)
    cost += sum(float(x0.friction @ x0.friction) / _FRICTION_PRIOR**2 for x0 in initials)
    for vehicle, x0 in zip(cars_of_runs, initials, strict=True):
        if vehicle.has_mount:
            cost += float(np.sum((x0.mount / _mount_sd(vehicle)) ** 2))
    for misfits, _ in (problem.fact_terms(eta), problem.prior_terms(eta)):
        cost += float(misfits @ misfits)
    return Point(problem, eta, initials, cars_of_runs, rows, predicted, cost, grade)


def _mount_sd(car: Car) -> Real:
    """Return the deviation of the mounts' first deflection beyond that of their force, (4,) m."""
    # The deflection under 500 N at a compliance of 1e-6 m/N; under less at a stiffer mount.
    return np.maximum(5e8 * car.corner[:, MOUNT] ** 2, 1e-9)


def _block(point: Point, run: Run, car: Car, initial: InitialState, predicted: Predicted) -> Block:
    """Return the normal equations of a run, with the priors of its own unknowns."""
    jacobian = _jacobian(point, run, car, initial, predicted.path)
    size = jacobian[0].shape[2]
    n_own = size - len(point.problem.free)
    normal, right = np.zeros((size, size)), np.zeros(size)
    with np.errstate(over="ignore", invalid="ignore"):  # see `Normal.finite`
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
    point: Point, run: Run, car: Car, initial: InitialState, path: Path
) -> tuple[Real, ...]:
    """Return the derivatives of each recording, (n, channels, own + free), in units of sigma.

    Offsets and transients are projected out, as of the residuals.
    """
    model, rows, free = point.problem.model, point.rows, point.problem.free
    filter_grid_s = np.arange(0.0, path.end_s + 1e-9, point.grade.filter_s)
    n_odd = len(filter_grid_s) - (len(filter_grid_s) + 1) % 2  # as `filtered` takes them
    filter_grid_s = filter_grid_s[:n_odd]
    of_recordings = []
    for r in run.decay.recordings:
        has_filter = len(low_pass_of(r.group.channels[0]).poles) > 0
        orders = np.array([TIME_DERIVATIVE[channel.quantity] for channel in r.group.channels])
        of_motion = np.stack([rows.rows[channel.name] for channel in r.group.channels])
        times_s = filter_grid_s if has_filter else _path_times(run, rows, r)
        of_recordings.append(Channels(times_s, orders, of_motion))
    result = []
    for r, weight, basis, channels, J in zip(
        run.decay.recordings, run.weights, run.bases, of_recordings,
        tangents(car, path, initial, point.grade, of_recordings), strict=True,
    ):  # fmt: skip
        n_own = J.shape[2] - len(free)
        times_s = _path_times(run, rows, r)
        sampled = sample(car, path, channels.times_s)
        # A place or a gain changes what a channel sees of the motion.
        for c, channel in enumerate(r.group.channels):
            row_unknowns = np.flatnonzero(rows.slopes[channel.name].any(axis=1))
            motion = sampled.motion(int(channels.orders[c]))
            J[:, c, n_own + row_unknowns] += motion @ rows.slopes[channel.name][row_unknowns].T
        if channels.times_s is filter_grid_s:
            J = filtered(low_pass_of(r.group.channels[0]), J, point.grade.filter_s, times_s)
        position_of_delay = model.box.delay_index(model.box.groups.index(r.group))
        if position_of_delay is not None and position_of_delay in free:
            both_s = np.concatenate([times_s + _STEP_S, times_s - _STEP_S])
            later, earlier = np.split(_values(car, rows, path, r, both_s), 2)
            by_delay = n_own + int(np.flatnonzero(free == position_of_delay)[0])
            J[:, :, by_delay] -= (later - earlier) / (2.0 * _STEP_S)
        J *= weight[:, None]
        columns = J.reshape(len(J), -1)
        columns -= basis @ (basis.T @ columns)
        result.append(J)
    return tuple(result)
