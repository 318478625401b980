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

from ..model.chi_squared import exceeded_by_chance
from .waves import real_block

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
    """Records of one length in the space that their exponentials span."""

    waves: NDArray[np.complex128]
    """Coordinates of each exponential, shape (k, m)."""
    target: NDArray[np.float64]
    """Coordinates of the samples, shape (n_records, n_channels, k)."""
    products: NDArray[np.complex128]
    """Sums of exponentials times samples, shape (n_records, n_channels, m)."""
    mixed: NDArray[np.complex128]
    plain: NDArray[np.complex128]
    """`mixed`, `plain`: sums of ``conj(f) g`` and of ``f g`` of the exponentials, shape (m, m)."""
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
        outside = np.sum([alike.outside for alike in records], axis=0)
        weight = 1.0 / np.maximum(outside / n, _NOISE_FLOOR)
        for _ in range(sweeps):
            before = residual
            shapes, inside = _shapes(records, [_amplitudes(r, shapes, weight) for r in records])
            residual = outside + inside
            if np.all(np.abs(before - residual) <= _SETTLED * residual):
                break
    likelihood = -n * np.sum(np.log(np.maximum(residual / n, _NOISE_FLOOR)))
    return ModalFit(
        poles, shapes, float(likelihood - gain_by_noise(poles, len(shapes), len(decays), n))
    )


def _project(
    decays: Sequence[NDArray[np.float64]], rate_hz: float, poles: NDArray[np.complex128]
) -> list[_Projected]:
    """Project records on some exponentials; those of one length share them."""
    m, oscillating = len(poles), poles.imag > 0.0
    lengths = np.array([len(decay) for decay in decays])
    wave = np.exp(np.outer(np.arange(lengths.max()) / rate_hz, poles))
    columns = np.hstack([wave.real, wave.imag[:, oscillating]])
    n_channels = decays[0].shape[1]
    records = []
    for length in np.unique(lengths):
        mine = [decays[i] for i in np.flatnonzero(lengths == length).tolist()]
        basis, triangle = np.linalg.qr(columns[:length])
        samples = np.hstack(mine)
        within = basis.T @ samples
        left = np.sum((samples - basis @ within) ** 2, axis=0)
        waves = triangle[:, :m].astype(complex)
        waves[:, oscillating] += 1j * triangle[:, m:]
        target = within.T.reshape(len(mine), n_channels, -1)
        records.append(
            _Projected(
                waves,
                target,
                target @ waves,
                waves.conj().T @ waves,
                waves.T @ waves,
                left.reshape(len(mine), n_channels).sum(axis=0),
            )
        )
    return records


def _amplitudes(
    records: _Projected, shapes: NDArray[np.complex128], weight: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return the best amplitude of each mode in each record, (n_records, m).

    `weight` (n_channels,) is the inverse of the variance of the noise.
    """
    weighted = shapes * weight[:, None]
    normal = real_block(
        (shapes.conj().T @ weighted) * records.mixed, (shapes.T @ weighted) * records.plain
    )
    product = np.einsum("ncm,cm->nm", records.products, weighted)
    found = _solved(normal, np.hstack([product.real, -product.imag]).T)
    m = shapes.shape[1]
    return np.asarray((found[:m] + 1j * found[m:]).T)


def _shapes(
    records: Sequence[_Projected], amplitudes: Sequence[NDArray[np.complex128]]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the best shapes, (n_channels, m), and the squares they leave in each channel."""
    pairs = list(zip(records, amplitudes, strict=True))
    normal = np.sum(
        [real_block((q.conj().T @ q) * r.mixed, (q.T @ q) * r.plain) for r, q in pairs], axis=0
    )
    product = np.sum([np.einsum("ncm,nm->cm", r.products, q) for r, q in pairs], axis=0)
    m = product.shape[1]
    found = _solved(normal, np.hstack([product.real, -product.imag]).T)
    shapes: NDArray[np.complex128] = (found[:m] + 1j * found[m:]).T
    left = np.zeros(len(shapes))
    for r, q in pairs:
        residue = q[:, None] * shapes
        fitted = residue.real @ r.waves.real.T - residue.imag @ r.waves.imag.T
        left += np.sum((r.target - fitted) ** 2, axis=(0, 2))
    size = np.linalg.norm(shapes, axis=0)
    return shapes / np.where(size > 0.0, size, 1.0), left


def _solved(normal: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve normal equations: unknowns are few, and a hundred fits compare sets of modes.

    The ridge is far below noise; it decides only between poles that are the same to rounding.
    """
    n = len(normal)
    ridge = _RIDGE * np.trace(normal) / n + np.finfo(float).tiny
    return np.asarray(np.linalg.solve(normal + ridge * np.eye(n), target))


def gain_by_noise(poles: NDArray[np.complex128], n_channels: int, n_records: int, n: int) -> float:
    """Return what `poles` may gain by following noise.

    Each free number gains about 1, so a mode's gain is chi-squared distributed; and there are some
    n frequencies at which noise may look like a mode, the best of which is the one that is found.
    """
    numbers = n_channels + n_records
    pairs = int(np.sum(poles.imag > 0.0))
    gain = pairs * exceeded_by_chance(2 * numbers, _FALSE_ALARM / n)
    return float(gain + (len(poles) - pairs) * exceeded_by_chance(numbers, _FALSE_ALARM / n))
