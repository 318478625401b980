"""The path as machine code (Numba), one run at a time, and a sensor's low-pass on it.

The formulas are those of `identify.elements`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ..elements import laws as bar
from ..elements import laws as damper
from ..elements import laws as friction
from ..elements import laws as hinge
from ..elements import laws as mount
from ..elements import laws as spring
from ..elements import laws as stop
from ..elements import laws as tyre
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
)

# Makes machine code of the kernels (Numba), and keeps it for the processes to come ----------------
#
# Numba takes what it has stored for a function as good while the file of that function stays as it
# is.  But the code of a kernel also contains the formulas, constants and kernels of other files.
# So the name by which a kernel is stored has the hash of them all.

LOOSE = {"reassoc", "contract", "arcp", "nsz"}
"""Rearrangements that the compiler may make; NaN must stay NaN."""

_HERE = Path(__file__).parent
_FILES = ("car", "columns", "kernels")
SOURCES = (
    *sorted((_HERE.parent / "elements").glob("*.py")),
    *(_HERE / f"{name}.py" for name in _FILES),
)
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
        _forget_others(compiled.stats.cache_path)
    return compiled


@cache
def _forget_others(folder: str) -> None:
    """Remove what is stored of other versions of the sources."""
    for stored in Path(folder).glob("*.nb[ic]"):
        if _HASH not in stored.name:
            with suppress(OSError):  # it may be another user's, or removed by another process
                stored.unlink()


# The kernels --------------------------------------------------------------------------------------

for _module in (hinge, spring, stop, bar, damper, friction, tyre, mount):
    for _name, _formula in vars(_module).items():
        if callable(_formula) and getattr(_formula, "__module__", "") == _module.__name__:
            register_jitable(error_model="numpy", fastmath=LOOSE)(_formula)

knee, knee_slope, hinge_ = damper.knee, damper.knee_slope, hinge.hinge
spring_force, stop_force, bar_force = spring.spring_force, stop.stop_force, bar.bar_force
friction_rate, sliding_share = friction.friction_rate, friction.sliding_share
tyre_load, tyre_push, tyre_force = tyre.tyre_load, tyre.tyre_push, tyre.tyre_force
mount_misfit, mount_slope = mount.mount_misfit, mount.mount_slope

_TIGHT = 1e-11  # m/s, of the speed in a damper on a mount
_LARGEST = 100.0
"""Largest state of a finite path."""


@kernel
def bends(p, knots, width):
    """Return each corner's curve as a line through rest and hinges that all open upwards.

    A knee towards rebound is a line less the hinge of the same corner: ``H(-x) = H(x) - x``.
    """
    lines = np.empty((4, 2 + len(knots)))
    for i in range(4):
        lines[i, 0], lines[i, 1] = 0.0, p[i, C]
        for j in range(len(knots)):
            h = p[i, KNEES + j]
            if knots[j] < 0.0:
                lines[i, 0] += h * (hinge_(knots[j], width) - knots[j])
                lines[i, 1] += h
                lines[i, 2 + j] = -h
            else:
                lines[i, 0] -= h * hinge_(-knots[j], width)
                lines[i, 2 + j] = h
    return lines


@kernel
def curve(line, knots, r, width):
    """Return the force of an axle's damper at a speed; the knots ascend."""
    force = line[0] + line[1] * r
    for j in range(len(knots)):
        beyond = r - knots[j]
        if beyond <= -width:
            break
        if beyond >= width:
            force += line[2 + j] * beyond
        else:
            force += line[2 + j] * hinge_(beyond, width)
    return force


@kernel
def curve_slope(p, knots, r, width):
    """Return the slope of that force."""
    slope = p[C]
    for j in range(len(knots)):
        slope += p[KNEES + j] * knee_slope(r, knots[j], width)
    return slope


@kernel
def _damper_speed(p, line, knots, level, e, w, r):
    for _ in range(25):
        force = p[RATIO] * curve(line, knots, r, level[0])
        slope = p[RATIO] * curve_slope(p, knots, r, level[0])
        left = mount_misfit(r, force, e, w, p[MOUNT], level[3])
        step = left / mount_slope(slope, p[MOUNT], level[3])
        r -= step
        if abs(step) < _TIGHT:
            break
    return r


@kernel
def rates(x, p, lines, knots, inverse, pull, level, mounted, r, out):
    """Write the rates of change of a state, (22,), and the dampers' speeds, (4,)."""
    f0, f1, f2 = pull[0], pull[1], pull[2]
    for i in range(4):
        one = p[i]
        u = x[3 + i] - x[0] + one[X] * x[1] - one[Y] * x[2]
        w = x[10 + i] - x[7] + one[X] * x[8] - one[Y] * x[9]
        if mounted:
            r[i] = _damper_speed(one, lines[i], knots, level, x[18 + i], w, r[i])
        else:
            r[i] = w
        force = one[RATIO] * curve(lines[i], knots, r[i], level[0])
        force += spring_force(u, one[K_S], one[K_2], one[K_3]) + one[F_C] * x[14 + i]
        if u > one[GAP] - level[4]:
            force += stop_force(u, one[K_B], one[GAP], level[4])
        if one[K_A] != 0.0:
            k = i ^ 1
            across = x[3 + k] - x[0] + p[k, X] * x[1] - p[k, Y] * x[2]
            force += bar_force(u, across, one[K_A])
        f0 += force
        f1 -= one[X] * force
        f2 += one[Y] * force
        load = tyre_load(x[3 + i], one[K_T], one[BETA], one[STATIC])
        road = tyre_force(tyre_push(load, x[10 + i], one[C_T], level[5]), one[STATIC], level[5])
        out[10 + i] = (road - force + one[PULL]) / one[MASS]
        limit = sliding_share(w, one[SURPLUS], one[FALL]) if one[SURPLUS] != 0.0 else 1.0
        out[14 + i] = friction_rate(w, x[14 + i], one[LENGTH], limit, level[1], level[2])
        out[18 + i] = w - r[i] if mounted else 0.0
    for k in range(3):
        out[7 + k] = inverse[k, 0] * f0 + inverse[k, 1] * f1 + inverse[k, 2] * f2
    for k in range(7):
        out[k] = x[7 + k]


@kernel
def path(x0, r0, steps, step_s, p, knots, inverse, pull, level, mounted, states, slopes, speeds):
    """Integrate by RK4 and return the number of nodes that are finite."""
    x, r, lines = x0.copy(), r0.copy(), bends(p, knots, level[0])
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
        fine = True
        for m in range(22):
            x[m] += step_s / 6.0 * (k1[m] + 2.0 * (k2[m] + k3[m]) + k4[m])
            fine = fine and abs(x[m]) < _LARGEST
        if not fine:
            return n + 1
        rates(x, p, lines, knots, inverse, pull, level, mounted, r, k1)
        for m in range(22):
            states[n + 1, m], slopes[n + 1, m] = x[m], k1[m]
        for m in range(4):
            speeds[n + 1, m] = r[m]
    return steps + 1


@kernel
def sample(times, step_s, states, slopes, speeds, p, knots, inverse, pull, level, mounted,
           at, rate, speed):  # fmt: skip
    """Write state, rates and dampers' speeds at given times by cubic Hermite between the nodes."""
    last = len(states) - 2
    lines = bends(p, knots, level[0])
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


@njit(inline="always")
def _advance(wave, gain, first, middle, last, turn_re, turn_im, before_re, before_im, re, im):
    """Move the state of a pole over a double step; write the state before and after it."""
    for j in range(len(re)):
        before_re[j] = re[j]
    for j in range(len(im)):
        before_im[j] = im[j]
    for j in range(len(re)):
        drive = wave[0] * first[j] + wave[1] * middle[j] + wave[2] * last[j]
        re[j] = turn_re * before_re[j] - turn_im * before_im[j] + drive
    for j in range(len(im)):
        drive = gain[0] * first[j] + gain[1] * middle[j] + gain[2] * last[j]
        im[j] = turn_im * before_re[j] + turn_re * before_im[j] + drive


@kernel
def filter_pole(values, h, times, pole, residue, weights, out):
    """Add a first-order filter's output at given times, ascending, to `out`; see `filtered`."""
    size = values.shape[1]
    re, im, before_re, before_im = np.zeros(size), np.zeros(size), np.empty(size), np.empty(size)
    turn = np.exp(pole * h)
    wave, gain = weights.real.copy(), weights.imag.copy()
    n, last = 0, (len(values) - 1) // 2 - 1
    for k in range(last + 1):
        first, middle, end = values[2 * k], values[2 * k + 1], values[2 * k + 2]
        _advance(wave, gain, first, middle, end, turn.real, turn.imag, before_re, before_im, re, im)
        while n < len(times) and (times[n] / h < k + 1 or k == last):
            t = times[n] / h - k
            c, d = t * (1.0 - t) ** 2 * h, -(t**2) * (1.0 - t) * h
            before = residue * ((1.0 + 2.0 * t) * (1.0 - t) ** 2 + c * pole)
            after = residue * (t**2 * (3.0 - 2.0 * t) + d * pole)
            c, d = c * residue.real, d * residue.real
            b_re, b_im, a_re, a_im = before.real, before.imag, after.real, after.imag
            row = out[n]
            for j in range(size):
                row[j] += (
                    b_re * before_re[j] - b_im * before_im[j] + a_re * re[j] - a_im * im[j]
                    + c * first[j] + d * end[j]
                )  # fmt: skip
            n += 1


# Columns of the tangents side by side, for machine code (Numba): reading, summing, writing --------
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
