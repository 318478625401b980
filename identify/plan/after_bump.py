"""Drives a car with nonlinear elements over a bump, to the state in which its free decay begins.

The laws are those of the fit (`identify.elements`), here for NumPy's arrays: all cars of a plan in
lockstep, with the road under their wheels, which a free decay does not have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..elements.laws import (
    bar_force,
    friction_rate,
    hinge,
    mount_misfit,
    mount_slope,
    sliding_share,
    spring_force,
    stop_force,
    tyre_force,
    tyre_load,
    tyre_push,
)
from ..nonlinear.car import (
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
from ..nonlinear.path import PATH, STATES, USUAL, InitialState, Level, first_state, step_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Driven:
    """A car at rest before its bump."""

    car: Car
    rest: Array
    """(7,) position at rest: the weights lower it from that of the bare car."""
    shares: tuple[float, float, float, float]
    """Share of the height under each wheel."""
    height_m: float
    """Height of the half sine, m."""


def after_bump(driven: Sequence[Driven], bump_s: float) -> tuple[InitialState, ...]:
    """Return the state of each car as its wheels leave the bump.

    The laws are those of the fit; the road comes in through the tyres.

    `driven`: the cars; all of them have mounts, or none.  `bump_s`: duration of the bump, s.
    """
    cars = _stack([one.car for one in driven] if len(driven) > 1 else [driven[0].car] * 2, PATH)
    rows = max(len(driven), 2)  # a stack of one car has no axis for cars
    x = np.zeros((rows, STATES))
    x[:, :7] = [one.rest for one in (*driven, driven[0])[:rows]]
    road = np.array([np.multiply(one.height_m, one.shares) for one in (*driven, driven[0])[:rows]])
    steps = int(np.ceil(bump_s / step_of([one.car for one in driven], USUAL)))
    h, omega = bump_s / steps, np.pi / bump_s
    r = np.zeros((rows, 4))
    # A car whose state does not stay finite overflows, which is detected at the end.
    with np.errstate(all="ignore"):
        for k in range(steps):
            waves = [
                (road * np.sin(omega * t), road * omega * np.cos(omega * t))
                for t in (k * h, (k + 0.5) * h, (k + 1) * h)
            ]
            k1, r = _rates(x, cars, r, *waves[0])
            k2, r = _rates(x + 0.5 * h * k1, cars, r, *waves[1])
            k3, r = _rates(x + 0.5 * h * k2, cars, r, *waves[1])
            k4, r = _rates(x + h * k3, cars, r, *waves[2])
            x = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return tuple(_initial_state(one.car, state) for one, state in zip(driven, x, strict=False))


def _rates(x: Array, cars: _Stack, r: Array, road: Array, rise: Array) -> tuple[Array, Array]:
    """Return the rates of change of the states with a road of heights (n, 4) under the wheels."""
    out, r = _free_rates(x, cars, r)
    p = cars.p
    width = cars.level.load_n

    def road_force(z: Array, v: Array) -> Array:
        load = tyre_load(z, p[K_T], p[BETA], p[STATIC])
        return np.asarray(tyre_force(tyre_push(load, v, p[C_T], width), p[STATIC], width))

    change = road_force(x[:, 3:7] - road, x[:, 10:14] - rise)
    change -= road_force(x[:, 3:7], x[:, 10:14])
    out[:, 10:14] += change / p[MASS]
    return out, r


def _initial_state(car: Car, state: Array) -> InitialState:
    """Return a state in the form in which the fit describes the beginning of a run."""
    bare = InitialState(state[:14], state[14:18], np.zeros(4))
    beyond = state[18:] - first_state(car, bare, PATH)[0][18:] if car.has_mount else np.zeros(4)
    return InitialState(state[:14].copy(), state[14:18].copy(), beyond)


# The motion ---------------------------------------------------------------------------------------

ACROSS = np.array([1, 0, 3, 2])
"""The other corner of the axle."""
_TIGHT = 1e-11
_LARGEST = 100.0
"""Beyond any speed of a damper, m/s."""


@dataclass(frozen=True, slots=True)
class _Stack:
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


def _stack(cars: Sequence[Car], level: Level) -> _Stack:
    """Return the coefficients of a car for each row of states, or of one car for all."""
    parts = [_motion(one) for one in cars]
    corner = np.stack([one.corner for one in cars])
    travels, pushed, rest = (np.stack(part) for part in zip(*parts, strict=True))
    lines = _bends(corner, cars[0].knots, level.knee_m_s)
    ends, pieces = _pieces(lines, np.array(cars[0].knots), level.knee_m_s)
    first = np.arange(0, pieces[0].size, len(ends) + 1).reshape(-1, 4)
    gaps = np.where(corner[..., K_B] != 0.0, corner[..., GAP], np.inf)
    return _Stack(
        tuple(np.ascontiguousarray(corner[..., k]) for k in range(KNEES)),
        ends, pieces, first, travels, pushed, rest,
        cars[0].has_mount, float(gaps.min()) - level.stop_m,
        bool(corner[..., SURPLUS].any()), level,
    )  # fmt: skip


def _motion(one: Car) -> tuple[Array, Array, Array]:
    """Return the matrices of a car that a `_Stack` holds."""
    p = one.corner
    levers = np.stack([np.ones(4), -p[:, X], p[:, Y]])
    travels = np.zeros((8, 14))
    travels[:4, :3] = travels[4:, 7:10] = -levers.T
    travels[:4, 3:7] = travels[4:, 10:14] = np.eye(4)
    inverse = np.linalg.inv(one.mass)
    pushed = np.concatenate([inverse @ levers, -np.diag(1.0 / p[:, MASS])])
    return travels, pushed, np.concatenate([inverse @ one.pull, p[:, PULL] / p[:, MASS]])


def _bends(p: Array, knots: tuple[float, ...], width: float) -> Array:
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


def _curve(cars: _Stack, r: Array) -> tuple[Array, Array]:
    """Return force and slope of the axle's damper curve at the speeds r, (n, 4)."""
    which = cars.first_piece + np.searchsorted(cars.ends, r)
    level, slope, bend = (each.take(which) for each in cars.pieces)
    bend = bend * r
    return level + (slope + bend) * r, slope + 2.0 * bend


def _free_rates(x: Array, cars: _Stack, r: Array) -> tuple[Array, Array]:
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


def _road(cars: _Stack, z: Array, v: Array) -> Array:
    """Return the forces of the road beyond the static loads, at the wheels' heave and speed."""
    p, width = cars.p, cars.level.load_n
    load = tyre_load(z, p[K_T], p[BETA], p[STATIC])
    push = load - p[C_T] * v
    if load.min() > width and push.min() > width:  # all wheels stand on the road
        return np.asarray(push - p[STATIC])
    return np.asarray(tyre_force(tyre_push(load, v, p[C_T], width), p[STATIC], width))


def _damper_speeds(cars: _Stack, e: Array, w: Array, r: Array) -> Array:
    ratio, sigma, loss_s = cars.p[RATIO], cars.p[MOUNT], cars.level.loss_s
    for _ in range(25):
        force, slope = _curve(cars, r)
        left = mount_misfit(r, ratio * force, e, w, sigma, loss_s)
        step = left / mount_slope(ratio * slope, sigma, loss_s)
        r = r - step
        if np.abs(step).max() < _TIGHT:
            break
    return r
