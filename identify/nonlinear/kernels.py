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
# x: state of the path, (22,): 7 displacements (heave, pitch and roll of the body, heave of the
# wheels), their 7 speeds, and at each corner the share of friction that acts, then the deflection
# of the damper's mount.  p: coefficients, (4, n), in the columns of `car`; p_i: those of corner i;
# k: the other side of its axle (i ^ 1).  knots, lines: knees of the damper curves, (n_knots,), and
# their hinges (`bends`).  inverse: of the body's mass matrix, (3, 3); gravity: on the weights added
# to the body, (3,).  level: rounding, a `path.Level`; mounted: whether dampers have mounts.
# u, w: travel of a suspension and its speed; r: speed in its damper.

for _law in vars(laws).values():
    if isinstance(_law, FunctionType):
        register_jitable(error_model="numpy", fastmath=LOOSE)(_law)


@kernel
def bends(p, knots, width):
    """Return each corner's curve, (4, 2 + n_knots): force at rest, slope, change at each hinge.

    It is a line through rest and hinges that all open towards compression.  A knee towards rebound
    is a line less the hinge of the same corner: ``H(-x) = H(x) - x``.
    """
    lines = np.empty((4, 2 + len(knots)))
    for i in range(4):
        lines[i, 0], lines[i, 1] = 0.0, p[i, car.C]
        for j in range(len(knots)):
            slope_change = p[i, car.KNEES + j]
            if knots[j] < 0.0:
                lines[i, 0] += slope_change * (laws.hinge(knots[j], width) - knots[j])
                lines[i, 1] += slope_change
                lines[i, 2 + j] = -slope_change
            else:
                lines[i, 0] -= slope_change * laws.hinge(-knots[j], width)
                lines[i, 2 + j] = slope_change
    return lines


@kernel
def curve(line, knots, r, width):
    """Return the force at the speed r on a curve, (2 + n_knots,) of `bends`; the knots ascend."""
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
def rates(x, p, lines, knots, inverse, gravity, level, mounted, r, out):
    """Write the rates of change of a state, (22,), to `out`, and the dampers' speeds, (4,), to r.

    What r has before is where Newton's method begins.
    """
    lift, pitch, roll = gravity[0], gravity[1], gravity[2]  # force and moments on the body
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
        lift += force
        pitch -= p_i[car.X] * force
        roll += p_i[car.Y] * force
        load = laws.tyre_load(x[3 + i], p_i[car.K_T], p_i[car.BETA], p_i[car.STATIC])
        push = laws.tyre_push(load, x[10 + i], p_i[car.C_T], level.load_n)
        road = laws.tyre_force(push, p_i[car.STATIC], level.load_n)
        out[10 + i] = (road - force + p_i[car.GRAVITY]) / p_i[car.MASS]
        limit = 1.0
        if p_i[car.SURPLUS] != 0.0:
            limit = laws.sliding_share(w, p_i[car.SURPLUS], p_i[car.FALL])
        out[14 + i] = laws.friction_rate(
            w, x[14 + i], p_i[car.LENGTH], limit, level.turn_m_s, level.lag_s
        )
        out[18 + i] = w - r[i] if mounted else 0.0
    for k in range(3):
        out[7 + k] = inverse[k, 0] * lift + inverse[k, 1] * pitch + inverse[k, 2] * roll
    for k in range(7):
        out[k] = x[7 + k]


@kernel
def path(x0, r0, steps, step_s, p, knots, inverse, gravity, level, mounted, states, slopes, speeds):
    """Integrate a run by RK4 from x0, and return how many of its nodes are finite.

    Writes `states` and their `slopes`, (steps + 1, 22), and the dampers' `speeds`, (steps + 1, 4).
    """
    x, r, lines = x0.copy(), r0.copy(), bends(p, knots, level.knee_m_s)
    k1, k2, k3, k4 = np.empty(22), np.empty(22), np.empty(22), np.empty(22)
    y = np.empty(22)
    rates(x, p, lines, knots, inverse, gravity, level, mounted, r, k1)
    states[0], slopes[0], speeds[0] = x, k1, r
    for n in range(steps):
        for m in range(22):
            y[m] = x[m] + 0.5 * step_s * k1[m]
        rates(y, p, lines, knots, inverse, gravity, level, mounted, r, k2)
        for m in range(22):
            y[m] = x[m] + 0.5 * step_s * k2[m]
        rates(y, p, lines, knots, inverse, gravity, level, mounted, r, k3)
        for m in range(22):
            y[m] = x[m] + step_s * k3[m]
        rates(y, p, lines, knots, inverse, gravity, level, mounted, r, k4)
        finite = True
        for m in range(22):
            x[m] += step_s / 6.0 * (k1[m] + 2.0 * (k2[m] + k3[m]) + k4[m])
            finite = finite and abs(x[m]) < 100.0  # SI: no car moves so far or fast; NaN is false
        if not finite:
            return n + 1
        rates(x, p, lines, knots, inverse, gravity, level, mounted, r, k1)
        states[n + 1], slopes[n + 1], speeds[n + 1] = x, k1, r
    return steps + 1


@kernel
def sample(times, step_s, states, slopes, speeds, p, knots, inverse, gravity, level, mounted,
           sampled_states, sampled_slopes, sampled_speeds):  # fmt: skip
    """Write state, rates and dampers' speeds at n given times: cubic Hermite between the nodes."""
    last_step = len(states) - 2
    lines = bends(p, knots, level.knee_m_s)
    for n in range(len(times)):
        k = min(max(int(times[n] / step_s), 0), last_step)
        s = times[n] / step_s - k  # 0..1 within the step
        # Weights of the state before and after, and of its slope before and after.
        a = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
        b = s * s * (3.0 - 2.0 * s)
        c = s * (1.0 - s) * (1.0 - s) * step_s
        d = -s * s * (1.0 - s) * step_s
        for m in range(22):
            sampled_states[n, m] = (
                a * states[k, m] + b * states[k + 1, m] + c * slopes[k, m] + d * slopes[k + 1, m]
            )
        sampled_speeds[n] = speeds[k]
        rates(sampled_states[n], p, lines, knots, inverse, gravity, level, mounted,
              sampled_speeds[n], sampled_slopes[n])  # fmt: skip


# The tangents: derivatives of the state by unknowns, a column each, along the path ----------------
#
# The Jacobian acts through the slopes of the four corners and no matrix is dense: a column costs
# some 150 operations a stage.  Columns are stored in blocks of `LANES`, each flat, one row of the
# state after the other: row m of column j is at ``m * LANES + j``.  A loop over the columns of a
# block becomes vector instructions because the distances between rows are constants.

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
    """Write the rates of change of a block of columns, x, at a node of the path.

    The rows of `x` and `rates` are those of a state, those of `forcing` as in `FORCING_ROWS`.
    """
    for j in range(LANES):
        lift = forcing[_ON_BODY * LANES + j]
        pitch = forcing[(_ON_BODY + 1) * LANES + j]
        roll = forcing[(_ON_BODY + 2) * LANES + j]
        for i in range(4):
            s, k = CORNER_SLOPES * i, CORNER_SLOPES * (i ^ 1)  # of this corner, of the other side
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
    """Write a block of columns, `x`, a step h later to `after`, and x's accelerations to its end.

    `begin`, `half`, `end`: forcing at the three nodes of the step.  `slopes`, (3, 52): of the
    corners there.  `work`, (5, rows * LANES): room for the stages.
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

    `x`, `rate`, `r`: state, its rates and the dampers' speeds there.  `of_corners`: nonzero
    derivatives of the coefficients by the unknowns: first entry of each corner, (5,); coefficient,
    block, column in it and derivative of each entry.  `of_body`: block and column of the unknowns
    that change the body, its mass by them, (n, 3, 3), and gravity, (n, 3).
    """
    first_entry, coefficients, blocks, columns, values = of_corners
    width = level.knee_m_s
    # By each coefficient: what it acts on, and minus the misfit of the mount's equation.
    by, mount_by = np.zeros(p.shape[1]), np.zeros(p.shape[1])
    forcing[:] = 0.0
    for i in range(4):
        p_i, k = p[i], i ^ 1
        u = x[3 + i] - x[0] + p_i[car.X] * x[1] - p_i[car.Y] * x[2]
        w = x[10 + i] - x[7] + p_i[car.X] * x[8] - p_i[car.Y] * x[9]
        across = x[3 + k] - x[0] + p[k, car.X] * x[1] - p[k, car.Y] * x[2]
        # Each coefficient acts on the corner's force, the road's force or the rate of friction.
        z, zeta, ratio, per_mass = x[3 + i], x[14 + i], p_i[car.RATIO], 1.0 / p_i[car.MASS]
        curved, damping = p_i[car.C] * r[i], p_i[car.C]
        for j in range(len(knots)):
            beyond_knot = laws.knee(r[i], knots[j], width)
            curved += p_i[car.KNEES + j] * beyond_knot
            damping += p_i[car.KNEES + j] * laws.knee_slope(r[i], knots[j], width)
            by[car.KNEES + j] = ratio * beyond_knot
        damping *= ratio
        by[car.K_S], by[car.K_2], by[car.K_3], by[car.K_A] = u, u * u, u * u * u, u - across
        by[car.C], by[car.RATIO], by[car.F_C] = ratio * r[i], curved, zeta
        stiff = laws.spring_stiffness(u, p_i[car.K_S], p_i[car.K_2], p_i[car.K_3]) + p_i[car.K_A]
        by[car.K_B], by[car.GAP], by[car.POWER] = 0.0, 0.0, 0.0
        if u > p_i[car.GAP] - level.stop_m:
            stop_stiff, by[car.K_B], by[car.POWER] = laws.stop_slopes(
                u, p_i[car.K_B], p_i[car.GAP], p_i[car.POWER], level.stop_m
            )
            stiff += stop_stiff
            by[car.GAP] = -stop_stiff
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
        by[car.STATIC], by[car.MASS], by[car.GRAVITY] = by_load - 1.0, -rate[10 + i], 1.0
        # Speed in the damper by the deflection of its mount, and by the suspension's speed.
        speed_by_mount, speed_by_travel = 0.0, 1.0
        if mounted:
            sigma = p_i[car.MOUNT]
            speed_by_mount = 1.0 / laws.mount_slope(damping, sigma, level.loss_s)
            speed_by_travel = level.loss_s * speed_by_mount
            for j in range(len(knots)):
                mount_by[car.KNEES + j] = -sigma * by[car.KNEES + j]
            mount_by[car.C], mount_by[car.RATIO] = -sigma * by[car.C], -sigma * curved
            mount_by[car.MOUNT] = -ratio * curved
        s = slopes[CORNER_SLOPES * i : CORNER_SLOPES * (i + 1)]
        s[AT_X], s[AT_Y], s[STIFF], s[BAR] = p_i[car.X], p_i[car.Y], stiff, p_i[car.K_A]
        s[SLIDING] = p_i[car.F_C]
        s[SPEED_BY_TRAVEL], s[SPEED_BY_MOUNT] = speed_by_travel, speed_by_mount
        s[DAMPING], s[PER_MASS] = damping, per_mass
        s[TYRE_DAMPING] = -contact * p_i[car.C_T] * per_mass
        s[TYRE] = -by_load * p_i[car.K_T] * (1.0 - 2.0 * p_i[car.BETA] * z) * per_mass
        s[FRICTION_BY_SPEED], s[FRICTION_BY_SHARE] = by_w, by_zeta
        for n in range(first_entry[i], first_entry[i + 1]):
            # Of entry n: its coefficient, derivative by an unknown, and where this one's column is.
            kind, value, b, j = coefficients[n], values[n], blocks[n], columns[n]
            if kind == car.X or kind == car.Y:
                du = x[1] * value if kind == car.X else -x[2] * value
                dw = x[8] * value if kind == car.X else -x[9] * value
                forcing[b, i * LANES + j] += stiff * du + damping * speed_by_travel * dw
                forcing[b, k * LANES + j] -= p[k, car.K_A] * du
                forcing[b, (_ON_FRICTION + i) * LANES + j] += by_w * dw
                forcing[b, (_ON_MOUNTS + i) * LANES + j] += (1.0 - speed_by_travel) * dw
                if kind == car.X:
                    forcing[b, (_ON_BODY + 1) * LANES + j] -= force * value
                else:
                    forcing[b, (_ON_BODY + 2) * LANES + j] += force * value
            elif kind in car.OF_FRICTION:
                forcing[b, (_ON_FRICTION + i) * LANES + j] += by[kind] * value
            elif kind in car.OF_WHEEL:
                forcing[b, (_ON_WHEELS + i) * LANES + j] += by[kind] * value * per_mass
            else:
                speed = mount_by[kind] * speed_by_mount * value
                forcing[b, i * LANES + j] += by[kind] * value + damping * speed
                forcing[b, (_ON_MOUNTS + i) * LANES + j] -= speed
    blocks, columns, d_mass, d_gravity = of_body
    for n in range(len(columns)):
        for k in range(3):
            force = d_gravity[n, k]
            for m in range(3):
                force -= d_mass[n, k, m] * rate[7 + m]
            forcing[blocks[n], (_ON_BODY + k) * LANES + columns[n]] += force


@kernel
def tangents(step_s, states, rates, speeds, p, knots, inverse, mounted, of_corners, of_body,
             starts, lengths, fine, levels, first_columns, samples, channels, out):  # fmt: skip
    """Integrate the tangents along a path and write what channels show of them.

    `states`, `rates`, `speeds`: nodes of the path.  `of_corners`, `of_body`: as in `linearise`.
    `starts`, `lengths`, `fine`: first node of each step, its length in nodes, and which of `levels`
    it has.  `first_columns`: at the start, (blocks, rows * LANES).  `samples`, in the order of the
    steps: step, weights (3, 4), first row of `out`, first channel and that after the last of each.
    `channels`: time derivative, first entry, motions and their factors.  `out`: (rows, columns).
    """
    steps, weights, first_row, first_channel, end_channel = samples
    blocks = len(first_columns)
    # The columns at the last node, at this one and at the next, in turns.
    nodes = np.zeros((3, blocks, TANGENT_ROWS * LANES))
    nodes[0] = first_columns
    work = np.empty((5, STATE_ROWS * LANES))
    slopes = np.zeros((3, 4 * CORNER_SLOPES))
    forcing = np.empty((3, blocks, FORCING_ROWS * LANES))
    known_level, n_written = -1, 0  # level of the end of the last step; samples written
    for m in range(len(starts) + 1):
        before, here, after = nodes[(m + 2) % 3], nodes[m % 3], nodes[(m + 1) % 3]
        if m < len(starts):
            i_level, length = fine[m], lengths[m]
            for i in range(3):  # begin, middle and end of the step
                if i == 0 and known_level == i_level:
                    slopes[0], forcing[0] = slopes[2], forcing[2]
                    continue
                node = starts[m] + i * length // 2
                linearise(states[node], rates[node], speeds[node], p, knots, levels[i_level],
                          mounted, of_corners, of_body, slopes[i], forcing[i])  # fmt: skip
            known_level = i_level
            for n in range(blocks):
                rk4(here[n], slopes, inverse, forcing[0, n], forcing[1, n], forcing[2, n],
                    length * step_s, work, after[n])  # fmt: skip
        else:  # the accelerations at the last node, which `rk4` writes at the others
            for n in range(blocks):
                column_rates(here[n], slopes[2], inverse, forcing[2, n], work[1])
                here[n, STATE_ROWS * LANES :] = work[1, 7 * LANES : 14 * LANES]
        while n_written < len(steps) and steps[n_written] < m:
            n = n_written
            add_sample(before, here, weights[n], channels, first_channel[n], end_channel[n],
                       out[first_row[n] :])  # fmt: skip
            n_written += 1


@kernel
def add_sample(before, after, weights, channels, first_channel, end_channel, out):
    """Add what some channels show of the columns at a time between two nodes, a row of `out` each.

    `before`, `after`: columns at the nodes, (blocks, TANGENT_ROWS * LANES).  `weights`, (3, 4): by
    time derivative, of values before and after, and of their slopes before and after.
    """
    orders, first_entry, motions, factors = channels
    n_columns = out.shape[1]
    for c in range(first_channel, end_channel):
        w0, w1, w2, w3 = weights[orders[c]]
        # Displacements follow from rows 0 to 6 and the speeds from row 7 on; speeds and their
        # derivatives from the speeds and the accelerations.
        values, slopes = (7, STATE_ROWS) if orders[c] else (0, 7)
        for m in range(first_entry[c], first_entry[c + 1]):
            factor = factors[m]
            v, s = (values + motions[m]) * LANES, (slopes + motions[m]) * LANES
            for b in range(len(before)):
                lanes = min(LANES, n_columns - b * LANES)
                row = out[c - first_channel, b * LANES : b * LANES + lanes]
                v0, v1 = before[b, v : v + lanes], after[b, v : v + lanes]
                s0, s1 = before[b, s : s + lanes], after[b, s : s + lanes]
                for j in range(lanes):
                    row[j] += factor * (w0 * v0[j] + w1 * v1[j] + w2 * s0[j] + w3 * s1[j])


# A sensor's low-pass ------------------------------------------------------------------------------


@kernel
def filter_pole(values, h, times, pole, residue, weights, out):
    """Add the output of a filter's pole at given times, ascending, to `out`, (m, columns).

    `values`, (n, columns): input at even times, n odd.  `h`: time of two steps of it, s.
    `weights`, (3,): of the input at the beginning, middle and end of two steps (`path.filtered`).
    Between the ends of two steps, the state is a cubic; its slope there is pole * state + input.
    """
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
            t = times[n] / h - k  # 0..1 within the two steps
            c, d = t * (1.0 - t) ** 2 * h, -(t**2) * (1.0 - t) * h  # of the slopes at both ends
            at_begin = residue * ((1.0 + 2.0 * t) * (1.0 - t) ** 2 + c * pole)
            at_end = residue * (t**2 * (3.0 - 2.0 * t) + d * pole)
            for j in range(size):
                out[n, j] += (at_begin * last_state[j] + at_end * state[j]).real
                out[n, j] += residue.real * (c * first[j] + d * end[j])
            n += 1
