"""The laws of the force elements, each with its derivatives.

Displacements and speeds of a suspension are positive in compression, forces act upwards on the
body.  Every function takes scalars or arrays and is free of branches on them, so that the same
formula is the NumPy reference and, compiled by Numba, the fast path.  `width` rounds a corner.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Value = Any
"""A float64 scalar or array: the formulas of the elements take and return either."""

# The hinge: zero on one side, a line on the other, a parabola between; beyond its rounding it is
# exact, so that a hinge which is never reached leaves no trace.


def hinge(x: Value, width: Value) -> Value:
    """Return 0 below -width, x above width, and a parabola between."""
    inside = np.minimum(np.maximum(x, -width), width) + width
    return inside * inside / (4.0 * width) + np.maximum(x - width, 0.0)


def hinge_slope(x: Value, width: Value) -> Value:
    """Return the derivative of `hinge` by x, 0..1."""
    return (np.minimum(np.maximum(x, -width), width) + width) / (2.0 * width)


# The damper: a curve of straight segments with rounded knees.  Parameters: c [N s/m], the slope
# before all knees; h_j [N s/m], by how much the slope grows where the speed passes knot j outwards
# (from rebound to compression at a knot of 0).  With the secant between `SECANT_M_S` instead of c,
# no h_j changes the reported coefficient.

SECANT_M_S = 0.1
"""Speed, m/s, between whose negative and positive value a damper's coefficient is the secant:
the lowest that the usual tables of dampers state."""


def knee(w: Value, knot: Value, width: Value) -> Value:
    """Return the speed beyond a knot, m/s: 0 at rest; negative, in rebound, for a knot below 0."""
    if knot < 0.0:
        return hinge(knot, width) - hinge(knot - w, width)
    return hinge(w - knot, width) - hinge(-knot, width)


def knee_slope(w: Value, knot: Value, width: Value) -> Value:
    """Return the derivative of `knee` by w, 0..1."""
    if knot < 0.0:
        return hinge_slope(knot - w, width)
    return hinge_slope(w - knot, width)


def secant_share(knot: float, width: float) -> float:
    """Return by how much one unit of h_j raises the secant between +-`SECANT_M_S`."""
    rise = knee(SECANT_M_S, knot, width) - knee(-SECANT_M_S, knot, width)
    return float(rise / (2.0 * SECANT_M_S))


# Dry friction: it sticks over a short length, then slides (Dahl; Canudas de Wit and others).
# Parameters: F_c [N], the sliding force; d [m], the pre-sliding length (rubber of the top mount,
# lip of the seal); r, by what share of F_c the static force exceeds it, and v [m/s], the speed
# over which that surplus falls off (Stribeck).  State: zeta, the share of F_c that acts.  Without
# surplus it is Dahl's law, and zeta lies within -1..1.  The law in this form (Clavel, Sorine and
# Zhang) keeps its memory at reversals, has no stiff term at rest and needs no events; at F_c = 0
# its derivative by F_c exists.


def sliding_share(w: Value, surplus: Value, fall: Value) -> Value:
    """Return the share of F_c at which it slides at a speed w; `surplus` is r, `fall` v, m/s."""
    return 1.0 + surplus * np.exp(-(w * w) / (fall * fall))


def sliding_slopes(w: Value, surplus: Value, fall: Value) -> tuple[Value, Value, Value]:
    """Return the derivatives of `sliding_share` by w, r and v."""
    acts = np.exp(-(w * w) / (fall * fall))
    by_speed = -2.0 * w / (fall * fall) * surplus * acts
    return by_speed, acts, -w / fall * by_speed


def friction_rate(
    w: Value, zeta: Value, length: Value, limit: Value, width: Value, lag_s: Value
) -> Value:
    """Return the rate of change of zeta, the share of F_c that acts, at a speed w, m/s: 1/s.

    `length`: d, m.  `limit`: the share at which it slides.  `width`: speed, m/s, below which it
    counts as at rest.  `lag_s`: bounds the rate to 2 / `lag_s`.
    """
    speed = np.sqrt(w * w + width * width)
    return (w - speed * zeta / limit) / (length + lag_s * speed)


def friction_slopes(
    w: Value, zeta: Value, length: Value, limit: Value, width: Value, lag_s: Value
) -> tuple[Value, Value, Value, Value]:
    """Return the derivatives of `friction_rate` by w, zeta, d and the limit."""
    speed = np.sqrt(w * w + width * width)
    # Slope of the rounded speed by w; fraction of the limit; denominator of the rate.
    turn, share, below = w / speed, zeta / limit, length + lag_s * speed
    rate = (w - speed * share) / below
    by_w = (1.0 - turn * share - rate * lag_s * turn) / below
    return by_w, -speed / limit / below, -rate / below, speed * share / limit / below


# The damper's mount: a compliance in series with the damper.  Parameter: sigma = 1/k_m [m/N]; 0 is
# rigid.  State: the mount's deflection e [m].  A small loss of the rubber, t0 [s], makes the form
# regular: ``sigma D(r) + t0 r = e + t0 w`` gives the speed r in the damper, which is w exactly
# where sigma is 0, and no term is stiff for any sigma >= 0.


def mount_misfit(r: Value, force: Value, e: Value, w: Value, sigma: Value, loss_s: Value) -> Value:
    """Return the residual, m, of the mount's equation at the speed r; `force` is the damper's."""
    return sigma * force + loss_s * r - e - loss_s * w


def mount_slope(damping: Value, sigma: Value, loss_s: Value) -> Value:
    """Return the derivative of `mount_misfit` by r, s; `damping` is the slope of the force."""
    return sigma * damping + loss_s


# Spring and bump stop.  Parameters: k_s [N/m], k_2 [N/m2] (stiffer in compression where positive),
# k_3 [N/m3].  From the gap g [m] of travel on, a stop of foam pushes by a power p of its
# compression: 1 is a hard edge, 2 a parabola; k_b [N/m] is its force over its compression at
# `STOP_DEPTH_M`.

STOP_DEPTH_M = 0.01
"""Compression of a bump stop, m, for which its stiffness is stated."""


def spring_force(u: Value, k_s: Value, k_2: Value, k_3: Value) -> Value:
    """Return the force, N, at the travel u, m; its derivatives by k_s, k_2, k_3 are u, u2, u3."""
    return u * (k_s + u * (k_2 + u * k_3))


def spring_stiffness(u: Value, k_s: Value, k_2: Value, k_3: Value) -> Value:
    """Return the derivative of `spring_force` by u, N/m."""
    return k_s + u * (2.0 * k_2 + 3.0 * k_3 * u)


def stop_force(u: Value, k_b: Value, gap: Value, power: Value, width: Value) -> Value:
    """Return the force, N, at the travel u, m; `power` is p, at least 1."""
    return k_b * STOP_DEPTH_M * (hinge(u - gap, width) / STOP_DEPTH_M) ** power


def stop_slopes(
    u: Value, k_b: Value, gap: Value, power: Value, width: Value
) -> tuple[Value, Value, Value]:
    """Return the derivatives of `stop_force` by u (by the gap its negative), k_b and p."""
    depth = hinge(u - gap, width) / STOP_DEPTH_M
    by_rate = STOP_DEPTH_M * depth**power
    by_travel = k_b * power * depth ** (power - 1.0) * hinge_slope(u - gap, width)
    return by_travel, by_rate, k_b * by_rate * np.log(np.maximum(depth, 1e-300))


# The tyre: a progressive spring with a little damping that can push and never pull.  Parameters:
# k_t [N/m] at the static load, beta [1/m] of its progressivity, c_t [N s/m].  It acts beyond the
# static load W [N], against which the heave of the wheel is counted.  In the air it does nothing,
# however fast it comes down: its damping begins with its load.  `width`: half the range of load, N,
# over which it meets and leaves the road.


def tyre_load(z: Value, k_t: Value, beta: Value, static: Value) -> Value:
    """Return the load of the tyre's spring if it could pull, N, at heave z, m."""
    return static - k_t * z * (1.0 - beta * z)


def tyre_push(load: Value, v: Value, c_t: Value, width: Value) -> Value:
    """Return spring and damping together, N, while the wheel rises at v, m/s."""
    return load - c_t * v * hinge_slope(load, width)


def tyre_force(push: Value, static: Value, width: Value) -> Value:
    """Return the force of the road on the wheel beyond the static load, N."""
    return hinge(push, width) - static


def tyre_slopes(load: Value, v: Value, c_t: Value, width: Value) -> tuple[Value, Value]:
    """Return the derivatives of the road's force by the load of the spring, and by minus c_t v."""
    contact = hinge_slope(tyre_push(load, v, c_t, width), width)
    bend = (np.abs(load) < width) / (2.0 * width)
    return contact * (1.0 - c_t * v * bend), contact * hinge_slope(load, width)
