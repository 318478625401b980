"""The integrator by NumPy: all runs in lockstep along the path, all steps at once in the tangents.

The tangents' Runge-Kutta steps are affine, ``S -> Phi S + Gamma``, and the path is known, so every
Phi and Gamma is computed in one sweep over all steps; only their product runs in sequence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..elements.bar import bar_force
from ..elements.damper import knee, knee_slope
from ..elements.friction import friction_rate, sliding_share
from ..elements.hinge import hinge
from ..elements.mount import mount_misfit, mount_slope
from ..elements.spring import spring_force
from ..elements.stop import stop_force
from ..elements.tyre import tyre_force, tyre_load, tyre_push
from .car import (
    BETA,
    C_T,
    F_C,
    FALL,
    GAP,
    K_2,
    K_3,
    K_A,
    K_B,
    K_S,
    K_T,
    KNEES,
    LENGTH,
    MASS,
    MOUNT,
    PULL,
    RATIO,
    STATIC,
    SURPLUS,
    C,
    Car,
    X,
    Y,
)  # fmt: skip
from .level import Level
from .path import STATES, InitialState, Path, Sampled, first_state, hermite

ACROSS = np.array([1, 0, 3, 2])
"""The other corner of the axle."""
_TIGHT = 1e-11
_LARGEST = 100.0
"""Largest state of a finite path."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Stack:
    """Coefficients of one car for each row of states, or of one for all rows, at one rounding."""

    p: tuple[Array, ...]
    """Each of `car`'s columns, (rows, 4)."""
    ends: Array
    """(pieces - 1,): the speeds at which pieces of the damper curves end."""
    pieces: tuple[Array, Array, Array]
    """Coefficients of 1, r and r^2 of all corners' pieces, each (rows * 4 * pieces,)."""
    first_piece: NDArray[np.intp]
    """(rows, 4) index of the first piece of each corner."""
    travels: Array
    """(rows, 8, 14): travel and speed of each corner by displacements and speeds."""
    pushed: Array
    """(rows, 7, 4): accelerations by the forces of the suspensions."""
    rest: Array
    """(rows, 7): accelerations without any of the forces."""
    mounted: bool
    free_m: float
    """Travel up to which no bump stop acts."""
    stuck: bool
    """True if static friction exceeds sliding friction."""
    level: Level


def stack(cars: Sequence[Car], level: Level) -> Stack:
    """Return the coefficients of a car for each row of states, or of one car for all."""
    parts = [_motion(one) for one in cars]
    corner = np.stack([one.corner for one in cars])
    travels, pushed, rest = (np.stack(part) for part in zip(*parts, strict=True))
    lines = bends(corner, cars[0].knots, level.knee_m_s)
    ends, pieces = _pieces(lines, np.array(cars[0].knots), level.knee_m_s)
    first = np.arange(0, pieces[0].size, len(ends) + 1).reshape(-1, 4)
    gaps = np.where(corner[..., K_B] != 0.0, corner[..., GAP], np.inf)
    return Stack(
        tuple(np.ascontiguousarray(corner[..., k]) for k in range(KNEES)),
        ends, pieces, first, travels, pushed, rest,
        cars[0].has_mount, float(gaps.min()) - level.stop_m,
        bool(corner[..., SURPLUS].any()), level,
    )  # fmt: skip


def _motion(one: Car) -> tuple[Array, Array, Array]:
    """Return the matrices of a car that a `Stack` holds."""
    p = one.corner
    levers = np.stack([np.ones(4), -p[:, X], p[:, Y]])
    travels = np.zeros((8, 14))
    travels[:4, :3] = travels[4:, 7:10] = -levers.T
    travels[:4, 3:7] = travels[4:, 10:14] = np.eye(4)
    inverse = np.linalg.inv(one.mass)
    pushed = np.concatenate([inverse @ levers, -np.diag(1.0 / p[:, MASS])])
    return travels, pushed, np.concatenate([inverse @ one.pull, p[:, PULL] / p[:, MASS]])


def bends(p: Array, knots: tuple[float, ...], width: float) -> Array:
    """Return each corner's curve as a line through rest and hinges that all open upwards.

    A knee towards rebound is a line less the hinge of the same corner: ``H(-x) = H(x) - x``.
    """
    lines = np.zeros((*p.shape[:-1], 2 + len(knots)))
    lines[..., 1] = p[..., C]
    for j, knot in enumerate(knots):
        h = p[..., KNEES + j]
        if knot < 0.0:
            lines[..., 0] += h * (hinge(knot, width) - knot)
            lines[..., 1] += h
            lines[..., 2 + j] = -h
        else:
            lines[..., 0] -= h * hinge(-knot, width)
            lines[..., 2 + j] = h
    return lines


def _pieces(lines: Array, knots: Array, width: float) -> tuple[Array, tuple[Array, Array, Array]]:
    """Return curves of hinges as parabolas: where each piece ends, and its coefficients.

    Returns ends, m/s, (pieces - 1,) ascending, and coefficients of 1, r and r^2, of one curve
    after the other.
    """
    ends = np.sort(np.concatenate([knots - width, knots + width]))
    borders = np.concatenate([[-_LARGEST], ends, [_LARGEST]])
    middle = (borders[:-1] + borders[1:]) / 2.0
    beyond = middle[:, None] - knots
    line, round_ = beyond >= width, np.abs(beyond) < width
    bent = lines[..., 2:]
    level = bent @ (round_ * (width - knots) ** 2 / (4.0 * width) - line * knots).T
    slope = bent @ (round_ * (width - knots) / (2.0 * width) + line).T
    bend = bent @ (round_ / (4.0 * width)).T
    level, slope = level + lines[..., :1], slope + lines[..., 1:2]
    return ends, (level.ravel(), slope.ravel(), bend.ravel())


def _curve(cars: Stack, r: Array) -> tuple[Array, Array]:
    """Return force and slope of the axle's damper curve at the speeds r, (n, 4)."""
    which = cars.first_piece + np.searchsorted(cars.ends, r)
    level, slope, bend = (each.take(which) for each in cars.pieces)
    bend = bend * r
    return level + (slope + bend) * r, slope + 2.0 * bend


def curve(p: Array, knots: tuple[float, ...], r: Array, width: float) -> tuple[Array, Array]:
    """Return force and slope of the axle's damper curve at the speeds r, (n, 4)."""
    force, slope = p[..., C] * r, p[..., C] + 0.0 * r
    for j, at in enumerate(knots):
        force = force + p[..., KNEES + j] * knee(r, at, width)
        slope = slope + p[..., KNEES + j] * knee_slope(r, at, width)
    return force, slope


def rates(x: Array, cars: Stack, r: Array) -> tuple[Array, Array]:
    """Return the rates of change of states, (n, 22), and the dampers' speeds, (n, 4)."""
    p, level = cars.p, cars.level
    both = (cars.travels @ x[:, :14, None])[:, :, 0]
    u, w = both[:, :4], both[:, 4:]
    r = _damper_speeds(cars, x[:, 18:], w, r) if cars.mounted else w
    zeta = x[:, 14:18]
    force = (
        p[RATIO] * _curve(cars, r)[0]
        + spring_force(u, p[K_S], p[K_2], p[K_3])
        + bar_force(u, u.take(ACROSS, axis=1), p[K_A])
        + p[F_C] * zeta
    )
    if u.max() > cars.free_m:
        force += stop_force(u, p[K_B], p[GAP], level.stop_m)
    out = np.empty_like(x)
    out[:, :7] = x[:, 7:14]
    out[:, 7:14] = (cars.pushed @ force[:, :, None])[:, :, 0] + cars.rest
    out[:, 10:14] += _road(cars, x[:, 3:7], x[:, 10:14]) / p[MASS]
    limit = sliding_share(w, p[SURPLUS], p[FALL]) if cars.stuck else 1.0
    out[:, 14:18] = friction_rate(w, zeta, p[LENGTH], limit, level.turn_m_s, level.lag_s)
    out[:, 18:] = w - r if cars.mounted else 0.0
    return out, r


def _road(cars: Stack, z: Array, v: Array) -> Array:
    """Return the forces of the road beyond the static loads, at the wheels' heave and speed."""
    p, width = cars.p, cars.level.load_n
    load = tyre_load(z, p[K_T], p[BETA], p[STATIC])
    push = load - p[C_T] * v
    if load.min() > width and push.min() > width:  # all wheels stand on the road
        return np.asarray(push - p[STATIC])
    return np.asarray(tyre_force(tyre_push(load, v, p[C_T], width), p[STATIC], width))


def _damper_speeds(cars: Stack, e: Array, w: Array, r: Array) -> Array:
    ratio, sigma, loss_s = cars.p[RATIO], cars.p[MOUNT], cars.level.loss_s
    for _ in range(25):
        force, slope = _curve(cars, r)
        left = mount_misfit(r, ratio * force, e, w, sigma, loss_s)
        step = left / mount_slope(ratio * slope, sigma, loss_s)
        r = r - step
        if np.abs(step).max() < _TIGHT:
            break
    return r


def integrate(
    cars: Sequence[Car],
    initials: Sequence[InitialState],
    ends_s: Sequence[float],
    step_s: float,
    level: Level,
) -> list[Path | None]:
    """Return the path of each run up to its end or just after; None if it does not stay finite."""
    together = stack(cars, level)
    begun = [first_state(one, own, level) for one, own in zip(cars, initials, strict=True)]
    x, r = np.stack([b[0] for b in begun]), np.stack([b[1] for b in begun])
    steps = [round(np.ceil(end / step_s / 8.0 - 1e-9)) * 8 for end in ends_s]
    n = max(steps)
    states, slopes = np.empty((n + 1, len(x), STATES)), np.empty((n + 1, len(x), STATES))
    speeds = np.empty((n + 1, len(x), 4))
    with np.errstate(all="ignore"):  # a lost run overflows and is found at its end
        for k in range(n + 1):
            k1, r = rates(x, together, r)
            states[k], slopes[k], speeds[k] = x, k1, r
            k2, r = rates(x + 0.5 * step_s * k1, together, r)
            k3, r = rates(x + 0.5 * step_s * k2, together, r)
            k4, r = rates(x + step_s * k3, together, r)
            x = x + step_s / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    result: list[Path | None] = []
    for i, last in enumerate(steps):
        own = states[: last + 1, i]
        fine = bool(np.all(np.abs(own) < _LARGEST))
        path = Path(
            step_s, level, own.copy(), slopes[: last + 1, i].copy(), speeds[: last + 1, i].copy()
        )
        result.append(path if fine else None)
    return result


def sample(car: Car, path: Path, times_s: Array) -> Sampled:
    """Return the states at the given times, s."""
    k = np.clip((times_s / path.step_s).astype(int), 0, len(path.states) - 2)
    a, b, c, d = (w[:, None] for w in hermite(times_s / path.step_s - k, path.step_s))
    states = (
        a * path.states[k] + b * path.states[k + 1] + c * path.slopes[k] + d * path.slopes[k + 1]
    )
    slopes, speeds = rates(states, stack([car], path.level), path.speeds[k])
    return Sampled(times_s, states, slopes, speeds)
