"""Slopes and forcing of the tangents at a node of the path, as machine code (Numba).

The slopes of the four corners, by which the Jacobian acts, and the forcing by each unknown.
"""

from __future__ import annotations

from ..elements import friction, hinge, mount, spring, stop, tyre
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
    X,
    Y,
)  # fmt: skip
from .compiled import kernel
from .kernels import curve, curve_slope, knee
from .lanes import LANES, node_slopes, read4

hinge_ = hinge.hinge
spring_force, spring_stiffness = spring.spring_force, spring.spring_stiffness
stop_force, stop_stiffness = stop.stop_force, stop.stop_stiffness
friction_rate_by_speed = friction.friction_rate_by_speed
friction_rate_by_share = friction.friction_rate_by_share
friction_rate_by_length = friction.friction_rate_by_length
friction_rate_by_limit = friction.friction_rate_by_limit
sliding_share, sliding_share_by_speed = friction.sliding_share, friction.sliding_share_by_speed
sliding_share_by_surplus = friction.sliding_share_by_surplus
sliding_share_by_fall = friction.sliding_share_by_fall
tyre_load, tyre_load_by_heave = tyre.tyre_load, tyre.tyre_load_by_heave
tyre_push, tyre_push_by_load = tyre.tyre_push, tyre.tyre_push_by_load
tyre_contact, tyre_grip = tyre.tyre_contact, tyre.tyre_grip
mount_slope = mount.mount_slope


@kernel
def _tyre_slopes(one, z, v, width):
    """Return the derivatives of the road's force by the tyre's load and by its damping."""
    load = tyre_load(z, one[K_T], one[BETA], one[STATIC])
    contact = tyre_contact(tyre_push(load, v, one[C_T], width), width)
    by_load = contact * tyre_push_by_load(load, v, one[C_T], width)
    return by_load, contact * tyre_grip(load, width)


@kernel
def _partials(one, knots, level, x, rate, r, u, across, i, by_force, by_speed, by_road):
    """Write the derivatives by each coefficient: of force, mount's equation and wheel's push."""
    width = level[0]
    force = one[C] * r
    ratio, sigma, z = one[RATIO], one[MOUNT], x[3 + i]
    for j in range(len(knots)):
        bent = knee(r, knots[j], width)
        force += one[KNEES + j] * bent
        by_force[KNEES + j] = ratio * bent
        by_speed[KNEES + j] = -sigma * ratio * bent
    by_force[K_S], by_force[K_2], by_force[K_3] = u, u * u, u * u * u
    by_force[K_B] = hinge_(u - one[GAP], level[4])
    by_force[GAP] = -stop_stiffness(u, one[K_B], one[GAP], level[4])
    by_force[K_A] = u - across
    by_force[F_C] = x[14 + i]
    by_force[RATIO], by_force[C] = force, ratio * r
    by_speed[MOUNT] = -ratio * force
    by_speed[RATIO], by_speed[C] = -sigma * force, -sigma * ratio * r
    by_load, damped = _tyre_slopes(one, z, x[10 + i], level[5])
    by_road[K_T] = -by_load * z * (1.0 - one[BETA] * z)
    by_road[BETA] = by_load * one[K_T] * z * z
    by_road[C_T] = -damped * x[10 + i]
    by_road[STATIC] = by_load - 1.0
    by_road[MASS], by_road[PULL] = -rate[10 + i], 1.0


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
        u = x[3 + i] - x[0] + one[X] * x[1] - one[Y] * x[2]
        w = x[10 + i] - x[7] + one[X] * x[8] - one[Y] * x[9]
        across = x[3 + k] - x[0] + p[k, X] * x[1] - p[k, Y] * x[2]
        by_load, damped = _tyre_slopes(one, x[3 + i], x[10 + i], level[5])
        over = 1.0 / one[MASS]
        damping = one[RATIO] * curve_slope(one, knots, r[i], width)
        stiff = spring_stiffness(u, one[K_S], one[K_2], one[K_3]) + one[K_A]
        stiff += stop_stiffness(u, one[K_B], one[GAP], level[4])
        zeta, length, limit = x[14 + i], one[LENGTH], sliding_share(w, one[SURPLUS], one[FALL])
        by_limit = friction_rate_by_limit(w, zeta, length, limit, level[1], level[2])
        by_w = friction_rate_by_speed(w, zeta, length, limit, level[1], level[2])
        by_w += by_limit * sliding_share_by_speed(w, one[SURPLUS], one[FALL])
        by_turn[LENGTH] = friction_rate_by_length(w, zeta, length, limit, level[1], level[2])
        by_turn[SURPLUS] = by_limit * sliding_share_by_surplus(w, one[FALL])
        by_turn[FALL] = by_limit * sliding_share_by_fall(w, one[SURPLUS], one[FALL])
        force = (
            one[RATIO] * curve(lines[i], knots, r[i], width)
            + spring_force(u, one[K_S], one[K_2], one[K_3])
            + stop_force(u, one[K_B], one[GAP], level[4])
            + one[K_A] * (u - across)
            + one[F_C] * zeta
        )
        turn = 1.0 / mount_slope(damping, one[MOUNT], level[3]) if mounted else 0.0
        through = level[3] * turn if mounted else 1.0
        s = slopes[i]
        s[0], s[1], s[2], s[3], s[4] = one[X], one[Y], stiff, one[K_A], one[F_C]
        s[5], s[6], s[7] = through, turn, damping
        s[8] = by_load * tyre_load_by_heave(x[3 + i], one[K_T], one[BETA]) * over
        s[9], s[10], s[11] = -damped * one[C_T] * over, over, by_w
        s[12] = friction_rate_by_share(w, length, limit, level[1], level[2])
        _partials(one, knots, level, x, rate, r[i], u, across, i, by_force, by_speed, by_road)
        for n in range(first[i], first[i + 1]):
            kind, value = kinds[n], values[n]
            b, j = columns[n] // LANES, columns[n] % LANES
            if kind in (X, Y):
                du = x[1] * value if kind == X else -x[2] * value
                dw = x[8] * value if kind == X else -x[9] * value
                push[b, i * LANES + j] += stiff * du + damping * through * dw
                push[b, k * LANES + j] -= p[k, K_A] * du
                forcing[b, (7 + i) * LANES + j] += by_w * dw
                forcing[b, (11 + i) * LANES + j] += (1.0 - through) * dw
                if kind == X:
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
