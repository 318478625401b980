"""The integrator by Numba."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import kernels
from .car import Car
from .level import PATH
from .path import STATES, Own, Path, Sampled, first_state
from .tangent import Plan, Start


def integrate(
    cars: Sequence[Car], owns: Sequence[Own], ends_s: Sequence[float], step_s: float
) -> list[Path | None]:
    """Return the path of each run up to its end or just after; None if it does not stay finite."""
    return [
        _integrate(car, own, end_s, step_s)
        for car, own, end_s in zip(cars, owns, ends_s, strict=True)
    ]


def _integrate(car: Car, own: Own, end_s: float, step_s: float) -> Path | None:
    x0, speed = first_state(car, own)
    steps = int(np.ceil(end_s / step_s / 8.0 - 1e-9)) * 8
    states, slopes = np.empty((steps + 1, STATES)), np.empty((steps + 1, STATES))
    speeds = np.empty((steps + 1, 4))
    reached = kernels.path(
        x0, speed, steps, step_s, *_body(car), PATH, car.has_mount, states, slopes, speeds
    )
    return Path(step_s, states, slopes, speeds) if reached == steps + 1 else None


def sample(car: Car, path: Path, times_s: NDArray[np.float64]) -> Sampled:
    """Return the states at the given times, s."""
    states, slopes = np.empty((len(times_s), STATES)), np.empty((len(times_s), STATES))
    speeds = np.empty((len(times_s), 4))
    kernels.sample(
        times_s, path.step_s, path.states, path.slopes, path.speeds, *_body(car), PATH,
        car.has_mount, states, slopes, speeds,
    )  # fmt: skip
    return Sampled(times_s, states, slopes, speeds)


def tangents(
    car: Car,
    acts: NDArray[np.intp],
    path: Path,
    start: Start,
    plan: Plan,
    sampled: Sampled,
    forced: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the derivatives of heave, speed and acceleration at the samples, (n, 21, columns)."""
    corner, knots, inverse, _ = _body(car)
    assert start.matrix.shape[1] == len(acts) + (22 if car.has_mount else 18)
    out = np.empty((len(sampled.times_s), 21, start.matrix.shape[1]))
    kernels.tangents(
        start.matrix, path.step_s, path.states, path.slopes, path.speeds, corner, knots, inverse,
        car.has_mount, start.sparse, start.body, plan.starts, plan.lengths, plan.fine, plan.levels,
        sampled.times_s, forced, sampled.states, sampled.slopes, sampled.speeds, out,
    )  # fmt: skip
    return out


def _body(
    car: Car,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    inverse = np.asarray(np.linalg.inv(car.mass), dtype=np.float64)
    return car.corner, np.array(car.knots, dtype=np.float64), inverse, car.pull
