"""The path and its tangents as machine code (Numba), for one run at a time.

The formulas are those of `identify.elements`; `reference` says the same with NumPy's arrays, and
the two agree to rounding.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ..elements import bar, damper, friction, hinge, mount, spring, stop, tyre
from .car import (
    BETA,
    C_T,
    F_C,
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
    C,
    X,
    Y,
)  # fmt: skip

_LOOSE = {"reassoc", "contract", "arcp", "nsz"}
"""Rearrangements that the compiler may make; NaN must stay NaN."""

for _module in (hinge, spring, stop, bar, damper, friction, tyre, mount):
    for _name, _formula in vars(_module).items():
        if callable(_formula) and getattr(_formula, "__module__", "") == _module.__name__:
            register_jitable(error_model="numpy", fastmath=_LOOSE)(_formula)

hinge_, hinge_slope = hinge.hinge, hinge.hinge_slope
knee, knee_slope = damper.knee, damper.knee_slope
spring_force, spring_stiffness = spring.spring_force, spring.spring_stiffness
stop_force, stop_stiffness = stop.stop_force, stop.stop_stiffness
bar_force = bar.bar_force
friction_rate = friction.friction_rate
friction_rate_by_speed = friction.friction_rate_by_speed
friction_rate_by_share = friction.friction_rate_by_share
friction_rate_by_length = friction.friction_rate_by_length
tyre_load, tyre_force = tyre.tyre_load, tyre.tyre_force
tyre_contact, tyre_load_by_heave = tyre.tyre_contact, tyre.tyre_load_by_heave
mount_misfit, mount_slope = mount.mount_misfit, mount.mount_slope

_TIGHT = 1e-11  # m/s, of the speed in a damper on a mount


@njit(cache=True, error_model="numpy", inline="always")
def _curve(p, knots, r, width):
    force, slope = p[C] * r, p[C]
    for j in range(len(knots)):
        force += p[KNEES + j] * knee(r, knots[j], width)
        slope += p[KNEES + j] * knee_slope(r, knots[j], width)
    return force, slope


@njit(cache=True, error_model="numpy", fastmath=_LOOSE)
def _damper_speed(p, knots, level, e, w, r):
    for _ in range(25):
        force, slope = _curve(p, knots, r, level[0])
        ratio = p[RATIO]
        left = mount_misfit(r, ratio * force, e, w, p[MOUNT], level[3])
        step = left / mount_slope(ratio * slope, p[MOUNT], level[3])
        r -= step
        if abs(step) < _TIGHT:
            break
    return r


@njit(cache=True, error_model="numpy", fastmath=_LOOSE)
def rates(x, p, knots, inverse, pull, level, mounted, r, out):
    """Write the rates of change of a state, (22,), and the dampers' speeds, (4,)."""
    f0, f1, f2 = pull[0], pull[1], pull[2]
    for i in range(4):
        one = p[i]
        u = x[3 + i] - x[0] + one[X] * x[1] - one[Y] * x[2]
        w = x[10 + i] - x[7] + one[X] * x[8] - one[Y] * x[9]
        k = i ^ 1
        across = x[3 + k] - x[0] + p[k, X] * x[1] - p[k, Y] * x[2]
        if mounted:
            r[i] = _damper_speed(one, knots, level, x[18 + i], w, r[i])
        else:
            r[i] = w
        force = one[RATIO] * _curve(one, knots, r[i], level[0])[0]
        force += spring_force(u, one[K_S], one[K_2], one[K_3])
        force += stop_force(u, one[K_B], one[GAP], level[4])
        force += bar_force(u, across, one[K_A]) + one[F_C] * x[14 + i]
        f0 += force
        f1 -= one[X] * force
        f2 += one[Y] * force
        load = tyre_load(x[3 + i], x[10 + i], one[K_T], one[BETA], one[C_T], one[STATIC])
        road = tyre_force(load, one[STATIC])
        out[10 + i] = (road - force + one[PULL]) / one[MASS]
        out[14 + i] = friction_rate(w, x[14 + i], one[LENGTH], level[1], level[2])
        out[18 + i] = w - r[i] if mounted else 0.0
    for k in range(3):
        out[7 + k] = inverse[k, 0] * f0 + inverse[k, 1] * f1 + inverse[k, 2] * f2
    for k in range(7):
        out[k] = x[7 + k]


@njit(cache=True, error_model="numpy", fastmath=_LOOSE)
def path(x0, r0, steps, step_s, p, knots, inverse, pull, level, mounted, states, slopes, speeds):
    """Integrate by RK4; return the number of nodes that are finite."""
    x, r = x0.copy(), r0.copy()
    k1, k2, k3, k4 = np.empty(22), np.empty(22), np.empty(22), np.empty(22)
    y = np.empty(22)
    rates(x, p, knots, inverse, pull, level, mounted, r, k1)
    states[0], slopes[0], speeds[0] = x, k1, r
    for n in range(steps):
        for m in range(22):
            y[m] = x[m] + 0.5 * step_s * k1[m]
        rates(y, p, knots, inverse, pull, level, mounted, r, k2)
        for m in range(22):
            y[m] = x[m] + 0.5 * step_s * k2[m]
        rates(y, p, knots, inverse, pull, level, mounted, r, k3)
        for m in range(22):
            y[m] = x[m] + step_s * k3[m]
        rates(y, p, knots, inverse, pull, level, mounted, r, k4)
        size = 0.0
        for m in range(22):
            x[m] += step_s / 6.0 * (k1[m] + 2.0 * (k2[m] + k3[m]) + k4[m])
            size = max(size, abs(x[m]))
        if not size < 100.0:
            return n + 1
        rates(x, p, knots, inverse, pull, level, mounted, r, k1)
        states[n + 1], slopes[n + 1], speeds[n + 1] = x, k1, r
    return steps + 1


@njit(cache=True, error_model="numpy", fastmath=_LOOSE)
def sample(times, step_s, states, slopes, speeds, p, knots, inverse, pull, level, mounted,
           at, rate, speed):  # fmt: skip
    """Write state, rates and dampers' speeds at given times by cubic Hermite between the nodes."""
    last = len(states) - 2
    for n in range(len(times)):
        k = min(max(int(times[n] / step_s), 0), last)
        s = times[n] / step_s - k
        a = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
        b = s * s * (3.0 - 2.0 * s)
        c = s * (1.0 - s) * (1.0 - s) * step_s
        d = -s * s * (1.0 - s) * step_s
        for m in range(22):
            at[n, m] = (
                a * states[k, m] + b * states[k + 1, m] + c * slopes[k, m] + d * slopes[k + 1, m]
            )
        speed[n] = speeds[k]
        rates(at[n], p, knots, inverse, pull, level, mounted, speed[n], rate[n])


@njit(cache=True, error_model="numpy", fastmath=_LOOSE)
def _partials(one, knots, level, x, rate, r, u, across, i, by_force, by_speed, by_road):
    """Write the derivatives by each coefficient: of force, mount's equation and wheel's push."""
    width = level[0]
    curve = _curve(one, knots, r, width)[0]
    ratio, sigma, z = one[RATIO], one[MOUNT], x[3 + i]
    by_force[K_S], by_force[K_2], by_force[K_3] = u, u * u, u * u * u
    by_force[K_B] = hinge_(u - one[GAP], level[4])
    by_force[GAP] = -stop_stiffness(u, one[K_B], one[GAP], level[4])
    by_force[K_A] = u - across
    by_force[F_C] = x[14 + i]
    by_force[RATIO], by_force[C] = curve, ratio * r
    by_speed[MOUNT] = -ratio * curve
    by_speed[RATIO], by_speed[C] = -sigma * curve, -sigma * ratio * r
    for j in range(len(knots)):
        bent = ratio * knee(r, knots[j], width)
        by_force[KNEES + j] = bent
        by_speed[KNEES + j] = -sigma * bent
    contact = tyre_contact(tyre_load(z, x[10 + i], one[K_T], one[BETA], one[C_T], one[STATIC]))
    by_road[K_T] = -contact * z * (1.0 - one[BETA] * z)
    by_road[BETA] = contact * one[K_T] * z * z
    by_road[C_T] = -contact * x[10 + i]
    by_road[STATIC] = contact - 1.0
    by_road[MASS], by_road[PULL] = -rate[10 + i], 1.0


@njit(cache=True, error_model="numpy", fastmath=_LOOSE, inline="always")
def _relative(wheel, heave, pitch, roll, x, y, out):
    for j in range(len(out)):
        out[j] = wheel[j] - heave[j] + x * pitch[j] - y * roll[j]


@njit(cache=True, error_model="numpy", fastmath=_LOOSE, inline="always")
def _add(total, share, part):
    for j in range(len(total)):
        total[j] += share * part[j]


@njit(cache=True, error_model="numpy", fastmath=_LOOSE, inline="always")
def _ahead(S, step, rate, out):
    a, b, c = S.reshape(-1), rate.reshape(-1), out.reshape(-1)
    for j in range(len(a)):
        c[j] = a[j] + step * b[j]


@njit(cache=True, error_model="numpy", fastmath=_LOOSE)
def tangent_rates(x, rate, r, S, p, knots, inverse, level, mounted, sparse, body, work, out):
    """Write the rates of change of the tangents, (22, columns), at one state."""
    first, kinds, columns, values = sparse
    body_columns, d_mass, d_pull = body
    du, dw, dF, left, g, by_force, by_speed, by_road = work
    n_columns = S.shape[1]
    # One array is written in each loop over the columns, so that the compiler can vectorise it.
    for i in range(4):
        X_i, Y_i = p[i, X], p[i, Y]
        _relative(S[3 + i], S[0], S[1], S[2], X_i, Y_i, du[i])
        _relative(S[10 + i], S[7], S[8], S[9], X_i, Y_i, dw[i])
        for n in range(first[i], first[i + 1]):
            if kinds[n] == X:
                du[i, columns[n]] += x[1] * values[n]
                dw[i, columns[n]] += x[8] * values[n]
            elif kinds[n] == Y:
                du[i, columns[n]] -= x[2] * values[n]
                dw[i, columns[n]] -= x[9] * values[n]
    for k in range(3):
        for j in range(n_columns):
            g[k, j] = 0.0
    for i in range(4):
        one, k = p[i], i ^ 1
        X_i, Y_i = one[X], one[Y]
        u = x[3 + i] - x[0] + X_i * x[1] - Y_i * x[2]
        w = x[10 + i] - x[7] + X_i * x[8] - Y_i * x[9]
        across = x[3 + k] - x[0] + p[k, X] * x[1] - p[k, Y] * x[2]
        curve, slope = _curve(one, knots, r[i], level[0])
        ratio, bar, grip = one[RATIO], one[K_A], one[F_C]
        damping = ratio * slope
        stiff = spring_stiffness(u, one[K_S], one[K_2], one[K_3]) + bar
        stiff += stop_stiffness(u, one[K_B], one[GAP], level[4])
        force = (
            ratio * curve
            + spring_force(u, one[K_S], one[K_2], one[K_3])
            + stop_force(u, one[K_B], one[GAP], level[4])
            + bar_force(u, across, bar)
            + grip * x[14 + i]
        )
        _partials(one, knots, level, x, rate, r[i], u, across, i, by_force, by_speed, by_road)
        load = tyre_load(x[3 + i], x[10 + i], one[K_T], one[BETA], one[C_T], one[STATIC])
        contact = tyre_contact(load)
        road_z = contact * tyre_load_by_heave(x[3 + i], one[K_T], one[BETA])
        road_v = -contact * one[C_T]
        by_w = friction_rate_by_speed(w, x[14 + i], one[LENGTH], level[1], level[2])
        by_z = friction_rate_by_share(w, one[LENGTH], level[1], level[2])
        by_d = friction_rate_by_length(w, x[14 + i], one[LENGTH], level[1], level[2])
        row, own, across_row, fast = dF[i], du[i], du[k], dw[i]
        share, share_out, mount_out = S[14 + i], out[14 + i], out[18 + i]
        for j in range(n_columns):
            row[j] = stiff * own[j] - bar * across_row[j] + grip * share[j]
        for j in range(n_columns):
            share_out[j] = by_w * fast[j] + by_z * share[j]
        if mounted:
            turn = 1.0 / mount_slope(damping, one[MOUNT], level[3])
            deflection = S[18 + i]
            for j in range(n_columns):
                left[j] = (deflection[j] + level[3] * fast[j]) * turn
            for n in range(first[i], first[i + 1]):
                left[columns[n]] += by_speed[kinds[n]] * values[n] * turn
            for j in range(n_columns):
                row[j] += damping * left[j]
            for j in range(n_columns):
                mount_out[j] = fast[j] - left[j]
        else:
            for j in range(n_columns):
                row[j] += damping * fast[j]
            mount_out[:] = 0.0
        for n in range(first[i], first[i + 1]):
            kind, j, value = kinds[n], columns[n], values[n]
            row[j] += by_force[kind] * value
            if kind == LENGTH:
                out[14 + i, j] += by_d * value
            elif kind == X:
                g[1, j] -= force * value
            elif kind == Y:
                g[2, j] += force * value
        over = 1.0 / one[MASS]
        heave, speed, wheel = S[3 + i], S[10 + i], out[10 + i]
        for j in range(n_columns):
            wheel[j] = (road_z * heave[j] + road_v * speed[j] - row[j]) * over
        _add(g[0], 1.0, row)
        _add(g[1], -X_i, row)
        _add(g[2], Y_i, row)
        for n in range(first[i], first[i + 1]):
            out[10 + i, columns[n]] += by_road[kinds[n]] * values[n] * over
    for n in range(len(body_columns)):
        j = body_columns[n]
        for k in range(3):
            g[k, j] += d_pull[n, k]
            for m in range(3):
                g[k, j] -= d_mass[n, k, m] * rate[7 + m]
    g0, g1, g2 = g[0], g[1], g[2]
    for k in range(3):
        body_out, h0, h1, h2 = out[7 + k], inverse[k, 0], inverse[k, 1], inverse[k, 2]
        for j in range(n_columns):
            body_out[j] = h0 * g0[j] + h1 * g1[j] + h2 * g2[j]
    for k in range(7):
        out[k] = S[7 + k]


@njit(cache=True, error_model="numpy", fastmath=_LOOSE)
def tangents(S0, step_s, states, slopes, speeds, p, knots, inverse, mounted, sparse, body,
             starts, lengths, fine, levels, times, forced, at, rate, speed, out):  # fmt: skip
    """Integrate the tangents along a path; write heave, speed and acceleration at the samples."""
    size = S0.shape[1]
    n_coefficients = p.shape[1]
    work = (
        np.empty((4, size)), np.empty((4, size)), np.empty((4, size)), np.empty(size),
        np.empty((3, size)), np.zeros(n_coefficients), np.zeros(n_coefficients),
        np.zeros(n_coefficients),
    )  # fmt: skip
    S = S0.copy()
    k1, k2, k3, k4 = (np.empty_like(S0), np.empty_like(S0), np.empty_like(S0), np.empty_like(S0))
    y, after, mid, mid_rate = (
        np.empty_like(S0), np.empty_like(S0), np.empty_like(S0), np.empty_like(S0)
    )  # fmt: skip
    n, known = 0, -1
    for m in range(len(starts)):
        level = levels[fine[m]]
        a, half, b = starts[m], starts[m] + lengths[m] // 2, starts[m] + lengths[m]
        h = lengths[m] * step_s
        if known == fine[m]:
            k1[:] = after
        else:
            tangent_rates(states[a], slopes[a], speeds[a], S, p, knots, inverse, level, mounted,
                          sparse, body, work, k1)  # fmt: skip
        _ahead(S, 0.5 * h, k1, y)
        tangent_rates(states[half], slopes[half], speeds[half], y, p, knots, inverse, level,
                      mounted, sparse, body, work, k2)  # fmt: skip
        _ahead(S, 0.5 * h, k2, y)
        tangent_rates(states[half], slopes[half], speeds[half], y, p, knots, inverse, level,
                      mounted, sparse, body, work, k3)  # fmt: skip
        _ahead(S, h, k3, y)
        tangent_rates(states[b], slopes[b], speeds[b], y, p, knots, inverse, level, mounted,
                      sparse, body, work, k4)  # fmt: skip
        _ahead(S, h / 6.0, k1, y)
        _ahead(y, h / 3.0, k2, y)
        _ahead(y, h / 3.0, k3, y)
        _ahead(y, h / 6.0, k4, y)
        known = -1
        end = b * step_s - 1e-9
        while n < len(times) and (times[n] < end or m == len(starts) - 1):
            s = (times[n] - a * step_s) / h
            if abs(s) < 1e-6:
                out[n, :14] = S[:14]
                out[n, 14:] = k1[7:14]
                n += 1
                continue
            if known < 0:
                tangent_rates(states[b], slopes[b], speeds[b], y, p, knots, inverse, level,
                              mounted, sparse, body, work, after)  # fmt: skip
                known = fine[m]
            c0 = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
            c1 = s * s * (3.0 - 2.0 * s)
            c2 = s * (1.0 - s) * (1.0 - s) * h
            c3 = -s * s * (1.0 - s) * h
            for i in range(22):
                for j in range(size):
                    mid[i, j] = c0 * S[i, j] + c1 * y[i, j] + c2 * k1[i, j] + c3 * after[i, j]
            out[n, :14] = mid[:14]
            if forced[n]:
                tangent_rates(at[n], rate[n], speed[n], mid, p, knots, inverse, level, mounted,
                              sparse, body, work, mid_rate)  # fmt: skip
                out[n, 14:] = mid_rate[7:14]
            else:
                out[n, 14:] = 0.0
            n += 1
        S[:] = y
