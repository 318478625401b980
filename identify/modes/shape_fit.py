"""Fit of records by modes that have one shape each: how much do given poles explain.

The shape of a mode is common to all records, its amplitude is each record's own.  This is what
makes two modes with nearly the same pole (a vehicle has two such pairs) visible: one pole could
follow both in each record by itself, but not with a single shape in all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

_FALSE_ALARM = 1e-3
SWEEPS = 10
_SETTLED = 1e-4
"""Relative change of the squares left over below which the sweeps stop."""
_RIDGE = 1e-12
_NOISE_FLOOR = 1e-24
"""Variance, relative to the channel's, below which noise cannot be distinguished from rounding."""


@dataclass(frozen=True, slots=True)
class ModalFit:
    """Modes fitted to records."""

    poles: NDArray[np.complex128]
    """rad/s, shape (m,); one of each conjugate pair, and real ones."""
    shapes: NDArray[np.complex128]
    """Shapes fitted, unit length, shape (n_channels, m)."""
    merit: float
    """Twice the logarithm of the likelihood, less what as many modes would gain from noise: of two
    sets of modes the one with the higher merit is the better founded."""


@dataclass(frozen=True, slots=True)
class _Projected:
    """All records in the spaces that their exponentials span."""

    u: NDArray[np.float64]
    v: NDArray[np.float64]
    """Coordinates of the real part and of the negative imaginary part of each exponential, shape
    (n_records, k, m)."""
    target: NDArray[np.float64]
    """Coordinates of the samples, shape (n_records, k, n_channels)."""
    outside: NDArray[np.float64]
    """Squares of the samples that no amplitudes reach, shape (n_channels,)."""


def fit_modes(
    decays: Sequence[NDArray[np.float64]],
    rate_hz: float,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    sweeps: int = SWEEPS,
) -> ModalFit:
    """Fit shapes and amplitudes for given poles by alternating least squares.

    Noise is white and of its own, unknown size in each channel.

    Parameters
    ----------
    decays : sequence of (n_i, n_channels) float64
        Records, scaled alike, no channel of zeros.
    rate_hz : float
        Samples a second.
    poles : (m,) complex128
        Poles with an imaginary part of at least zero, rad/s.
    shapes : (n_channels, m) complex128
        Shapes to start from.
    sweeps : int
        Alternations at most; few are enough to compare sets that start near their optimum.
    """
    n = sum(len(decay) for decay in decays)
    residual = np.sum([np.sum(decay**2, axis=0) for decay in decays], axis=0)
    if len(poles):
        records = _project(decays, rate_hz, poles)
        weight = 1.0 / np.sqrt(np.maximum(records.outside / n, _NOISE_FLOOR))
        for _ in range(sweeps):
            before = residual
            shapes, inside = _shapes(records, _amplitudes(records, shapes, weight))
            residual = records.outside + inside
            if np.all(np.abs(before - residual) <= _SETTLED * residual):
                break
    likelihood = -n * np.sum(np.log(np.maximum(residual / n, _NOISE_FLOOR)))
    return ModalFit(
        poles, shapes, float(likelihood - gain_by_noise(poles, len(shapes), len(decays), n))
    )


def _project(
    decays: Sequence[NDArray[np.float64]], rate_hz: float, poles: NDArray[np.complex128]
) -> _Projected:
    m, oscillating = len(poles), poles.imag > 0.0
    lengths = np.array([len(decay) for decay in decays])
    wave = np.exp(np.outer(np.arange(lengths.max()) / rate_hz, poles))
    waves = np.hstack([wave.real, -wave.imag[:, oscillating]])
    k, n_channels = waves.shape[1], decays[0].shape[1]
    u, v = np.zeros((2, len(decays), k, m))
    target = np.zeros((len(decays), k, n_channels))
    outside = np.zeros(n_channels)
    for length in np.unique(lengths):  # records of one length share their exponentials
        mine = np.flatnonzero(lengths == length)
        triangle = _triangle(np.hstack([waves[:length], *(decays[i] for i in mine.tolist())]))
        u[mine] = triangle[:k, :m]
        v[np.ix_(mine, np.arange(k), oscillating)] = triangle[:k, m:k]
        columns = triangle[:, k:].reshape(len(triangle), len(mine), n_channels)
        target[mine] = columns[:k].swapaxes(0, 1)
        outside += np.sum(columns[k:] ** 2, axis=(0, 1))
    return _Projected(u, v, target, outside)


def _triangle(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return R of the QR decomposition of a tall table, by blocks of rows.

    Many such tables are decomposed, and a whole one is just large enough for the linear algebra
    library to wake its threads, which on a busy machine takes longer than the work.
    """
    width = table.shape[1]
    height = 4 * width
    while len(table) > height:
        missing = -len(table) % height
        blocks = np.pad(table, ((0, missing), (0, 0))).reshape(-1, height, width)
        table = np.asarray(np.linalg.qr(blocks, mode="r")).reshape(-1, width)
    table = np.pad(table, ((0, max(0, width - len(table))), (0, 0)))
    return np.asarray(np.linalg.qr(table, mode="r"))


def _amplitudes(
    records: _Projected, shapes: NDArray[np.complex128], weight: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return the best amplitude of each mode in each record, (n_records, m)."""
    n_records, _, m = records.u.shape
    re, im = ((part * weight[:, None])[:, None, None] for part in (shapes.real, shapes.imag))
    columns = np.concatenate(
        [records.u * re + records.v * im, records.v * re - records.u * im], axis=-1
    )  # (n_channels, n_records, k, 2 m)
    columns = columns.transpose(1, 0, 2, 3).reshape(n_records, -1, 2 * m)
    target = (records.target * weight).transpose(0, 2, 1).reshape(n_records, -1, 1)
    found = _least_squares(columns, target)[..., 0]
    return np.asarray(found[:, :m] + 1j * found[:, m:])


def _shapes(
    records: _Projected, amplitudes: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the best shapes, (n_channels, m), and the squares they leave in each channel."""
    m = amplitudes.shape[1]
    re, im = amplitudes.real[:, None], amplitudes.imag[:, None]
    columns = np.concatenate(
        [records.u * re + records.v * im, records.v * re - records.u * im], axis=-1
    ).reshape(-1, 2 * m)
    target = records.target.reshape(len(columns), -1)
    found = _least_squares(columns, target)
    shapes: NDArray[np.complex128] = (found[:m] + 1j * found[m:]).T
    size = np.linalg.norm(shapes, axis=0)
    left: NDArray[np.float64] = np.sum((target - columns @ found) ** 2, axis=0)
    return shapes / np.where(size > 0.0, size, 1.0), left


def _least_squares(
    columns: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve by normal equations: columns are few, and a hundred fits compare sets of modes.

    The ridge is far below noise; it decides only between poles that are the same to rounding.
    """
    transposed = np.swapaxes(columns, -1, -2)
    normal = transposed @ columns
    n = normal.shape[-1]
    ridge = _RIDGE * np.trace(normal, axis1=-2, axis2=-1) / n + np.finfo(float).tiny
    return np.asarray(
        np.linalg.solve(normal + ridge[..., None, None] * np.eye(n), transposed @ target)
    )


def gain_by_noise(poles: NDArray[np.complex128], n_channels: int, n_records: int, n: int) -> float:
    """Return what `poles` may gain by following noise.

    Each free number gains about 1, so a mode's gain is chi-squared distributed; and there are some
    n frequencies at which noise may look like a mode, the best of which is the one that is found.
    """
    numbers = n_channels + n_records
    pairs = int(np.sum(poles.imag > 0.0))
    gain = pairs * chdtri(2 * numbers, _FALSE_ALARM / n)
    return float(gain + (len(poles) - pairs) * chdtri(numbers, _FALSE_ALARM / n))
