"""The path of a run, its tangents and a sensor's low-pass on them, as machine code (Numba)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable

from . import car, laws

# Makes machine code of the kernels (Numba), and keeps it for the processes to come ----------------
#
# Numba uses the code that it has stored for a function while the file of that function stays as it
# is.  But the code of a kernel also contains formulas, constants and kernels of other files.  So
# the name by which a kernel is stored has the hash of them all.

LOOSE = {"reassoc", "contract", "arcp", "nsz"}
"""Rearrangements that the compiler may make; NaN must stay NaN."""
SOURCES = tuple(Path(__file__).with_name(f"{name}.py") for name in ("car", "laws", "kernels"))
"""All files of which the machine code of a kernel may contain something."""
_HASH = sha256(b"".join(source.read_bytes() for source in SOURCES)).hexdigest()[:16]


def kernel(function: Callable[..., Any]) -> Any:
    """Return a function as machine code; it is made at the first call, or read where it is stored.

    Where no folder can be written, it is not stored.
    """
    function.__qualname__ += f"_{_HASH}"
    compiled = njit(error_model="numpy", fastmath=LOOSE, nogil=True)(function)
    with suppress(RuntimeError):  # neither beside the sources nor in the user's cache
        compiled.enable_caching()
    return compiled


# The kernels --------------------------------------------------------------------------------------
#
# x: state of the path, (22,), as `path.STATES` says.  p: coefficients, (4, n), in the columns of
# `car`; p_i: those of corner i, k: the other side of its axle (i ^ 1).  knots, lines: knees of the
# damper curves and their hinges (`bends`).  level: rounding, a `path.Level`.  u, w: travel and its
# speed; r: speed in the damper.  Columns of tangents are in blocks of `LANES`; j is a column of a
# block, m a row.

for _law in vars(laws).values():
    if isinstance(_law, FunctionType):
        register_jitable(error_model="numpy", fastmath=LOOSE)(_law)


@kernel
def bends(p, knots, width):
    """Return each corner's curve as a line through rest and hinges that all open upwards.

    A knee towards rebound is a line less the hinge of the same corner: ``H(-x) = H(x) - x``.
    """
    lines = np.empty((4, 2 + len(knots)))
    for i in range(4):
        lines[i, 0], lines[i, 1] = 0.0, p[i, car.C]
        for j in range(len(knots)):
            h = p[i, car.KNEES + j]
            if knots[j] < 0.0:
                lines[i, 0] += h * (laws.hinge(knots[j], width) - knots[j])
                lines[i, 1] += h
                lines[i, 2 + j] = -h
            else:
                lines[i, 0] -= h * laws.hinge(-knots[j], width)
                lines[i, 2 + j] = h
    return lines


@kernel
def curve(line, knots, r, width):
    """Return the force of an axle's damper at the speed r; the knots ascend."""
    force = line[0] + line[1] * r
    for j in range(len(knots)):
        beyond = r - knots[j]
        if beyond <= -width:
            break
        if beyond >= width:
            force += line[2 + j] * beyond
        else:
            force += line[2 + j] * laws.hinge(beyond, width)
    return force


@kernel
def _damper_speed(p, line, knots, level, e, w, r):
    """Return the speed in a damper whose mount has the deflection e, by Newton's method from r."""
    for _ in range(25):
        force = p[car.RATIO] * curve(line, knots, r, level.knee_m_s)
        damping = p[car.C]
        for j in range(len(knots)):
            damping += p[car.KNEES + j] * laws.knee_slope(r, knots[j], level.knee_m_s)
        misfit = laws.mount_misfit(r, force, e, w, p[car.MOUNT], level.loss_s)
        step = misfit / laws.mount_slope(p[car.RATIO] * damping, p[car.MOUNT], level.loss_s)
        r -= step
        if abs(step) < 1e-11:  # m/s
            break
    return r


@kernel
def rates(x, p, lines, knots, inverse, pull, level, mounted, r, out):
    """Write the rates of change of a state, (22,), and the dampers' speeds, (4,)."""
    f0, f1, f2 = pull[0], pull[1], pull[2]
    for i in range(4):
        p_i = p[i]
        u = x[3 + i] - x[0] + p_i[car.X] * x[1] - p_i[car.Y] * x[2]
        w = x[10 + i] - x[7] + p_i[car.X] * x[8] - p_i[car.Y] * x[9]
        if mounted:
            r[i] = _damper_speed(p_i, lines[i], knots, level, x[18 + i], w, r[i])
        else:
            r[i] = w
        force = p_i[car.RATIO] * curve(lines[i], knots, r[i], level.knee_m_s)
        force += (
            laws.spring_force(u, p_i[car.K_S], p_i[car.K_2], p_i[car.K_3])
            + p_i[car.F_C] * x[14 + i]
        )
        if u > p_i[car.GAP] - level.stop_m:
            force += laws.stop_force(u, p_i[car.K_B], p_i[car.GAP], p_i[car.POWER], level.stop_m)
        if p_i[car.K_A] != 0.0:
            k = i ^ 1
            across = x[3 + k] - x[0] + p[k, car.X] * x[1] - p[k, car.Y] * x[2]
            force += p_i[car.K_A] * (u - across)
        f0 += force
        f1 -= p_i[car.X] * force
        f2 += p_i[car.Y] * force
        load = laws.tyre_load(x[3 + i], p_i[car.K_T], p_i[car.BETA], p_i[car.STATIC])
        push = laws.tyre_push(load, x[10 + i], p_i[car.C_T], level.load_n)
        road = laws.tyre_force(push, p_i[car.STATIC], level.load_n)
        out[10 + i] = (road - force + p_i[car.PULL]) / p_i[car.MASS]
        limit = 1.0
        if p_i[car.SURPLUS] != 0.0:
            limit = laws.sliding_share(w, p_i[car.SURPLUS], p_i[car.FALL])
        out[14 + i] = laws.friction_rate(
            w, x[14 + i], p_i[car.LENGTH], limit, level.turn_m_s, level.lag_s
        )
        out[18 + i] = w - r[i] if mounted else 0.0
    for k in range(3):
        out[7 + k] = inverse[k, 0] * f0 + inverse[k, 1] * f1 + inverse[k, 2] * f2
    for k in range(7):
        out[k] = x[7 + k]


@kernel
def path(x0, r0, steps, step_s, p, knots, inverse, pull, level, mounted, states, slopes, speeds):
    """Integrate a run by RK4, write its nodes, and return how many of them are finite."""
    x, r, lines = x0.copy(), r0.copy(), bends(p, knots, level.knee_m_s)
    k1, k2, k3, k4 = np.empty(22), np.empty(22), np.empty(22), np.empty(22)
    y = np.empty(22)
    rates(x, p, lines, knots, inverse, pull, level, mounted, r, k1)
    states[0], slopes[0], speeds[0] = x, k1, r
    for n in range(steps):
        for m in range(22):
            y[m] = x[m] + 0.5 * step_s * k1[m]
        rates(y, p, lines, knots, inverse, pull, level, mounted, r, k2)
        for m in range(22):
            y[m] = x[m] + 0.5 * step_s * k2[m]
        rates(y, p, lines, knots, inverse, pull, level, mounted, r, k3)
        for m in range(22):
            y[m] = x[m] + step_s * k3[m]
        rates(y, p, lines, knots, inverse, pull, level, mounted, r, k4)
        finite = True
        for m in range(22):
            x[m] += step_s / 6.0 * (k1[m] + 2.0 * (k2[m] + k3[m]) + k4[m])
            finite = finite and abs(x[m]) < 100.0  # of SI units; NaN is none
        if not finite:
            return n + 1
        rates(x, p, lines, knots, inverse, pull, level, mounted, r, k1)
        states[n + 1], slopes[n + 1], speeds[n + 1] = x, k1, r
    return steps + 1


@kernel
def sample(times, step_s, states, slopes, speeds, p, knots, inverse, pull, level, mounted,
           at, rate, speed):  # fmt: skip
    """Write state, rates and dampers' speeds at given times: cubic Hermite between the nodes."""
    last = len(states) - 2
    lines = bends(p, knots, level.knee_m_s)
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
        rates(at[n], p, lines, knots, inverse, pull, level, mounted, speed[n], rate[n])


# The tangents: derivatives of the state by unknowns, a column each, along the path ----------------
#
# The Jacobian acts through the slopes of the four corners and no matrix is dense: a column costs
# some 150 operations a stage.  Columns are stored in blocks of `LANES`, one row of the state after
# the other: a loop over the columns of a block becomes vector instructions because the distances
# between rows are constants.

LANES = 40
"""Columns in a block: an odd number of cache lines, so that rows do not evict each other."""
STATE_ROWS, TANGENT_ROWS, FORCING_ROWS = 22, 29, 19
"""Rows of a block: of a state; with the 7 accelerations; of the forcing by the unknowns, which is
forces at 4 corners, force and moments on the body, accelerations of 4 wheels by their tyres, 4
rates of friction and 4 of the mounts."""
_ON_BODY, _ON_WHEELS, _ON_FRICTION, _ON_MOUNTS = 4, 7, 11, 15

(
    AT_X, AT_Y, STIFF, BAR, SLIDING, SPEED_BY_TRAVEL, SPEED_BY_MOUNT, DAMPING, TYRE, TYRE_DAMPING,
    PER_MASS, FRICTION_BY_SPEED, FRICTION_BY_SHARE,
) = range(13)  # fmt: skip
CORNER_SLOPES = 13
"""Slopes at a corner: its place; forces by travel of both sides, friction and speed in the damper;
that speed by those of suspension and mount; the wheel's acceleration by its heave, its speed and
(negative) the corner's force; the rate of friction by the suspension's speed and its share."""


@kernel
def column_rates(x, slopes, inverse, forcing, rates):
    """Write the rates of change of a block of columns at a node of the path."""
    for j in range(LANES):
        lift = forcing[_ON_BODY * LANES + j]
        pitch = forcing[(_ON_BODY + 1) * LANES + j]
        roll = forcing[(_ON_BODY + 2) * LANES + j]
        for i in range(4):
            s, k = CORNER_SLOPES * i, CORNER_SLOPES * (i ^ 1)
            heave, rise, share = (3 + i) * LANES + j, (10 + i) * LANES + j, (14 + i) * LANES + j
            mount, other = (18 + i) * LANES + j, (3 + (i ^ 1)) * LANES + j
            u = slopes[s + AT_X] * x[LANES + j] - slopes[s + AT_Y] * x[2 * LANES + j]
            u += x[heave] - x[j]
            across = slopes[k + AT_X] * x[LANES + j] - slopes[k + AT_Y] * x[2 * LANES + j]
            across += x[other] - x[j]
            w = slopes[s + AT_X] * x[8 * LANES + j] - slopes[s + AT_Y] * x[9 * LANES + j]
            w += x[rise] - x[7 * LANES + j]
            r = slopes[s + SPEED_BY_TRAVEL] * w + slopes[s + SPEED_BY_MOUNT] * x[mount]
            force = slopes[s + STIFF] * u - slopes[s + BAR] * across + slopes[s + DAMPING] * r
            force += slopes[s + SLIDING] * x[share] + forcing[i * LANES + j]
            lift += force
            pitch -= slopes[s + AT_X] * force
            roll += slopes[s + AT_Y] * force
            tyre = slopes[s + TYRE] * x[heave] + slopes[s + TYRE_DAMPING] * x[rise]
            rates[rise] = (
                tyre - slopes[s + PER_MASS] * force + forcing[(_ON_WHEELS + i) * LANES + j]
            )
            slide = slopes[s + FRICTION_BY_SPEED] * w + slopes[s + FRICTION_BY_SHARE] * x[share]
            rates[share] = slide + forcing[(_ON_FRICTION + i) * LANES + j]
            rates[mount] = w - r + forcing[(_ON_MOUNTS + i) * LANES + j]
        for k in range(3):
            rates[(7 + k) * LANES + j] = (
                inverse[k, 0] * lift + inverse[k, 1] * pitch + inverse[k, 2] * roll
            )
    for m in range(7 * LANES):
        rates[m] = x[7 * LANES + m]


@kernel
def rk4(x, slopes, inverse, begin, half, end, h, work, after):
    """Write a block of columns one step later, and to `x` its accelerations before the step.

    `begin`, `half` and `end` are the forcing at the three nodes, as are the slopes.
    """
    y, k1, k2, k3, k4 = work[0], work[1], work[2], work[3], work[4]
    size = STATE_ROWS * LANES
    column_rates(x, slopes[0], inverse, begin, k1)
    for m in range(7 * LANES):
        x[size + m] = k1[7 * LANES + m]
    for m in range(size):
        y[m] = x[m] + 0.5 * h * k1[m]
    column_rates(y, slopes[1], inverse, half, k2)
    for m in range(size):
        y[m] = x[m] + 0.5 * h * k2[m]
    column_rates(y, slopes[1], inverse, half, k3)
    for m in range(size):
        y[m] = x[m] + h * k3[m]
    column_rates(y, slopes[2], inverse, end, k4)
    for m in range(size):
        after[m] = x[m] + h / 6.0 * (k1[m] + 2.0 * (k2[m] + k3[m]) + k4[m])


@kernel
def linearise(x, rate, r, p, knots, level, mounted, of_corners, of_body, slopes, forcing):
    """Write the slopes that act on a column at a node, (52,), and the forcing by the unknowns.

    `of_corners`: first entry of each corner, (5,); coefficient, block, column in it and derivative
    of each entry.  `of_body`: block and column of the unknowns that change the body, its mass by
    them, (n, 3, 3), and gravity, (n, 3).
    """
    first_entry, coefficients, blocks, columns, values = of_corners
    width = level.knee_m_s
    by, by_speed = np.zeros(p.shape[1]), np.zeros(p.shape[1])
    forcing[:] = 0.0
    for i in range(4):
        p_i, k = p[i], i ^ 1
        u = x[3 + i] - x[0] + p_i[car.X] * x[1] - p_i[car.Y] * x[2]
        w = x[10 + i] - x[7] + p_i[car.X] * x[8] - p_i[car.Y] * x[9]
        across = x[3 + k] - x[0] + p[k, car.X] * x[1] - p[k, car.Y] * x[2]
        # Each coefficient acts on the force, on the road's force or on the rate of friction.
        z, zeta, ratio, per_mass = x[3 + i], x[14 + i], p_i[car.RATIO], 1.0 / p_i[car.MASS]
        curved, damping = p_i[car.C] * r[i], p_i[car.C]
        for j in range(len(knots)):
            bent = laws.knee(r[i], knots[j], width)
            curved += p_i[car.KNEES + j] * bent
            damping += p_i[car.KNEES + j] * laws.knee_slope(r[i], knots[j], width)
            by[car.KNEES + j] = ratio * bent
        damping *= ratio
        by[car.K_S], by[car.K_2], by[car.K_3], by[car.K_A] = u, u * u, u * u * u, u - across
        by[car.C], by[car.RATIO], by[car.F_C] = ratio * r[i], curved, zeta
        stiff = laws.spring_stiffness(u, p_i[car.K_S], p_i[car.K_2], p_i[car.K_3]) + p_i[car.K_A]
        by[car.K_B], by[car.GAP], by[car.POWER] = 0.0, 0.0, 0.0
        if u > p_i[car.GAP] - level.stop_m:
            hard, by[car.K_B], by[car.POWER] = laws.stop_slopes(
                u, p_i[car.K_B], p_i[car.GAP], p_i[car.POWER], level.stop_m
            )
            stiff += hard
            by[car.GAP] = -hard
        force = (
            ratio * curved
            + laws.spring_force(u, p_i[car.K_S], p_i[car.K_2], p_i[car.K_3])
            + p_i[car.K_B] * by[car.K_B]
            + p_i[car.K_A] * (u - across)
            + p_i[car.F_C] * zeta
        )
        limit = laws.sliding_share(w, p_i[car.SURPLUS], p_i[car.FALL])
        share_by_w, share_by_surplus, share_by_fall = laws.sliding_slopes(
            w, p_i[car.SURPLUS], p_i[car.FALL]
        )
        by_w, by_zeta, by[car.LENGTH], by_limit = laws.friction_slopes(
            w, zeta, p_i[car.LENGTH], limit, level.turn_m_s, level.lag_s
        )
        by_w += by_limit * share_by_w
        by[car.SURPLUS], by[car.FALL] = by_limit * share_by_surplus, by_limit * share_by_fall
        load = laws.tyre_load(z, p_i[car.K_T], p_i[car.BETA], p_i[car.STATIC])
        by_load, contact = laws.tyre_slopes(load, x[10 + i], p_i[car.C_T], level.load_n)
        by[car.K_T] = -by_load * z * (1.0 - p_i[car.BETA] * z)
        by[car.BETA] = by_load * p_i[car.K_T] * z * z
        by[car.C_T] = -contact * x[10 + i]
        by[car.STATIC], by[car.MASS], by[car.PULL] = by_load - 1.0, -rate[10 + i], 1.0
        by_mount, through = 0.0, 1.0
        if mounted:
            sigma = p_i[car.MOUNT]
            by_mount = 1.0 / laws.mount_slope(damping, sigma, level.loss_s)
            through = level.loss_s * by_mount
            for j in range(len(knots)):
                by_speed[car.KNEES + j] = -sigma * by[car.KNEES + j]
            by_speed[car.C], by_speed[car.RATIO] = -sigma * by[car.C], -sigma * curved
            by_speed[car.MOUNT] = -ratio * curved
        s = slopes[CORNER_SLOPES * i : CORNER_SLOPES * (i + 1)]
        s[AT_X], s[AT_Y], s[STIFF], s[BAR] = p_i[car.X], p_i[car.Y], stiff, p_i[car.K_A]
        s[SLIDING], s[SPEED_BY_TRAVEL], s[SPEED_BY_MOUNT] = p_i[car.F_C], through, by_mount
        s[DAMPING], s[PER_MASS] = damping, per_mass
        s[TYRE_DAMPING] = -contact * p_i[car.C_T] * per_mass
        s[TYRE] = -by_load * p_i[car.K_T] * (1.0 - 2.0 * p_i[car.BETA] * z) * per_mass
        s[FRICTION_BY_SPEED], s[FRICTION_BY_SHARE] = by_w, by_zeta
        for n in range(first_entry[i], first_entry[i + 1]):
            kind, value, b, j = coefficients[n], values[n], blocks[n], columns[n]
            if kind == car.X or kind == car.Y:
                du = x[1] * value if kind == car.X else -x[2] * value
                dw = x[8] * value if kind == car.X else -x[9] * value
                forcing[b, i * LANES + j] += stiff * du + damping * through * dw
                forcing[b, k * LANES + j] -= p[k, car.K_A] * du
                forcing[b, (_ON_FRICTION + i) * LANES + j] += by_w * dw
                forcing[b, (_ON_MOUNTS + i) * LANES + j] += (1.0 - through) * dw
                if kind == car.X:
                    forcing[b, (_ON_BODY + 1) * LANES + j] -= force * value
                else:
                    forcing[b, (_ON_BODY + 2) * LANES + j] += force * value
            elif kind in car.OF_FRICTION:
                forcing[b, (_ON_FRICTION + i) * LANES + j] += by[kind] * value
            elif kind in car.OF_WHEEL:
                forcing[b, (_ON_WHEELS + i) * LANES + j] += by[kind] * value * per_mass
            else:
                speed = by_speed[kind] * by_mount * value
                forcing[b, i * LANES + j] += by[kind] * value + damping * speed
                forcing[b, (_ON_MOUNTS + i) * LANES + j] -= speed
    blocks, columns, d_mass, d_pull = of_body
    for n in range(len(columns)):
        for k in range(3):
            pull = d_pull[n, k]
            for m in range(3):
                pull -= d_mass[n, k, m] * rate[7 + m]
            forcing[blocks[n], (_ON_BODY + k) * LANES + columns[n]] += pull


@kernel
def tangents(step_s, states, rates, speeds, p, knots, inverse, mounted, of_corners, of_body,
             starts, lengths, fine, levels, first_columns, samples, channels, out):  # fmt: skip
    """Integrate the tangents along a path and write what channels see of them.

    `first_columns`: at the start, (blocks, rows).  `samples`, in the order of the steps: step,
    weights (3, 4), first row of `out`, first and last channel of each.  `channels`: time
    derivative, first entry, motions and their shares.  `out`: (rows, columns).
    """
    steps, weights, begin, first_channel, last_channel = samples
    blocks = len(first_columns)
    nodes = np.zeros((3, blocks, TANGENT_ROWS * LANES))
    nodes[0] = first_columns
    work = np.empty((5, STATE_ROWS * LANES))
    slopes = np.zeros((3, 4 * CORNER_SLOPES))
    forcing = np.empty((3, blocks, FORCING_ROWS * LANES))
    known_level, seen = -1, 0
    for m in range(len(starts) + 1):
        before, here, after = nodes[(m + 2) % 3], nodes[m % 3], nodes[(m + 1) % 3]
        if m < len(starts):
            fine_level, length = fine[m], lengths[m]
            for part in range(3):
                if part == 0 and known_level == fine_level:
                    slopes[0], forcing[0] = slopes[2], forcing[2]
                    continue
                node = starts[m] + part * length // 2
                linearise(states[node], rates[node], speeds[node], p, knots, levels[fine_level],
                          mounted, of_corners, of_body, slopes[part], forcing[part])  # fmt: skip
            known_level = fine_level
            for n in range(blocks):
                rk4(here[n], slopes, inverse, forcing[0, n], forcing[1, n], forcing[2, n],
                    length * step_s, work, after[n])  # fmt: skip
        else:
            for n in range(blocks):
                column_rates(here[n], slopes[2], inverse, forcing[2, n], work[1])
                here[n, STATE_ROWS * LANES :] = work[1, 7 * LANES : 14 * LANES]
        while seen < len(steps) and steps[seen] < m:
            see(before, here, weights[seen], channels, first_channel[seen], last_channel[seen],
                out[begin[seen] :])  # fmt: skip
            seen += 1


@kernel
def see(before, after, weights, channels, first_channel, last_channel, out):
    """Write what some channels see of the columns between two nodes, a row of `out` each."""
    orders, first_entry, motions, shares = channels
    count = out.shape[1]
    for c in range(first_channel, last_channel):
        w0, w1, w2, w3 = weights[orders[c]]  # of the values v0, v1 and slopes s0, s1 at both nodes
        value, slope = (7, STATE_ROWS) if orders[c] else (0, 7)
        for m in range(first_entry[c], first_entry[c + 1]):
            share, at = shares[m], (value + motions[m]) * LANES
            then = (slope + motions[m]) * LANES
            for b in range(len(before)):
                lanes = min(LANES, count - b * LANES)
                row = out[c - first_channel, b * LANES : b * LANES + lanes]
                v0, v1 = before[b, at : at + lanes], after[b, at : at + lanes]
                s0, s1 = before[b, then : then + lanes], after[b, then : then + lanes]
                for j in range(lanes):
                    row[j] += share * (w0 * v0[j] + w1 * v1[j] + w2 * s0[j] + w3 * s1[j])


# A sensor's low-pass ------------------------------------------------------------------------------


@kernel
def filter_pole(values, h, times, pole, residue, weights, out):
    """Add the output of a filter's pole at given times, ascending, to `out` (`path.filtered`)."""
    size = values.shape[1]
    state, last_state = np.zeros(size, np.complex128), np.zeros(size, np.complex128)
    decay = np.exp(pole * h)
    n, last_step = 0, (len(values) - 1) // 2 - 1
    for k in range(last_step + 1):
        first, middle, end = values[2 * k], values[2 * k + 1], values[2 * k + 2]
        for j in range(size):
            last_state[j] = state[j]
            drive = weights[0] * first[j] + weights[1] * middle[j] + weights[2] * end[j]
            state[j] = decay * state[j] + drive
        while n < len(times) and (times[n] / h < k + 1 or k == last_step):
            t = times[n] / h - k
            c, d = t * (1.0 - t) ** 2 * h, -(t**2) * (1.0 - t) * h
            at_begin = residue * ((1.0 + 2.0 * t) * (1.0 - t) ** 2 + c * pole)
            at_end = residue * (t**2 * (3.0 - 2.0 * t) + d * pole)
            for j in range(size):
                out[n, j] += (at_begin * last_state[j] + at_end * state[j]).real
                out[n, j] += residue.real * (c * first[j] + d * end[j])
            n += 1
