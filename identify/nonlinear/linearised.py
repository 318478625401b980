"""The motion linearised along a path: Jacobians and forcing, and the tangents by them (NumPy)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..elements.damper import knee
from ..elements.friction import (
    friction_rate_by_length,
    friction_rate_by_limit,
    friction_rate_by_share,
    friction_rate_by_speed,
    sliding_share,
    sliding_share_by_fall,
    sliding_share_by_speed,
    sliding_share_by_surplus,
)
from ..elements.mount import mount_slope
from ..elements.spring import spring_force, spring_stiffness
from ..elements.stop import stop_by_rate, stop_force, stop_stiffness
from ..elements.tyre import (
    tyre_contact,
    tyre_grip,
    tyre_load,
    tyre_load_by_heave,
    tyre_push,
    tyre_push_by_load,
)
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
from .path import STATES, Path
from .reference import ACROSS, curve
from .tangent import Plan, SampledChannels, Start

Array = NDArray[np.float64]

_TOGETHER = 64
"""Number of tangent steps computed at once: few enough to stay in a processor's cache."""


def linearised(
    car: Car, acts: NDArray[np.intp], level: Level, x: Array, rate: Array, r: Array
) -> Array:
    """Return Jacobian and forcing by the acting unknowns side by side at states, (n, 22, 22 + A).

    Parameters
    ----------
    car : Car
        Coefficients and their derivatives.
    acts : (A,) intp
        Positions of the acting unknowns among the free ones.
    level : Level
        Rounding of the laws.
    x, rate : (n, 22) float64
        States and their rates of change on the path.
    r : (n, 4) float64
        Speeds of the dampers.
    """
    p, D = car.corner, car.d_corner[:, :, acts]
    n = len(x)
    to_u, to_w = np.zeros((4, STATES)), np.zeros((4, STATES))
    for i in range(4):
        to_u[i, [0, 1, 2, 3 + i]] = (-1.0, p[i, X], -p[i, Y], 1.0)
        to_w[i, [7, 8, 9, 10 + i]] = (-1.0, p[i, X], -p[i, Y], 1.0)
    u, w = x @ to_u.T, x @ to_w.T
    z, v, zeta = x[:, 3:7], x[:, 10:14], x[:, 14:18]
    force, slope = curve(p, car.knots, r, level.knee_m_s)
    ratio, sigma = p[:, RATIO], p[:, MOUNT]
    damping = ratio * slope
    stiff = spring_stiffness(u, p[:, K_S], p[:, K_2], p[:, K_3]) + p[:, K_A]
    stiff = stiff + stop_stiffness(u, p[:, K_B], p[:, GAP], level.stop_m)
    total = (
        ratio * force
        + spring_force(u, p[:, K_S], p[:, K_2], p[:, K_3])
        + stop_force(u, p[:, K_B], p[:, GAP], level.stop_m)
        + p[:, K_A] * (u - u[:, ACROSS])
        + p[:, F_C] * zeta
    )
    load = tyre_load(z, p[:, K_T], p[:, BETA], p[:, STATIC])
    contact = tyre_contact(tyre_push(load, v, p[:, C_T], level.load_n), level.load_n)
    by_load = contact * tyre_push_by_load(load, v, p[:, C_T], level.load_n)
    damped = contact * tyre_grip(load, level.load_n)

    # Derivatives by each coefficient: of the force, of the mount's equation, of the wheel's push.
    by_force, by_speed, by_road = (np.zeros((n, 4, p.shape[1])) for _ in range(3))
    for k, value in ((K_S, u), (K_2, u**2), (K_3, u**3), (K_A, u - u[:, ACROSS]), (F_C, zeta)):
        by_force[:, :, k] = value
    by_force[:, :, K_B] = stop_by_rate(u, p[:, GAP], level.stop_m)
    by_force[:, :, GAP] = -stop_stiffness(u, p[:, K_B], p[:, GAP], level.stop_m)
    by_force[:, :, RATIO], by_force[:, :, C] = force, ratio * r
    by_speed[:, :, MOUNT], by_speed[:, :, RATIO] = -ratio * force, -sigma * force
    by_speed[:, :, C] = -sigma * ratio * r
    for j, at in enumerate(car.knots):
        bent = ratio * knee(r, at, level.knee_m_s)
        by_force[:, :, KNEES + j], by_speed[:, :, KNEES + j] = bent, -sigma * bent
    by_road[:, :, K_T] = -by_load * z * (1.0 - p[:, BETA] * z)
    by_road[:, :, BETA] = by_load * p[:, K_T] * z**2
    by_road[:, :, C_T] = -damped * v
    by_road[:, :, STATIC] = by_load - 1.0
    by_road[:, :, MASS], by_road[:, :, PULL] = -rate[:, 10:14], 1.0

    def coefficients(slopes: Array) -> Array:
        return np.stack([slopes[:, i] @ D[i] for i in range(4)], axis=1)

    du = x[:, 1, None, None] * D[:, X] - x[:, 2, None, None] * D[:, Y]
    dw = x[:, 8, None, None] * D[:, X] - x[:, 9, None, None] * D[:, Y]
    size = STATES + len(acts)
    all_u = np.concatenate([np.broadcast_to(to_u, (n, 4, STATES)), du], axis=2)
    all_w = np.concatenate([np.broadcast_to(to_w, (n, 4, STATES)), dw], axis=2)
    share, mount = np.zeros((4, size)), np.zeros((4, size))
    share[range(4), range(14, 18)] = 1.0
    mount[range(4), range(18, 22)] = 1.0
    if car.has_mount:
        left = mount + level.loss_s * all_w
        left[:, :, STATES:] += coefficients(by_speed)
        speed = left / mount_slope(damping, sigma, level.loss_s)[:, :, None]
    else:
        speed = all_w
    push = stiff[:, :, None] * all_u - p[:, K_A, None] * all_u[:, ACROSS]
    push += damping[:, :, None] * speed + p[:, F_C, None] * share
    push[:, :, STATES:] += coefficients(by_force)

    out = np.zeros((n, STATES, size))
    out[:, range(7), range(7, 14)] = 1.0
    body = np.empty((n, 3, size))
    body[:, 0] = push.sum(axis=1)
    body[:, 1] = -(p[:, X, None] * push).sum(axis=1)
    body[:, 2] = (p[:, Y, None] * push).sum(axis=1)
    body[:, 1, STATES:] -= total @ D[:, X]
    body[:, 2, STATES:] += total @ D[:, Y]
    body[:, :, STATES:] += car.d_pull[acts].T
    body[:, :, STATES:] -= np.einsum("akm,nm->nka", car.d_mass[acts], rate[:, 7:10])
    out[:, 7:10] = np.linalg.inv(car.mass) @ body
    wheel = -push
    wheel[:, range(4), range(3, 7)] += by_load * tyre_load_by_heave(z, p[:, K_T], p[:, BETA])
    wheel[:, range(4), range(10, 14)] -= damped * p[:, C_T]
    wheel[:, :, STATES:] += coefficients(by_road)
    out[:, 10:14] = wheel / p[:, MASS, None]
    rounding = (level.turn_m_s, level.lag_s)
    length, surplus, fall = p[:, LENGTH], p[:, SURPLUS], p[:, FALL]
    limit = sliding_share(w, surplus, fall)
    by_limit = friction_rate_by_limit(w, zeta, length, limit, *rounding)
    by_w = friction_rate_by_speed(w, zeta, length, limit, *rounding)
    by_w = by_w + by_limit * sliding_share_by_speed(w, surplus, fall)
    by_z = friction_rate_by_share(w, length, limit, *rounding)
    out[:, 14:18] = by_w[:, :, None] * all_w + by_z[:, :, None] * share
    for kind, by_kind in (
        (LENGTH, friction_rate_by_length(w, zeta, length, limit, *rounding)),
        (SURPLUS, by_limit * sliding_share_by_surplus(w, fall)),
        (FALL, by_limit * sliding_share_by_fall(w, surplus, fall)),
    ):
        out[:, 14:18, STATES:] += by_kind[:, :, None] * D[:, kind]
    if car.has_mount:
        out[:, 18:] = all_w - speed
    return out


@dataclass(frozen=True, slots=True)
class Trace:
    """Tangents at the nodes of a plan."""

    states: Array
    """(n, 14, columns), of displacements and speeds."""
    accelerations: Array
    """(n, 7, columns)."""


def tangents(car: Car, acts: NDArray[np.intp], path: Path, start: Start, plan: Plan) -> Trace:
    """Return the tangents along a path, as `add_sampled` takes them."""
    n_own = start.matrix.shape[1] - len(acts)
    steps = len(plan.starts)
    trace = Trace(
        np.empty((steps + 1, 14, start.matrix.shape[1])),
        np.empty((steps + 1, 7, start.matrix.shape[1])),
    )

    def note(k: int, S: Array, slope: Array) -> None:
        trace.states[k] = S[:14]
        trace.accelerations[k] = slope[:, :STATES] @ S
        trace.accelerations[k, :, n_own:] += slope[:, STATES:]

    S = start.matrix
    for begin in range(0, steps, _TOGETHER):
        part = slice(begin, begin + _TOGETHER)
        first, middle, last = _at_nodes(car, acts, path, plan, part)
        lengths_s = np.asarray(plan.lengths[part] * path.step_s, dtype=np.float64)
        advances = _steps(first, middle, last, lengths_s)
        for k, (advance, at) in enumerate(zip(advances, first, strict=True), begin):
            note(k, S, at[7:14])
            S = advance[:, :STATES] @ S
            S[:, n_own:] += advance[:, STATES:]
    note(steps, S, last[-1, 7:14])
    return trace


def _at_nodes(
    car: Car, acts: NDArray[np.intp], path: Path, plan: Plan, part: slice
) -> tuple[Array, Array, Array]:
    """Return Jacobians and forcing side by side at first, middle and last node of some steps.

    Most steps begin where another ends, so the values at a node are computed once for each level.
    """
    starts, lengths, fine = plan.starts[part], plan.lengths[part], plan.fine[part]
    nodes = np.stack([starts, starts + lengths // 2, starts + lengths])
    found, place = np.unique(2 * nodes + fine, return_inverse=True)
    every = np.empty((len(found), STATES, STATES + len(acts)))
    for level in (0, 1):
        chosen = found % 2 == level
        if chosen.any():
            at = found[chosen] // 2
            every[chosen] = linearised(
                car, acts, plan.levels[level], path.states[at], path.slopes[at], path.speeds[at]
            )
    first, middle, last = every[place.reshape(nodes.shape)]
    return first, middle, last


def _steps(first: Array, middle: Array, last: Array, lengths_s: Array) -> Array:
    """Return Runge-Kutta steps ``S -> Phi S + Gamma``, (n, 22, 22 + A): Phi and Gamma together.

    `first`, `middle`, `last`: Jacobian and forcing at the nodes; `lengths_s`: (n,).
    """
    h = lengths_s[:, None, None]

    def stage(at: Array, share: Array, before: Array) -> Array:
        after = at.copy()
        after[:, :7] += share * before[:, 7:14]
        after[:, 7:] += at[:, 7:, :STATES] @ (share * before)
        return after

    k2 = stage(middle, 0.5 * h, first)
    k3 = stage(middle, 0.5 * h, k2)
    k4 = stage(last, h, k3)
    k2 += k3
    k2 *= 2.0
    k2 += first
    k2 += k4
    k2 *= h / 6.0
    k2[:, range(STATES), range(STATES)] += 1.0
    return k2


def add_sampled(trace: Trace, given: SampledChannels, out: Array) -> None:
    """Add the tangents of some channels at some times to `out`, (n, channels, columns)."""
    k = given.before
    S, A = trace.states, trace.accelerations
    for c, order in enumerate(given.orders.tolist()):
        part = slice(int(given.first[c]), int(given.first[c + 1]))
        motions, shares = given.motions[part], given.shares[part]
        low = 0 if order == 0 else 7
        values = np.tensordot(shares, S[:, low + motions], (0, 1))
        slopes = np.tensordot(shares, S[:, 7 + motions] if order == 0 else A[:, motions], (0, 1))
        a, b, c0, d = (w[:, None] for w in given.weights[:, order].T)
        out[:, c] += a * values[k] + b * values[k + 1] + c0 * slopes[k] + d * slopes[k + 1]
