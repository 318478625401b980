"""The path as machine code (Numba), one run at a time, and a sensor's low-pass on it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
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
# Numba takes what it has stored for a function as good while the file of that function stays as it
# is.  But the code of a kernel also contains the formulas, constants and kernels of other files.
# So the name by which a kernel is stored has the hash of them all.

LOOSE = {"reassoc", "contract", "arcp", "nsz"}
"""Rearrangements that the compiler may make; NaN must stay NaN."""

SOURCES = tuple(
    Path(__file__).with_name(f"{name}.py") for name in ("car", "laws", "columns", "kernels")
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

for _law in vars(laws).values():
    if isinstance(_law, FunctionType):
        register_jitable(error_model="numpy", fastmath=LOOSE)(_law)

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
    """Return the force of an axle's damper at a speed; the knots ascend."""
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
def curve_slope(p, knots, r, width):
    """Return the slope of that force."""
    slope = p[car.C]
    for j in range(len(knots)):
        slope += p[car.KNEES + j] * laws.knee_slope(r, knots[j], width)
    return slope


@kernel
def _damper_speed(p, line, knots, level, e, w, r):
    for _ in range(25):
        force = p[car.RATIO] * curve(line, knots, r, level[0])
        slope = p[car.RATIO] * curve_slope(p, knots, r, level[0])
        left = laws.mount_misfit(r, force, e, w, p[car.MOUNT], level[3])
        step = left / laws.mount_slope(slope, p[car.MOUNT], level[3])
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
        u = x[3 + i] - x[0] + one[car.X] * x[1] - one[car.Y] * x[2]
        w = x[10 + i] - x[7] + one[car.X] * x[8] - one[car.Y] * x[9]
        if mounted:
            r[i] = _damper_speed(one, lines[i], knots, level, x[18 + i], w, r[i])
        else:
            r[i] = w
        force = one[car.RATIO] * curve(lines[i], knots, r[i], level[0])
        force += (
            laws.spring_force(u, one[car.K_S], one[car.K_2], one[car.K_3])
            + one[car.F_C] * x[14 + i]
        )
        if u > one[car.GAP] - level[4]:
            force += laws.stop_force(u, one[car.K_B], one[car.GAP], one[car.POWER], level[4])
        if one[car.K_A] != 0.0:
            k = i ^ 1
            across = x[3 + k] - x[0] + p[k, car.X] * x[1] - p[k, car.Y] * x[2]
            force += one[car.K_A] * (u - across)
        f0 += force
        f1 -= one[car.X] * force
        f2 += one[car.Y] * force
        load = laws.tyre_load(x[3 + i], one[car.K_T], one[car.BETA], one[car.STATIC])
        road = laws.tyre_force(
            laws.tyre_push(load, x[10 + i], one[car.C_T], level[5]), one[car.STATIC], level[5]
        )
        out[10 + i] = (road - force + one[car.PULL]) / one[car.MASS]
        limit = (
            laws.sliding_share(w, one[car.SURPLUS], one[car.FALL])
            if one[car.SURPLUS] != 0.0
            else 1.0
        )
        out[14 + i] = laws.friction_rate(w, x[14 + i], one[car.LENGTH], limit, level[1], level[2])
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
