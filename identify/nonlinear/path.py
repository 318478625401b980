"""Path and tangents of a run: all states over time, and their values at the samples."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..model.exponentials import LowPass
from ..model.matrices import Real
from . import kernels
from .car import BETA, GAP, K_B, K_T, KNEES, LENGTH, MOUNT, RATIO, STATIC, C, Car, X, Y
from .kernels import LANES
from .laws import knee, knee_slope, tyre_load

# Step sizes of the integration, and rounding of the corners of the force laws ---------------------


class Level(NamedTuple):
    """Rounding of the force laws; a tuple of numbers, so that compiled code can take it."""

    knee_m_s: float
    """Rounding of the damper's knees, m/s."""
    turn_m_s: float
    """Rounding of the speed at which friction reverses, m/s."""
    lag_s: float
    """Lag of friction, s: bounds how fast it reverses at high speed.  A step above 2.8 lags is not
    stable (RK4)."""
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
    """Number of path steps in one tangent step without mounts and events; even, because the middle
    of a step must be a node of the path.  Else it is two."""
    coarse: Level
    """Rounding of the tangents between events: a wheel reverses or leaves the road, or a stop is
    touched."""
    fine: Level
    """Rounding of the tangents at events."""
    filter_s: float
    """Spacing of the tangents, s, at the input of a sensor's low-pass."""


PATH = Level(0.0005, 0.01e-3, 0.05e-3, 0.12e-3, 0.05e-3, 20.0)
"""Rounding of the exact path: too small to be visible in the parameters.

A corner that sticks loses its friction as if it crept by the rounding of the turn: 0.2 mm/s moved
masses and springs of a car with solid axles by 1.5 standard deviations, and knees of 2 mm/s by
0.6."""

ROUGH = Grade(
    Level(0.004, 0.0005, 0.25e-3, 0.25e-3, 0.1e-3, 60.0), 2.5e-3 / 4, 4,
    Level(0.010, 0.003, 1.2e-3, 0.5e-3, 0.5e-3, 200.0),
    Level(0.005, 0.001, 0.5e-3, 0.5e-3, 0.2e-3, 100.0),
    2.5e-3,
)  # fmt: skip
"""Grade of the search: finds the optimum to a few standard deviations, at a third of the work."""
POLISH = Grade(
    PATH, 2.5e-3 / 10, 2,
    Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3, 60.0),
    Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3, 60.0),
    1e-3,
)  # fmt: skip
"""Grade of the last steps of a fit, and of its covariance."""


# The path -----------------------------------------------------------------------------------------

STATES = 22
"""Seven displacements, their speeds, and at each corner the share of friction and the mount."""


@dataclass(frozen=True, slots=True)
class InitialState:
    """State of one run as the free decay begins."""

    motion: Real
    """(14,) displacements and speeds of `daq.vehicle.DOF`, from the position of the bare car at
    rest."""
    friction: Real
    """(4,) share of the friction that acts at each corner, -1..1."""
    mount: Real
    """(4,) deflection of each damper's mount beyond that of its force, m."""

    def moved(self, step: Real) -> InitialState:
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
    states: Real
    """(n, 22)."""
    slopes: Real
    """(n, 22), their rates of change."""
    speeds: Real
    """(n, 4), of the dampers, m/s."""

    @property
    def end_s(self) -> float:
        """Time of the last node, s."""
        return (len(self.states) - 1) * self.step_s

    def motion(self, derivative: int) -> Real:
        """Return displacement, speed or acceleration of the degrees of freedom, (n, 7)."""
        return self.slopes[:, 7:14] if derivative == 2 else self.states[:, 7 * derivative :][:, :7]


def damper_curve(car: Car, speed: Real, width: float) -> tuple[Real, Real]:
    """Return force and slope of the axle's curve at the four dampers' speeds, (..., 4) each."""
    force, slope = car.corner[:, C] * speed, car.corner[:, C] + 0.0 * speed
    for j, knot in enumerate(car.knots):
        h = car.corner[:, KNEES + j]
        force = force + h * knee(speed, knot, width)
        slope = slope + h * knee_slope(speed, knot, width)
    return force, slope


def step_of(cars: Iterable[Car], grade: Grade) -> float:
    """Return the step of the path that the shortest pre-sliding length of some cars allows, s.

    Friction over less than 0.15 mm needs half the step where its lag is shorter than a suspension
    at 1 m/s takes for that length.
    """
    shortest_m = min(float(car.corner[:, LENGTH].min()) for car in cars)
    needs_half = shortest_m < 0.15e-3 and grade.path.lag_s < 0.15e-3
    return grade.step_s / 2.0 if needs_half else grade.step_s


def path_of(
    car: Car, initial: InitialState, end_s: float, step_s: float, level: Level
) -> Path | None:
    """Return the path of a run up to its end or just after; None if it does not stay finite."""
    speeds_m_s = car.travel_speeds(initial.motion)
    force, _ = damper_curve(car, speeds_m_s, level.knee_m_s)
    mount = car.corner[:, MOUNT] * car.corner[:, RATIO] * force + initial.mount
    first_state = np.concatenate([initial.motion, initial.friction, mount])
    steps = int(np.ceil(end_s / step_s / 8.0 - 1e-9)) * 8  # whole tangent steps at each grade
    states, slopes = np.empty((steps + 1, STATES)), np.empty((steps + 1, STATES))
    speeds = np.empty((steps + 1, 4))
    n_finite = kernels.path(
        first_state, speeds_m_s, steps, step_s, *_car_arrays(car), car.gravity, level,
        car.has_mount, states, slopes, speeds,
    )  # fmt: skip
    return Path(step_s, level, states, slopes, speeds) if n_finite == steps + 1 else None


def sample(car: Car, path: Path, times_s: Real) -> Path:
    """Return the path at given times, s, in place of its nodes."""
    states, slopes = np.empty((len(times_s), STATES)), np.empty((len(times_s), STATES))
    speeds = np.empty((len(times_s), 4))
    kernels.sample(
        times_s, path.step_s, path.states, path.slopes, path.speeds, *_car_arrays(car),
        car.gravity, path.level, car.has_mount, states, slopes, speeds,
    )  # fmt: skip
    return Path(0.0, path.level, states, slopes, speeds)


def _car_arrays(car: Car) -> tuple[Real, Real, Real]:
    """Return what machine code takes of a car: corners, knots, inverse mass of the body."""
    return car.corner, np.array(car.knots), np.asarray(np.linalg.inv(car.mass))


# The tangents along a path ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Channels:
    """Rows of some channels on the motion, and times of their samples."""

    times_s: Real
    """(n,)."""
    orders: NDArray[np.int64]
    """(channels,) time derivative of the motion."""
    rows: Real
    """(channels, 7) factor of each degree of freedom."""


def tangents(
    car: Car, path: Path, initial: InitialState, grade: Grade, channel_sets: Sequence[Channels]
) -> tuple[Real, ...]:
    """Return the derivatives of what each set shows along a path, (times, channels, columns) each.

    Columns are the run's own unknowns, those of `initial`, and then the free ones of the car.
    """
    columns = first_columns(car, initial, grade.path)
    n_own, n_columns = columns.shape[1] - car.d_corner.shape[2], columns.shape[1]
    # Nonzero derivatives of the corners, in their order, as `kernels.linearise` takes them.
    corner_of_entry, coefficients, unknowns = np.nonzero(car.d_corner)
    of_corners = (
        np.searchsorted(corner_of_entry, np.arange(5)),
        coefficients,
        *np.divmod(unknowns + n_own, LANES),
        car.d_corner[corner_of_entry, coefficients, unknowns],
    )
    on_body = np.flatnonzero(car.d_mass.any(axis=(1, 2)) | car.d_gravity.any(axis=1))
    of_body = (*np.divmod(on_body + n_own, LANES), car.d_mass[on_body], car.d_gravity[on_body])
    starts, lengths, fine = tangent_steps(car, path, grade)
    # The columns in blocks of lanes: (rows, columns) -> (blocks, rows, LANES).
    padded = np.zeros((kernels.TANGENT_ROWS, ceil(n_columns / LANES) * LANES))
    padded[:STATES, :n_columns] = columns
    first_blocks = padded.reshape(kernels.TANGENT_ROWS, -1, LANES).swapaxes(0, 1)
    times_s = np.concatenate([c.times_s for c in channel_sets])
    n_channels = np.array([len(c.orders) for c in channel_sets])
    ends = np.cumsum(n_channels)
    # For each sample: index of its set, and its first row of `out`; it has a row for each channel.
    i_set = np.repeat(np.arange(len(channel_sets)), [len(c.times_s) for c in channel_sets])
    first_rows = np.cumsum(n_channels[i_set]) - n_channels[i_set]
    steps, weights = _between_nodes(starts * path.step_s, lengths * path.step_s, times_s)
    of_samples = (steps, weights, first_rows, (ends - n_channels)[i_set], ends[i_set])
    by_step = np.argsort(steps, kind="stable")
    rows = np.concatenate([c.rows for c in channel_sets])
    row_of_entry, motions = np.nonzero(rows)
    channels = (
        np.concatenate([c.orders for c in channel_sets]),
        np.searchsorted(row_of_entry, np.arange(len(rows) + 1)),
        motions,
        rows[row_of_entry, motions],
    )
    out = np.zeros((int(n_channels[i_set].sum()), n_columns))
    kernels.tangents(
        path.step_s, path.states, path.slopes, path.speeds, *_car_arrays(car), car.has_mount,
        of_corners, of_body, starts, lengths, fine, (grade.coarse, grade.fine),
        first_blocks.reshape(len(first_blocks), -1), tuple(value[by_step] for value in of_samples),
        channels, out,
    )  # fmt: skip
    n_rows = [len(c.times_s) * len(c.orders) for c in channel_sets]
    return tuple(
        of_set.reshape(-1, len(c.orders), n_columns)
        for of_set, c in zip(np.split(out, np.cumsum(n_rows)[:-1]), channel_sets, strict=True)
    )


def _between_nodes(
    begins_s: NDArray[Any], lengths_s: NDArray[Any], times_s: Real
) -> tuple[NDArray[np.int64], Real]:
    """Return the step of each time, (n,), and weights of the values at its ends, (n, 3, 4).

    By time derivative: weights of the value before and after, and of its slope before and after.
    An acceleration is the slope of the cubic that gives the speed.
    """
    step = np.searchsorted(begins_s, times_s + 1e-9, side="right") - 1
    step = np.clip(step, 0, len(begins_s) - 1)
    h = lengths_s[step]
    s = (times_s - begins_s[step]) / h
    bend = 6.0 * s * (s - 1.0) / h
    value = [
        (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s), s * s * (3.0 - 2.0 * s),
        s * (1.0 - s) * (1.0 - s) * h, -s * s * (1.0 - s) * h,
    ]  # fmt: skip
    slope = [bend, -bend, (3.0 * s - 4.0) * s + 1.0, (3.0 * s - 2.0) * s]
    return step, np.ascontiguousarray(np.array([value, value, slope]).transpose(2, 0, 1))


def first_columns(car: Car, initial: InitialState, level: Level) -> Real:
    """Return the derivatives of a run's first state, (22, own unknowns + free ones).

    The state is its own unknowns, but for the mounts: a mount also deflects by its compliance times
    the damper's force, which depends on the first speeds and on the free unknowns.
    """
    n_own = STATES if car.has_mount else STATES - 4  # the last 4 are the mounts
    columns = np.eye(STATES, n_own + car.d_corner.shape[2])
    columns[:, n_own:] = 0.0
    if not car.has_mount:
        return columns
    p, d_corner = car.corner, car.d_corner
    speed = car.travel_speeds(initial.motion)
    force, slope = damper_curve(car, speed, level.knee_m_s)
    d_speed = car.travel_speeds(columns[:14].T).T
    d_speed[:, n_own:] += initial.motion[8] * d_corner[:, X] - initial.motion[9] * d_corner[:, Y]
    sigma, ratio = p[:, MOUNT], p[:, RATIO]
    columns[18:] += (sigma * ratio * slope)[:, None] * d_speed
    by_coefficient = {MOUNT: ratio * force, RATIO: sigma * force, C: sigma * ratio * speed}
    for j, knot in enumerate(car.knots):
        by_coefficient[KNEES + j] = sigma * ratio * knee(speed, knot, level.knee_m_s)
    for coefficient, derivative in by_coefficient.items():
        columns[18:, n_own:] += derivative[:, None] * d_corner[:, coefficient]
    return columns


def tangent_steps(car: Car, path: Path, grade: Grade) -> tuple[NDArray[np.int64], ...]:
    """Return first node, length in nodes and level (0 coarse, 1 fine) of each step, (n,) each.

    A step during which a wheel reverses or leaves the road, or a stop is touched, is divided into
    fine ones of two nodes.
    """
    corner, states, n_steps = car.corner, path.states, len(path.states) - 1
    length = 2 if car.has_mount else grade.tangent_steps
    load = tyre_load(states[:, 3:7], corner[:, K_T], corner[:, BETA], corner[:, STATIC])
    signs = [car.travel_speeds(states) > 0.0, load > 0.0]
    if corner[:, K_B].any() or car.d_corner[:, K_B].any():
        signs.append(car.travels(states) > corner[:, GAP])
    side_of_event = np.concatenate(signs, axis=1)
    changes = (side_of_event[1:] != side_of_event[:-1]).any(axis=1)
    events = np.add.reduceat(changes, np.arange(0, n_steps, length)) > 0
    events &= grade.coarse != grade.fine
    counts = np.where(events, length // 2, 1)
    lengths = np.repeat(np.where(events, 2, length), counts)
    fine = np.repeat(events.astype(np.int64), counts)
    return np.cumsum(lengths) - lengths, lengths, fine


# Evaluates the runs of a problem side by side: machine code and BLAS release the interpreter ------

T = TypeVar("T")


def for_each_run(function: Callable[..., T], *arguments: Iterable[Any]) -> tuple[T, ...]:
    """Return what a function returns for each run, in their order; as `map` does."""
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return tuple(threads.map(function, *arguments))


# A sensor's low-pass ------------------------------------------------------------------------------


def filtered(low_pass: LowPass, values: Real, step_s: float, times_s: Real) -> Real:
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
    h, poles = 2.0 * step_s, low_pass.poles
    points, gauss_weights = np.polynomial.legendre.leggauss(8)
    s = (points + 1.0) / 2.0  # of the double step
    # Parabolas that are 1 at its start, its middle and its end.
    shapes = np.array([(2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)])
    for i in np.flatnonzero(poles.imag >= 0.0):
        pole = poles[i]
        weights = shapes @ (np.exp(pole * h * (1.0 - s)) * gauss_weights * h / 2.0)
        residue = np.prod(-poles) / np.prod(pole - np.delete(poles, i))
        residue *= 2.0 if pole.imag > 0.0 else 1.0  # with that of the conjugate pole
        kernels.filter_pole(
            flat, h, times_s[order], complex(pole), complex(residue), weights, ordered
        )
    total = np.empty_like(ordered)
    total[order] = ordered
    return total.reshape(len(times_s), *values.shape[1:])
