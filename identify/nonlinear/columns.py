"""The tangents as machine code (Numba): a step of all columns in one loop that vectorises.

The Jacobian acts through the slopes of the four corners, so that a column costs some 150 operations
a stage; no matrix is dense.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from . import car, laws
from .kernels import bends, curve, curve_slope, kernel

# Columns side by side: reading, summing, writing --------------------------------------------------
#
# Columns are stored in blocks of `LANES`, one row of the state after the other: the distances
# between rows are then constants, from which the compiler knows that rows do not overlap.

LANES = 88
"""Columns in a block: an odd number of cache lines, so that rows do not evict each other."""


@njit(forceinline=True)
def read7(block, row, j):
    """Return seven rows of a column."""
    k = row * LANES + j
    return (
        block[k], block[k + LANES], block[k + 2 * LANES], block[k + 3 * LANES],
        block[k + 4 * LANES], block[k + 5 * LANES], block[k + 6 * LANES],
    )  # fmt: skip


@njit(forceinline=True)
def read4(block, row, j):
    """Return four rows of a column."""
    k = row * LANES + j
    return block[k], block[k + LANES], block[k + 2 * LANES], block[k + 3 * LANES]


@njit(forceinline=True)
def plus7(a, h, b):
    """Return `a + h b`."""
    return (
        a[0] + h * b[0], a[1] + h * b[1], a[2] + h * b[2], a[3] + h * b[3],
        a[4] + h * b[4], a[5] + h * b[5], a[6] + h * b[6],
    )  # fmt: skip


@njit(forceinline=True)
def plus4(a, h, b):
    """Return `a + h b`."""
    return a[0] + h * b[0], a[1] + h * b[1], a[2] + h * b[2], a[3] + h * b[3]


@njit(forceinline=True)
def corner_slopes(s, i):
    """Return the slopes that act at a corner."""
    return (
        s[i, 0], s[i, 1], s[i, 2], s[i, 3], s[i, 4], s[i, 5], s[i, 6],
        s[i, 7], s[i, 8], s[i, 9], s[i, 10], s[i, 11], s[i, 12],
    )  # fmt: skip


@njit(forceinline=True)
def node_slopes(s):
    """Return the slopes at the four corners, and the inverse of the body's mass."""
    body = s[4, 0], s[4, 1], s[4, 2], s[4, 3], s[4, 4], s[4, 5]
    return corner_slopes(s, 0), corner_slopes(s, 1), corner_slopes(s, 2), corner_slopes(s, 3), body


@njit(forceinline=True)
def mean7(a, b, c, d):
    """Return six times the mean of the four stages."""
    return (
        a[0] + 2.0 * (b[0] + c[0]) + d[0], a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2], a[3] + 2.0 * (b[3] + c[3]) + d[3],
        a[4] + 2.0 * (b[4] + c[4]) + d[4], a[5] + 2.0 * (b[5] + c[5]) + d[5],
        a[6] + 2.0 * (b[6] + c[6]) + d[6],
    )  # fmt: skip


@njit(forceinline=True)
def mean4(a, b, c, d):
    """Return six times the mean of the four stages."""
    return (
        a[0] + 2.0 * (b[0] + c[0]) + d[0], a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2], a[3] + 2.0 * (b[3] + c[3]) + d[3],
    )  # fmt: skip


@njit(forceinline=True)
def write7(out, row, j, a):
    """Write seven rows of a column."""
    k = row * LANES + j
    out[k], out[k + LANES], out[k + 2 * LANES], out[k + 3 * LANES] = a[0], a[1], a[2], a[3]
    out[k + 4 * LANES], out[k + 5 * LANES], out[k + 6 * LANES] = a[4], a[5], a[6]


@njit(forceinline=True)
def write4(out, row, j, a):
    """Write four rows of a column."""
    k = row * LANES + j
    out[k], out[k + LANES], out[k + 2 * LANES], out[k + 3 * LANES] = a[0], a[1], a[2], a[3]


# Slopes of the four corners, by which the Jacobian acts, and the forcing by each unknown ----------


@kernel
def linearise(x, rate, r, p, lines, knots, inverse, level, mounted, sparse, body, work, slopes,
              forcing):  # fmt: skip
    """Write the slopes that act on a column at a node, (5, 13), and the forcing by the unknowns."""
    first, kinds, columns, values = sparse
    body_columns, d_mass, d_pull = body
    push, by_force, by_speed, by_road, by_turn = work
    width = level[0]
    push[:] = 0.0
    forcing[:] = 0.0
    for i in range(4):
        one, k = p[i], i ^ 1
        u = x[3 + i] - x[0] + one[car.X] * x[1] - one[car.Y] * x[2]
        w = x[10 + i] - x[7] + one[car.X] * x[8] - one[car.Y] * x[9]
        across = x[3 + k] - x[0] + p[k, car.X] * x[1] - p[k, car.Y] * x[2]
        load = laws.tyre_load(x[3 + i], one[car.K_T], one[car.BETA], one[car.STATIC])
        by_load, damped = laws.tyre_slopes(load, x[10 + i], one[car.C_T], level[5])
        over = 1.0 / one[car.MASS]
        damping = one[car.RATIO] * curve_slope(one, knots, r[i], width)
        hard, gap, power = one[car.K_B], one[car.GAP], one[car.POWER]
        stop = laws.stop_slopes(u, hard, gap, power, level[4])
        stiff = laws.spring_stiffness(u, one[car.K_S], one[car.K_2], one[car.K_3])
        stiff += one[car.K_A] + stop[0]
        zeta, length, surplus, fall = x[14 + i], one[car.LENGTH], one[car.SURPLUS], one[car.FALL]
        limit = laws.sliding_share(w, surplus, fall)
        share_by_w, share_by_surplus, share_by_fall = laws.sliding_slopes(w, surplus, fall)
        by_w, by_zeta, by_length, by_limit = laws.friction_slopes(
            w, zeta, length, limit, level[1], level[2]
        )
        by_w += by_limit * share_by_w
        by_turn[car.LENGTH] = by_length
        by_turn[car.SURPLUS] = by_limit * share_by_surplus
        by_turn[car.FALL] = by_limit * share_by_fall
        force = (
            one[car.RATIO] * curve(lines[i], knots, r[i], width)
            + laws.spring_force(u, one[car.K_S], one[car.K_2], one[car.K_3])
            + laws.stop_force(u, hard, gap, power, level[4])
            + one[car.K_A] * (u - across)
            + one[car.F_C] * zeta
        )
        turn = 1.0 / laws.mount_slope(damping, one[car.MOUNT], level[3]) if mounted else 0.0
        through = level[3] * turn if mounted else 1.0
        s = slopes[i]
        s[0], s[1], s[2], s[3], s[4] = one[car.X], one[car.Y], stiff, one[car.K_A], one[car.F_C]
        s[5], s[6], s[7] = through, turn, damping
        s[8] = -by_load * one[car.K_T] * (1.0 - 2.0 * one[car.BETA] * x[3 + i]) * over
        s[9], s[10], s[11] = -damped * one[car.C_T] * over, over, by_w
        s[12] = by_zeta
        # By each coefficient: of the force, of the mount's equation, and of the wheel's push.
        ratio, sigma, z, curved = one[car.RATIO], one[car.MOUNT], x[3 + i], one[car.C] * r[i]
        for j in range(len(knots)):
            bent = laws.knee(r[i], knots[j], width)
            curved += one[car.KNEES + j] * bent
            by_force[car.KNEES + j] = ratio * bent
            by_speed[car.KNEES + j] = -sigma * ratio * bent
        by_force[car.K_S], by_force[car.K_2], by_force[car.K_3] = u, u * u, u * u * u
        by_force[car.K_B], by_force[car.GAP], by_force[car.POWER] = stop[1], -stop[0], stop[2]
        by_force[car.K_A], by_force[car.F_C] = u - across, zeta
        by_force[car.RATIO], by_force[car.C] = curved, ratio * r[i]
        by_speed[car.MOUNT] = -ratio * curved
        by_speed[car.RATIO], by_speed[car.C] = -sigma * curved, -sigma * ratio * r[i]
        by_road[car.K_T] = -by_load * z * (1.0 - one[car.BETA] * z)
        by_road[car.BETA] = by_load * one[car.K_T] * z * z
        by_road[car.C_T] = -damped * x[10 + i]
        by_road[car.STATIC] = by_load - 1.0
        by_road[car.MASS], by_road[car.PULL] = -rate[10 + i], 1.0
        for n in range(first[i], first[i + 1]):
            kind, value = kinds[n], values[n]
            b, j = columns[n] // LANES, columns[n] % LANES
            if kind in (car.X, car.Y):
                du = x[1] * value if kind == car.X else -x[2] * value
                dw = x[8] * value if kind == car.X else -x[9] * value
                push[b, i * LANES + j] += stiff * du + damping * through * dw
                push[b, k * LANES + j] -= p[k, car.K_A] * du
                forcing[b, (7 + i) * LANES + j] += by_w * dw
                forcing[b, (11 + i) * LANES + j] += (1.0 - through) * dw
                if kind == car.X:
                    push[b, 4 * LANES + j] -= force * value
                else:
                    push[b, 5 * LANES + j] += force * value
            else:
                speed = by_speed[kind] * turn * value
                push[b, i * LANES + j] += by_force[kind] * value + damping * speed
                forcing[b, (7 + i) * LANES + j] += by_turn[kind] * value
                forcing[b, (11 + i) * LANES + j] -= speed
                forcing[b, (3 + i) * LANES + j] += by_road[kind] * value * over
    for n in range(len(body_columns)):
        b, j = body_columns[n] // LANES, body_columns[n] % LANES
        for k in range(3):
            pull = d_pull[n, k]
            for m in range(3):
                pull -= d_mass[n, k, m] * rate[7 + m]
            row = (0, 4, 5)[k] if k else 6
            push[b, row * LANES + j] += pull
    s = slopes[4]
    s[0], s[1], s[2] = inverse[0, 0], inverse[0, 1], inverse[0, 2]
    s[3], s[4], s[5] = inverse[1, 1], inverse[1, 2], inverse[2, 2]
    for b in range(len(push)):
        _combine(push[b], slopes, forcing[b])


@kernel
def _combine(push, slopes, forcing):
    """Turn the forces at the corners and on the body into accelerations."""
    one, two, three, four, h = node_slopes(slopes)
    for j in range(LANES):
        f0, f1, f2, f3 = read4(push, 0, j)
        lift = f0 + f1 + f2 + f3 + push[6 * LANES + j]
        pitch = push[4 * LANES + j] - (one[0] * f0 + two[0] * f1 + three[0] * f2 + four[0] * f3)
        roll = push[5 * LANES + j] + one[1] * f0 + two[1] * f1 + three[1] * f2 + four[1] * f3
        forcing[j] = h[0] * lift + h[1] * pitch + h[2] * roll
        forcing[LANES + j] = h[1] * lift + h[3] * pitch + h[4] * roll
        forcing[2 * LANES + j] = h[2] * lift + h[4] * pitch + h[5] * roll
        forcing[3 * LANES + j] -= one[10] * f0
        forcing[4 * LANES + j] -= two[10] * f1
        forcing[5 * LANES + j] -= three[10] * f2
        forcing[6 * LANES + j] -= four[10] * f3


# The columns --------------------------------------------------------------------------------------

STATE_ROWS, FORCING_ROWS = 29, 15
"""Rows of a block: 22 of the state and 7 accelerations at the step's start; of the forcing, 7
accelerations, 4 rates of friction and 4 of the mounts."""


@njit(forceinline=True)
def _relative(x, i, corner):
    return x[3 + i] - x[0] + corner[0] * x[1] - corner[1] * x[2]


@njit(forceinline=True)
def _rates(q, v, z, e, node):
    """Return the rates of change of one column's speeds, frictions and mounts."""
    one, two, three, four, h = node
    u = (_relative(q, 0, one), _relative(q, 1, two), _relative(q, 2, three), _relative(q, 3, four))
    w = (_relative(v, 0, one), _relative(v, 1, two), _relative(v, 2, three), _relative(v, 3, four))
    r = (
        one[5] * w[0] + one[6] * e[0], two[5] * w[1] + two[6] * e[1],
        three[5] * w[2] + three[6] * e[2], four[5] * w[3] + four[6] * e[3],
    )  # fmt: skip
    f0 = one[2] * u[0] - one[3] * u[1] + one[4] * z[0] + one[7] * r[0]
    f1 = two[2] * u[1] - two[3] * u[0] + two[4] * z[1] + two[7] * r[1]
    f2 = three[2] * u[2] - three[3] * u[3] + three[4] * z[2] + three[7] * r[2]
    f3 = four[2] * u[3] - four[3] * u[2] + four[4] * z[3] + four[7] * r[3]
    lift = f0 + f1 + f2 + f3
    pitch = -(one[0] * f0 + two[0] * f1 + three[0] * f2 + four[0] * f3)
    roll = one[1] * f0 + two[1] * f1 + three[1] * f2 + four[1] * f3
    acceleration = (
        h[0] * lift + h[1] * pitch + h[2] * roll,
        h[1] * lift + h[3] * pitch + h[4] * roll,
        h[2] * lift + h[4] * pitch + h[5] * roll,
        one[8] * q[3] + one[9] * v[3] - one[10] * f0,
        two[8] * q[4] + two[9] * v[4] - two[10] * f1,
        three[8] * q[5] + three[9] * v[5] - three[10] * f2,
        four[8] * q[6] + four[9] * v[6] - four[10] * f3,
    )
    friction = (
        one[11] * w[0] + one[12] * z[0], two[11] * w[1] + two[12] * z[1],
        three[11] * w[2] + three[12] * z[2], four[11] * w[3] + four[12] * z[3],
    )  # fmt: skip
    return acceleration, friction, (w[0] - r[0], w[1] - r[1], w[2] - r[2], w[3] - r[3])


@njit(forceinline=True)
def _forced(q, v, z, e, node, forcing, j):
    a, b, c = _rates(q, v, z, e, node)
    return (
        plus7(a, 1.0, read7(forcing, 0, j)), plus4(b, 1.0, read4(forcing, 7, j)),
        plus4(c, 1.0, read4(forcing, 11, j)),
    )  # fmt: skip


@kernel
def rk4(count, block, first, middle, last, f_first, f_middle, f_last, h, out):
    """Write a block of columns one step later, and its accelerations at the start of the step."""
    begin, half, end = node_slopes(first), node_slopes(middle), node_slopes(last)
    for j in range(count):
        q, v, z, e = (
            read7(block, 0, j),
            read7(block, 7, j),
            read4(block, 14, j),
            read4(block, 18, j),
        )
        a1, b1, c1 = _forced(q, v, z, e, begin, f_first, j)
        v2 = plus7(v, 0.5 * h, a1)
        a2, b2, c2 = _forced(
            plus7(q, 0.5 * h, v), v2, plus4(z, 0.5 * h, b1), plus4(e, 0.5 * h, c1), half,
            f_middle, j,
        )  # fmt: skip
        v3 = plus7(v, 0.5 * h, a2)
        a3, b3, c3 = _forced(
            plus7(q, 0.5 * h, v2), v3, plus4(z, 0.5 * h, b2), plus4(e, 0.5 * h, c2), half,
            f_middle, j,
        )  # fmt: skip
        v4 = plus7(v, h, a3)
        a4, b4, c4 = _forced(plus7(q, h, v3), v4, plus4(z, h, b3), plus4(e, h, c3), end, f_last, j)
        write7(out, 0, j, plus7(q, h / 6.0, mean7(v, v2, v3, v4)))
        write7(out, 7, j, plus7(v, h / 6.0, mean7(a1, a2, a3, a4)))
        write4(out, 14, j, plus4(z, h / 6.0, mean4(b1, b2, b3, b4)))
        write4(out, 18, j, plus4(e, h / 6.0, mean4(c1, c2, c3, c4)))
        write7(out, 22, j, a1)


@kernel
def tangents(step_s, states, rates, speeds, p, knots, inverse, mounted, sparse, body,
             starts, lengths, fine, levels, count, trace):  # fmt: skip
    """Integrate the tangents along a path into `trace`, (n + 1, blocks, rows), from its first."""
    blocks = trace.shape[1]
    kinds = p.shape[1]
    work = (
        np.empty((blocks, 7 * LANES)), np.zeros(kinds), np.zeros(kinds), np.zeros(kinds),
        np.zeros(kinds),
    )  # fmt: skip
    slopes = np.zeros((3, 5, 13))
    forcing = np.empty((3, blocks, FORCING_ROWS * LANES))
    lines = bends(p, knots, levels[0][0]), bends(p, knots, levels[1][0])
    known = -1
    for m in range(len(starts)):
        which = fine[m]
        level = levels[which]
        a, b = starts[m], starts[m] + lengths[m]
        half = a + lengths[m] // 2
        if known == which:
            slopes[0], forcing[0] = slopes[2], forcing[2]
        else:
            linearise(states[a], rates[a], speeds[a], p, lines[which], knots, inverse, level,
                      mounted, sparse, body, work, slopes[0], forcing[0])  # fmt: skip
        linearise(states[half], rates[half], speeds[half], p, lines[which], knots, inverse, level,
                  mounted, sparse, body, work, slopes[1], forcing[1])  # fmt: skip
        linearise(states[b], rates[b], speeds[b], p, lines[which], knots, inverse, level,
                  mounted, sparse, body, work, slopes[2], forcing[2])  # fmt: skip
        known = which
        for n in range(blocks):
            lanes = min(LANES, count - n * LANES)
            rk4(lanes, trace[m, n], slopes[0], slopes[1], slopes[2], forcing[0, n], forcing[1, n],
                forcing[2, n], lengths[m] * step_s, trace[m + 1, n])  # fmt: skip
    m = len(starts)
    for n in range(blocks):
        lanes = min(LANES, count - n * LANES)
        rk4(lanes, trace[m, n], slopes[2], slopes[2], slopes[2], forcing[2, n], forcing[2, n],
            forcing[2, n], 0.0, trace[m + 1, n])  # fmt: skip


@kernel
def add_sampled(trace, count, before, weights, order, first, motions, shares, out):
    """Add the tangents of some channels, (n, channels, columns), at given times to `out`.

    `weights` are those of displacement, speed and acceleration by both ends' displacements, speeds
    and accelerations, (n, 3, 4); a channel is of one time derivative and of some of the motions.
    """
    for n in range(len(before)):
        k = before[n]
        for c in range(len(order)):
            kind = order[c]
            low = 0 if kind == 0 else 7
            slope = low + 7 if low == 0 else 22
            w0, w1, w2, w3 = weights[n, kind]
            for m in range(first[c], first[c + 1]):
                x, share = motions[m], shares[m]
                for b in range(trace.shape[1]):
                    lanes = min(LANES, count - b * LANES)
                    late = 1 if low == 7 else 0
                    row = out[n, c, b * LANES : b * LANES + lanes]
                    at, then = (low + x) * LANES, (slope + x) * LANES
                    v0 = trace[k, b, at : at + lanes]
                    v1 = trace[k + 1, b, at : at + lanes]
                    s0 = trace[k + late, b, then : then + lanes]
                    s1 = trace[k + 1 + late, b, then : then + lanes]
                    for j in range(lanes):
                        row[j] += share * (w0 * v0[j] + w1 * v1[j] + w2 * s0[j] + w3 * s1[j])
