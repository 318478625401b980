"""Start and steps of the tangents of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..elements.damper import knee
from ..elements.tyre import tyre_load
from .car import (
    BETA,
    GAP,
    K_B,
    K_T,
    KNEES,
    MOUNT,
    RATIO,
    STATIC,
    C,
    Car,
    X,
    Y,
)  # fmt: skip
from .level import Grade, Level
from .path import STATES, InitialState, Path, damper_curve, hermite, travel_speeds


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


def start_of(car: Car, own: InitialState, acts: NDArray[np.intp], level: Level) -> Start:
    """Return the start of the tangents of a run."""
    n_own = 22 if car.has_mount else 18
    d_corner = car.d_corner[:, :, acts]
    matrix = np.zeros((STATES, n_own + len(acts)))
    matrix[:n_own, :n_own] = np.eye(n_own)
    if car.has_mount:
        matrix[18:] += _mount_start(car, own, d_corner, matrix, level)
    entries = [np.nonzero(d_corner[i]) for i in range(4)]
    first = np.concatenate([[0], np.cumsum([len(kinds) for kinds, _ in entries])])
    sparse = (
        first.astype(np.int64),
        np.concatenate([kinds for kinds, _ in entries]).astype(np.int64),
        np.concatenate([columns for _, columns in entries]).astype(np.int64) + n_own,
        np.concatenate([d_corner[i][entries[i]] for i in range(4)]),
    )
    changes = car.d_mass[acts].any(axis=(1, 2)) | car.d_pull[acts].any(axis=1)
    columns = np.flatnonzero(changes)
    body = (columns + n_own, car.d_mass[acts][columns], car.d_pull[acts][columns])
    return Start(matrix, sparse, body)


def _mount_start(
    car: Car,
    own: InitialState,
    d_corner: NDArray[np.float64],
    matrix: NDArray[np.float64],
    level: Level,
) -> NDArray[np.float64]:
    """Return the derivatives of the mounts' deflection under the dampers' force, (4, columns)."""
    p = car.corner
    n_own = matrix.shape[1] - d_corner.shape[2]
    speed = travel_speeds(car, own.motion)
    force, slope = damper_curve(car, speed, level.knee_m_s)
    d_speed = travel_speeds(car, matrix[:14].T).T
    d_speed[:, n_own:] += own.motion[8] * d_corner[:, X] - own.motion[9] * d_corner[:, Y]
    sigma, ratio = p[:, MOUNT], p[:, RATIO]
    result = (sigma * ratio * slope)[:, None] * d_speed
    changed = (ratio * force)[:, None] * d_corner[:, MOUNT]
    changed += (sigma * force)[:, None] * d_corner[:, RATIO]
    changed += (sigma * ratio * speed)[:, None] * d_corner[:, C]
    for j, at in enumerate(car.knots):
        bent = sigma * ratio * knee(speed, at, level.knee_m_s)
        changed += bent[:, None] * d_corner[:, KNEES + j]
    result[:, n_own:] += changed
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
