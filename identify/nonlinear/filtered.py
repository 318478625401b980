"""Applies a sensor's low-pass to a motion at even times; the output is at the samples' times.

The filter is a sum of first-order filters, one for each pole, each integrated exactly for an input
that is a parabola over two steps.  Its own transients are left out: they are free constants of the
channel.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..model.low_pass import LowPass

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def pole_terms(
    low_pass: LowPass, h: float
) -> Iterator[tuple[complex, complex, NDArray[np.complex128]]]:
    """Yield each pole without its conjugate, its residue for both, and the weights of its input.

    The weights, (3,), are of the input at the start, the middle and the end of a double step of
    `h` seconds.
    """
    s = (_POINTS + 1.0) / 2.0  # of the double step
    shapes = np.array([(2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)])
    poles = low_pass.poles
    for i, pole in enumerate(poles):
        if pole.imag < 0.0:
            continue
        others = np.delete(poles, i)
        residue = np.prod(-poles) / np.prod(pole - others)
        share = 2.0 if pole.imag > 0.0 else 1.0
        kernel = np.exp(pole * h * (1.0 - s)) * _WEIGHTS * h / 2.0
        yield complex(pole), complex(share * residue), shapes @ kernel


def filtered(
    low_pass: LowPass,
    values: NDArray[np.float64],
    step_s: float,
    times_s: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the output of a low-pass that was at rest before.

    Parameters
    ----------
    low_pass : LowPass
        With at least one pole.
    values : (n, ...) float64
        Its input at 0, `step_s`, ...; n is odd.
    step_s : float
        Spacing, s.
    times_s : (m,) float64
        Times of the output, s.

    Returns
    -------
    (m, ...) float64
    """
    from scipy.signal import lfilter  # takes a second to import, and Numba does not need it

    h = 2.0 * step_s
    first, middle, last = values[:-1:2], values[1::2], values[2::2]
    k = np.clip((times_s / h).astype(int), 0, len(first) - 1)
    t = (times_s / h - k).reshape(-1, *[1] * (values.ndim - 1))
    a, b = (1 + 2 * t) * (1 - t) ** 2, t**2 * (3 - 2 * t)
    c, d = t * (1 - t) ** 2 * h, -(t**2) * (1 - t) * h
    total = np.zeros((len(times_s), *values.shape[1:]))
    for pole, residue, weights in pole_terms(low_pass, h):
        drive = np.zeros((len(first) + 1, *values.shape[1:]), dtype=complex)
        drive[1:] = sum(w * part for w, part in zip(weights, (first, middle, last), strict=True))
        state = lfilter([1.0], [1.0, -np.exp(pole * h)], drive, axis=0)
        rate = pole * state
        rate += values[::2]
        found = a * state[k] + b * state[k + 1] + c * rate[k] + d * rate[k + 1]
        total += (residue * found).real
    return total
