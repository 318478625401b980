"""Start and steps of the tangents of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..elements.damper import knee
from ..elements.tyre import tyre_load
from .car import (
    BETA,
    C_T,
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
from .level import COARSE, FINE, PATH, POLISH, Level
from .path import STATES, Own, Path, damper_curve, travel_speeds

COARSE_STEPS = 8
"""Steps of the path in one of the tangents, between events."""
MOUNTED_STEPS = 4
"""The same with a damper on a mount."""
FINE_STEPS = 2
"""The same where something turns, and in the polish: the middle of a step must be a node."""


@dataclass(frozen=True, slots=True)
class Start:
    """Derivatives of the first state, and how each unknown enters the motion."""

    matrix: NDArray[np.float64]
    """(22, columns): the run's own unknowns, then the free ones that act on the motion."""
    sparse: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]
    """First entry of each corner (5,), and of each entry coefficient, column and derivative."""
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


def start_of(car: Car, own: Own, acts: NDArray[np.intp]) -> Start:
    """Return what the tangents of a run start from."""
    n_own = 22 if car.has_mount else 18
    d_corner = car.d_corner[:, :, acts]
    matrix = np.zeros((STATES, n_own + len(acts)))
    matrix[:n_own, :n_own] = np.eye(n_own)
    if car.has_mount:
        matrix[18:] += _mount_start(car, own, d_corner, matrix)
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
    car: Car, own: Own, d_corner: NDArray[np.float64], matrix: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the derivatives of the mounts' deflection under the dampers' force, (4, columns)."""
    p = car.corner
    n_own = matrix.shape[1] - d_corner.shape[2]
    speed = travel_speeds(car, own.motion)
    force, slope = damper_curve(car, speed, PATH.knee_m_s)
    d_speed = travel_speeds(car, matrix[:14].T).T
    d_speed[:, n_own:] += own.motion[8] * d_corner[:, X] - own.motion[9] * d_corner[:, Y]
    sigma, ratio = p[:, MOUNT], p[:, RATIO]
    result = (sigma * ratio * slope)[:, None] * d_speed
    changed = (ratio * force)[:, None] * d_corner[:, MOUNT]
    changed += (sigma * force)[:, None] * d_corner[:, RATIO]
    changed += (sigma * ratio * speed)[:, None] * d_corner[:, C]
    for j, at in enumerate(car.knots):
        bent = sigma * ratio * knee(speed, at, PATH.knee_m_s)
        changed += bent[:, None] * d_corner[:, KNEES + j]
    result[:, n_own:] += changed
    return np.asarray(result)


def plan_of(car: Car, path: Path, polish: bool) -> Plan:
    """Return the steps: coarse, but fine where a wheel turns, leaves the road or meets its stop."""
    nodes = len(path.states) - 1
    if polish:
        starts = np.arange(0, nodes, FINE_STEPS)
        return Plan(
            starts, np.full(len(starts), FINE_STEPS), np.zeros(len(starts), np.int64),
            (POLISH, POLISH),
        )  # fmt: skip
    length = MOUNTED_STEPS if car.has_mount else COARSE_STEPS
    p, x = car.corner, path.states
    travel = travel_speeds(car, np.concatenate([np.zeros((len(x), 7)), x[:, :7]], axis=1))
    load = tyre_load(x[:, 3:7], x[:, 10:14], p[:, K_T], p[:, BETA], p[:, C_T], p[:, STATIC])
    signs = [travel_speeds(car, x) > 0.0, load > 0.0]
    if p[:, K_B].any() or car.d_corner[:, K_B].any():
        signs.append(travel > p[:, GAP])
    state = np.concatenate(signs, axis=1)
    turns = (state[1:] != state[:-1]).any(axis=1)
    events = np.add.reduceat(turns, np.arange(0, nodes, length)) > 0
    steps: list[tuple[int, int, int]] = []
    for k, event in enumerate(events.tolist()):
        parts = range(0, length, FINE_STEPS) if event else (0,)
        for part in parts:
            steps.append((k * length + part, FINE_STEPS if event else length, int(event)))
    each = np.array(steps, dtype=np.int64)
    return Plan(each[:, 0].copy(), each[:, 1].copy(), each[:, 2].copy(), (COARSE, FINE))
