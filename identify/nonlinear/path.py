"""Path and tangents of a run: all states over time, and their values at the samples."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from math import ceil
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..model.exponentials import LowPass
from . import columns, kernels
from .car import BETA, GAP, K_B, K_T, KNEES, LENGTH, MOUNT, RATIO, STATIC, C, Car, X, Y
from .columns import LANES
from .laws import knee, knee_slope, tyre_load

# Step sizes of the integration, and rounding of the corners of the force laws ---------------------


class Level(NamedTuple):
    """Rounding of the force laws; a tuple of numbers, so that compiled code can take it."""

    knee_m_s: float
    """Rounding of the damper's knees, m/s."""
    turn_m_s: float
    """Rounding of the speed at which friction reverses, m/s."""
    lag_s: float
    """Lag of friction, s: bounds how fast it reverses at high speed."""
    loss_s: float
    """Loss of the damper's mount over its stiffness (t0), s."""
    stop_m: float
    """Rounding of the corner of the bump stop, m."""
    load_n: float
    """Rounding of the load at which a tyre meets the road, N: small compared with any static
    load."""


class Grade(NamedTuple):
    """Steps and rounding of path and tangents at one stage of a fit."""

    path: Level
    """Rounding of the path: the loss of the mount and the lag of the friction bound its step."""
    step_s: float
    """Step of the path, s."""
    tangent_steps: int
    """Number of path steps in one tangent step, between the events."""
    mounted_steps: int
    """The same number with a damper on a mount."""
    fine_steps: int
    """The same number where a wheel reverses or leaves the road, or a stop is touched; even,
    because the middle of a step must be a node of the path."""
    coarse: Level
    """Rounding of the tangents between the events."""
    fine: Level
    """Rounding of the tangents at the events."""
    filter_s: float
    """Spacing of the tangents, s, at the input of a sensor's low-pass."""


PATH = Level(0.0005, 0.01e-3, 0.02e-3, 0.12e-3, 0.05e-3, 20.0)
"""Rounding of the exact path: too small to be visible in the parameters.

A corner that sticks loses its friction as if it crept by the rounding of the turn: 0.2 mm/s moved
masses and springs of a car with solid axles by 1.5 standard deviations, and knees of 2 mm/s by
0.6."""

ROUGH = Grade(
    Level(0.004, 0.0005, 0.25e-3, 0.25e-3, 0.1e-3, 60.0), 2.5e-3 / 4, 4, 2, 2,
    Level(0.010, 0.003, 1.2e-3, 0.5e-3, 0.5e-3, 200.0),
    Level(0.005, 0.001, 0.5e-3, 0.5e-3, 0.2e-3, 100.0),
    2.5e-3,
)  # fmt: skip
"""Grade of the search: finds the optimum to a few standard deviations, at a third of the work."""
USUAL = Grade(
    PATH, 2.5e-3 / 8, 8, 4, 2,
    Level(0.010, 0.003, 1.2e-3, 0.5e-3, 0.5e-3, 200.0),
    Level(0.002, 0.0005, 0.02e-3, 0.25e-3, 0.1e-3, 60.0),
    2.5e-3,
)  # fmt: skip
"""Grade with an exact path, and tangents that are good enough for the steps of a fit."""
POLISH = Grade(
    PATH, 2.5e-3 / 10, 2, 2, 2,
    Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3, 60.0),
    Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3, 60.0),
    1e-3,
)  # fmt: skip
"""Grade of the last steps of a fit, and of its covariance."""


# The path -----------------------------------------------------------------------------------------

STATES = 22
"""Seven displacements, their speeds, and at each corner the share of friction and the mount."""
_SHORT_M = 0.15e-3
"""Pre-sliding length, m, below which the friction needs half the step."""
_FAST_M_S = 1.0
"""Speed of a suspension, m/s, that this assumes: with a lag above the quotient of both, the whole
step is enough."""


@dataclass(frozen=True, slots=True)
class InitialState:
    """State of one run as the free decay begins."""

    motion: NDArray[np.float64]
    """(14,) displacements and speeds of `daq.vehicle.DOF`, from the position of the bare car at
    rest."""
    friction: NDArray[np.float64]
    """(4,) share of the friction that acts at each corner, -1..1."""
    mount: NDArray[np.float64]
    """(4,) deflection of each damper's mount beyond that of its force, m."""

    def moved(self, step: NDArray[np.float64]) -> InitialState:
        """Return the state after a step, (18,) or with mounts (22,)."""
        mount = self.mount + step[18:] if len(step) > 18 else self.mount
        friction = np.clip(self.friction + step[14:18], -1.0, 1.0)
        return InitialState(self.motion + step[:14], friction, mount)


@dataclass(frozen=True, slots=True)
class Path:
    """All states at evenly spaced nodes, or at given times."""

    step_s: float
    """Of the nodes; 0 for given times."""
    level: Level
    """Rounding of the laws."""
    states: NDArray[np.float64]
    """(n, 22)."""
    slopes: NDArray[np.float64]
    """(n, 22), their rates of change."""
    speeds: NDArray[np.float64]
    """(n, 4), of the dampers, m/s."""

    @property
    def end_s(self) -> float:
        """Time of the last node, s."""
        return (len(self.states) - 1) * self.step_s

    def motion(self, derivative: int) -> NDArray[np.float64]:
        """Return displacement, speed or acceleration of the degrees of freedom, (n, 7)."""
        return self.slopes[:, 7:14] if derivative == 2 else self.states[:, 7 * derivative :][:, :7]


def travel_speeds(car: Car, motion: NDArray[np.float64], first: int = 7) -> NDArray[np.float64]:
    """Return the speeds of the four suspensions, (..., 4) m/s, compression positive.

    With `first` 0 instead of 7, their travels.
    """
    body = (
        motion[..., first : first + 1]
        - motion[..., first + 1 : first + 2] * car.corner[:, X]
        + motion[..., first + 2 : first + 3] * car.corner[:, Y]
    )
    return np.asarray(motion[..., first + 3 : first + 7] - body)


def damper_curve(
    car: Car, speed: NDArray[np.float64], width: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return force and slope of the axle's curve at the four dampers' speeds, (..., 4) each."""
    force, slope = car.corner[:, C] * speed, car.corner[:, C] + 0.0 * speed
    for j, at in enumerate(car.knots):
        h = car.corner[:, KNEES + j]
        force, slope = force + h * knee(speed, at, width), slope + h * knee_slope(speed, at, width)
    return force, slope


def first_state(
    car: Car, initial: InitialState, level: Level
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the state at the start, (22,), and the speeds of the dampers, (4,)."""
    speed = travel_speeds(car, initial.motion)
    force, _ = damper_curve(car, speed, level.knee_m_s)
    mount = car.corner[:, MOUNT] * car.corner[:, RATIO] * force + initial.mount
    return np.concatenate([initial.motion, initial.friction, mount]), speed


def step_of(cars: list[Car], grade: Grade) -> float:
    """Return the step that the shortest pre-sliding length allows, s."""
    shortest = min(float(car.corner[:, LENGTH].min()) for car in cars)
    short = shortest < _SHORT_M and grade.path.lag_s < _SHORT_M / _FAST_M_S
    return grade.step_s / 2.0 if short else grade.step_s


def hermite(share: NDArray[np.float64], step_s: float) -> tuple[NDArray[np.float64], ...]:
    """Return the weights of cubic Hermite: value before, value after, slope before, slope after.

    `share` is the position in the step, 0..1, (n,).
    """
    s = share
    before = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
    after = s * s * (3.0 - 2.0 * s)
    return before, after, s * (1.0 - s) * (1.0 - s) * step_s, -s * s * (1.0 - s) * step_s


# Start and steps of the tangents of a run ---------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Start:
    """Derivatives of the first state, and the way each unknown enters the motion."""

    matrix: NDArray[np.float64]
    """(22, columns): the run's own unknowns, then the free ones that act on the motion."""
    sparse: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]
    """First entry of each corner (5,); coefficient, column and derivative of each entry."""
    body: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]
    """Columns that change the body, (n,), its mass by them, (n, 3, 3), and gravity, (n, 3)."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Steps of the tangents along a path."""

    starts: NDArray[np.int64]
    """(n,) first node."""
    lengths: NDArray[np.int64]
    """(n,) steps of the path."""
    fine: NDArray[np.int64]
    """(n,) which of the levels."""
    levels: tuple[Level, Level]


def acting(cars: list[Car]) -> NDArray[np.intp]:
    """Return which of the free unknowns act on the motion in any mass state, (A,)."""
    acts = [
        car.d_corner.any(axis=(0, 1)) | car.d_mass.any(axis=(1, 2)) | car.d_pull.any(axis=1)
        for car in cars
    ]
    return np.flatnonzero(np.any(acts, axis=0))


@dataclass(frozen=True, slots=True)
class SampledChannels:
    """The motions that some channels see, and the times of their samples."""

    before: NDArray[np.int64]
    """(n,) node of the plan before each time."""
    weights: NDArray[np.float64]
    """(n, 3, 4) by time derivative: weights of the value before and after, and of its slope before
    and after.  An acceleration is the slope of the cubic that gives the speed."""
    orders: NDArray[np.int64]
    """(channels,) time derivative."""
    first: NDArray[np.int64]
    """(channels + 1,) first entry of each channel in what follows."""
    motions: NDArray[np.int64]
    """Degree of freedom."""
    shares: NDArray[np.float64]
    """Entry of this degree of freedom in the channel's row."""


def sampled_channels(
    plan: Plan,
    step_s: float,
    times_s: NDArray[np.float64],
    orders: NDArray[np.int64],
    rows: NDArray[np.float64],
) -> SampledChannels:
    """Return how channels with given rows, (channels, 7), see the motion at given times."""
    begins = plan.starts * step_s
    k = np.clip(np.searchsorted(begins, times_s + 1e-9, side="right") - 1, 0, len(begins) - 1)
    h = plan.lengths[k] * step_s
    s = (times_s - begins[k]) / h
    place = np.stack(hermite(s, 1.0), axis=1)
    place[:, 2:] *= h[:, None]
    bend = 6.0 * s * (s - 1.0) / h
    turn = np.stack([bend, -bend, (3.0 * s - 4.0) * s + 1.0, (3.0 * s - 2.0) * s], axis=1)
    channel, motions = np.nonzero(rows)
    first = np.searchsorted(channel, np.arange(len(rows) + 1))
    weights = np.stack([place, place, turn], axis=1)
    return SampledChannels(k, weights, orders, first, motions, rows[channel, motions])


def start_of(car: Car, initial: InitialState, acts: NDArray[np.intp], level: Level) -> Start:
    """Return the start of the tangents of a run; its own unknowns are those of `initial`."""
    n_run = STATES if car.has_mount else STATES - 4  # the last 4 are the mounts
    d_corner = car.d_corner[:, :, acts]
    matrix = np.zeros((STATES, n_run + len(acts)))
    matrix[:n_run, :n_run] = np.eye(n_run)
    if car.has_mount:
        matrix[-4:] += _mount_start(car, initial, d_corner, matrix, level)
    entries = [np.nonzero(d_corner[i]) for i in range(4)]
    first = np.concatenate([[0], np.cumsum([len(kinds) for kinds, _ in entries])])
    sparse = (
        first.astype(np.int64),
        np.concatenate([kinds for kinds, _ in entries]).astype(np.int64),
        np.concatenate([unknowns for _, unknowns in entries]).astype(np.int64) + n_run,
        np.concatenate([d_corner[i][entries[i]] for i in range(4)]),
    )
    changes = car.d_mass[acts].any(axis=(1, 2)) | car.d_pull[acts].any(axis=1)
    on_body = np.flatnonzero(changes)
    body = (on_body + n_run, car.d_mass[acts][on_body], car.d_pull[acts][on_body])
    return Start(matrix, sparse, body)


def _mount_start(
    car: Car,
    initial: InitialState,
    d_corner: NDArray[np.float64],
    matrix: NDArray[np.float64],
    level: Level,
) -> NDArray[np.float64]:
    """Return the derivatives of the mounts' deflection under the dampers' force, (4, columns)."""
    p = car.corner
    n_run = matrix.shape[1] - d_corner.shape[2]
    speed = travel_speeds(car, initial.motion)
    force, slope = damper_curve(car, speed, level.knee_m_s)
    d_speed = travel_speeds(car, matrix[:14].T).T
    d_speed[:, n_run:] += initial.motion[8] * d_corner[:, X] - initial.motion[9] * d_corner[:, Y]
    sigma, ratio = p[:, MOUNT], p[:, RATIO]
    result = (sigma * ratio * slope)[:, None] * d_speed
    changed = (ratio * force)[:, None] * d_corner[:, MOUNT]
    changed += (sigma * force)[:, None] * d_corner[:, RATIO]
    changed += (sigma * ratio * speed)[:, None] * d_corner[:, C]
    for j, at in enumerate(car.knots):
        bent = sigma * ratio * knee(speed, at, level.knee_m_s)
        changed += bent[:, None] * d_corner[:, KNEES + j]
    result[:, n_run:] += changed
    return np.asarray(result)


def plan_of(car: Car, path: Path, grade: Grade) -> Plan:
    """Return the steps: fine where a wheel reverses, leaves the road or meets its stop."""
    nodes = len(path.states) - 1
    length = grade.mounted_steps if car.has_mount else grade.tangent_steps
    part = grade.fine_steps
    levels = (grade.coarse, grade.fine)
    if length == part and grade.coarse == grade.fine:
        starts = np.arange(0, nodes, part)
        whole = np.full(len(starts), part)
        return Plan(starts, whole, np.zeros(len(starts), np.int64), levels)
    p, x = car.corner, path.states
    travel = travel_speeds(car, x[:, :7], 0)
    load = tyre_load(x[:, 3:7], p[:, K_T], p[:, BETA], p[:, STATIC])
    signs = [travel_speeds(car, x) > 0.0, load > 0.0]
    if p[:, K_B].any() or car.d_corner[:, K_B].any():
        signs.append(travel > p[:, GAP])
    state = np.concatenate(signs, axis=1)
    turns = (state[1:] != state[:-1]).any(axis=1)
    events = np.add.reduceat(turns, np.arange(0, nodes, length)) > 0
    counts = np.where(events, length // part, 1)
    lengths = np.repeat(np.where(events, part, length), counts)
    fine = np.repeat(events.astype(np.int64), counts)
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    return Plan(starts, lengths, fine, levels)


# Evaluates the runs of a problem side by side: machine code and BLAS release the interpreter ------

T = TypeVar("T")


def for_each_run(function: Callable[..., T], *arguments: Iterable[Any]) -> tuple[T, ...]:
    """Return what a function returns for each run, in their order; as `map` does."""
    return tuple(_threads(os.getpid()).map(function, *arguments))


@cache
def _threads(process: int) -> ThreadPoolExecutor:
    """Return the threads of a process: one that was forked has none of its parent's."""
    return ThreadPoolExecutor(os.cpu_count(), f"runs of {process}")


# The integrator -----------------------------------------------------------------------------------

Array = NDArray[np.float64]

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def integrate(
    cars: Sequence[Car],
    initials: Sequence[InitialState],
    ends_s: Sequence[float],
    step_s: float,
    level: Level,
) -> Sequence[Path | None]:
    """Return the path of each run up to its end or just after; None if it does not stay finite."""
    return for_each_run(partial(_integrate, step_s, level), cars, initials, ends_s)


def _integrate(
    step_s: float, level: Level, car: Car, initial: InitialState, end_s: float
) -> Path | None:
    x0, speed = first_state(car, initial, level)
    steps = int(np.ceil(end_s / step_s / 8.0 - 1e-9)) * 8
    states, slopes = np.empty((steps + 1, STATES)), np.empty((steps + 1, STATES))
    speeds = np.empty((steps + 1, 4))
    reached = kernels.path(
        x0, speed, steps, step_s, *_body(car), level, car.has_mount, states, slopes, speeds
    )
    return Path(step_s, level, states, slopes, speeds) if reached == steps + 1 else None


def sample(car: Car, path: Path, times_s: Array) -> Path:
    """Return the states at the given times, s."""
    states, slopes = np.empty((len(times_s), STATES)), np.empty((len(times_s), STATES))
    speeds = np.empty((len(times_s), 4))
    kernels.sample(
        times_s, path.step_s, path.states, path.slopes, path.speeds, *_body(car), path.level,
        car.has_mount, states, slopes, speeds,
    )  # fmt: skip
    return Path(0.0, path.level, states, slopes, speeds)


def tangents(car: Car, path: Path, start: Start, plan: Plan) -> Any:
    """Return the tangents along a path, as `add_sampled` takes them.

    Each block, (STATE_ROWS, LANES), has `LANES` columns of the start's matrix.
    """
    corner, knots, inverse, _ = _body(car)
    count = start.matrix.shape[1]
    n_blocks = ceil(count / LANES)
    trace = np.empty((len(plan.starts) + 2, n_blocks, columns.STATE_ROWS * LANES))
    for b in range(n_blocks):
        part = start.matrix[:, b * LANES : (b + 1) * LANES]
        rows = np.zeros((columns.STATE_ROWS, LANES))
        rows[:STATES, : part.shape[1]] = part
        trace[0, b] = rows.ravel()
    columns.tangents(
        path.step_s, path.states, path.slopes, path.speeds, corner, knots, inverse,
        car.has_mount, start.sparse, start.body, plan.starts, plan.lengths, plan.fine, plan.levels,
        count, trace,
    )  # fmt: skip
    return trace


def add_sampled(trace: Any, given: SampledChannels, out: Array) -> None:
    """Add the tangents of some channels at some times to `out`, (n, channels, columns)."""
    columns.add_sampled(
        trace, out.shape[2], given.before, given.weights, given.orders, given.first, given.motions,
        given.shares, out,
    )  # fmt: skip


def filtered(low_pass: LowPass, values: Array, step_s: float, times_s: Array) -> Array:
    """Return the output of a low-pass that was at rest before.

    The filter is a sum of first-order filters, one for each pole, each integrated exactly for an
    input that is a parabola over two steps.  Its own transients are left out: they are free
    constants of the channel.

    `values`, (n, ...): its input at 0, `step_s`, ...; n is odd.  `times_s`, (m,): times of the
    output.  Returns (m, ...).
    """
    order = np.argsort(times_s, kind="stable")
    flat = np.ascontiguousarray(values).reshape(len(values), -1)
    ordered = np.zeros((len(times_s), flat.shape[1]))
    for pole, residue, weights in _pole_terms(low_pass, 2.0 * step_s):
        kernels.filter_pole(flat, 2.0 * step_s, times_s[order], pole, residue, weights, ordered)
    total = np.empty_like(ordered)
    total[order] = ordered
    return total.reshape(len(times_s), *values.shape[1:])


def _pole_terms(
    low_pass: LowPass, h: float
) -> Iterator[tuple[complex, complex, NDArray[np.complex128]]]:
    """Yield each pole without its conjugate, its residue for both, and the weights of its input.

    The weights, (3,), are of the input at the start, the middle and the end of a double step of
    `h` seconds.
    """
    s = (_POINTS + 1.0) / 2.0  # of the double step
    shapes = np.array([(2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)])
    poles = low_pass.poles
    for i, pole in enumerate(poles):
        if pole.imag < 0.0:
            continue
        others = np.delete(poles, i)
        residue = np.prod(-poles) / np.prod(pole - others)
        share = 2.0 if pole.imag > 0.0 else 1.0
        kernel = np.exp(pole * h * (1.0 - s)) * _WEIGHTS * h / 2.0
        yield complex(pole), complex(share * residue), shapes @ kernel


def _body(car: Car) -> tuple[Array, Array, Array, Array]:
    inverse = np.asarray(np.linalg.inv(car.mass), dtype=np.float64)
    return car.corner, np.array(car.knots, dtype=np.float64), inverse, car.pull
