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
_SWEEPS = 10
_NOISE_FLOOR = 1e-24
"""Variance, relative to the channel's, below which noise is not told from rounding."""


@dataclass(frozen=True, slots=True)
class ModalFit:
    """Modes fitted to records.

    Parameters
    ----------
    poles : (m,) complex128
        rad/s; one of each conjugate pair, and real ones.
    shapes : (n_channels, m) complex128
        Shapes fitted, unit length.
    merit : float
        Twice the logarithm of the likelihood, less what as many modes would gain from noise: of
        two sets of modes the one with the higher merit is the better founded.
    """

    poles: NDArray[np.complex128]
    shapes: NDArray[np.complex128]
    merit: float


@dataclass(frozen=True, slots=True)
class _Projected:
    """One record in the space that its exponentials span.

    Parameters
    ----------
    u, v : (k, m) float64
        Coordinates of the real part and of the negative imaginary part of each exponential.
    target : (k, n_channels) float64
        Coordinates of the samples.
    outside : (n_channels,) float64
        Squares of the samples that no amplitudes reach.
    """

    u: NDArray[np.float64]
    v: NDArray[np.float64]
    target: NDArray[np.float64]
    outside: NDArray[np.float64]


def fit_modes(
    decays: Sequence[NDArray[np.float64]],
    rate_hz: float,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
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
    """
    n = sum(len(decay) for decay in decays)
    records = [_project(decay, rate_hz, poles) for decay in decays]
    outside = np.sum([record.outside for record in records], axis=0)
    residual = outside
    if len(poles):
        weight = 1.0 / np.sqrt(np.maximum(outside / n, _NOISE_FLOOR))
        for _ in range(_SWEEPS):
            amplitudes = [_amplitudes(record, shapes, weight) for record in records]
            shapes, inside = _shapes(records, amplitudes)
        residual = outside + inside
    likelihood = -n * np.sum(np.log(np.maximum(residual / n, _NOISE_FLOOR)))
    return ModalFit(poles, shapes, float(likelihood - _feigned(poles, shapes, len(decays), n)))


def _project(
    decay: NDArray[np.float64], rate_hz: float, poles: NDArray[np.complex128]
) -> _Projected:
    m, oscillating = len(poles), poles.imag > 0.0
    wave = np.exp(np.outer(np.arange(len(decay)) / rate_hz, poles))
    basis, triangle = np.linalg.qr(np.hstack([wave.real, -wave.imag[:, oscillating]]))
    target = basis.T @ decay
    v = np.zeros((len(triangle), m))
    v[:, oscillating] = triangle[:, m:]
    return _Projected(triangle[:, :m], v, target, np.sum((decay - basis @ target) ** 2, axis=0))


def _amplitudes(
    record: _Projected, shapes: NDArray[np.complex128], weight: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return the best amplitude of each mode in one record, (m,)."""
    re, im = shapes.real[:, None, :], shapes.imag[:, None, :]
    columns = np.concatenate([record.u * re + record.v * im, record.v * re - record.u * im], axis=2)
    columns = (columns * weight[:, None, None]).reshape(-1, 2 * shapes.shape[1])
    found = np.linalg.lstsq(columns, (record.target * weight).T.ravel(), rcond=None)[0]
    return np.asarray(found[: shapes.shape[1]] + 1j * found[shapes.shape[1] :])


def _shapes(
    records: Sequence[_Projected], amplitudes: Sequence[NDArray[np.complex128]]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the best shapes, (n_channels, m), and the squares they leave in each channel."""
    columns = np.vstack(
        [
            np.hstack([r.u * a.real + r.v * a.imag, r.v * a.real - r.u * a.imag])
            for r, a in zip(records, amplitudes, strict=True)
        ]
    )
    target = np.vstack([record.target for record in records])
    found = np.linalg.lstsq(columns, target, rcond=None)[0]
    m = len(amplitudes[0])
    shapes: NDArray[np.complex128] = (found[:m] + 1j * found[m:]).T
    size = np.linalg.norm(shapes, axis=0)
    left: NDArray[np.float64] = np.sum((target - columns @ found) ** 2, axis=0)
    return shapes / np.where(size > 0.0, size, 1.0), left


def _feigned(
    poles: NDArray[np.complex128], shapes: NDArray[np.complex128], n_records: int, n: int
) -> float:
    """Return what `poles` may gain by following noise.

    Each free number gains about 1, so a mode's gain is chi-squared distributed; and there are some
    n frequencies at which noise may look like a mode, the best of which is the one that is found.
    """
    numbers = len(shapes) + n_records
    pairs = int(np.sum(poles.imag > 0.0))
    gain = pairs * chdtri(2 * numbers, _FALSE_ALARM / n)
    return float(gain + (len(poles) - pairs) * chdtri(numbers, _FALSE_ALARM / n))
