"""Fits records by modes that have one shape each: how much given poles explain.

The shape of a mode is common to all records, its amplitude is each record's own.  This is what
makes two modes with nearly the same pole (a vehicle has two such pairs) visible: one pole could
follow both in each single record, but not with one shape in all records.

Records are projected once on the exponentials of some poles; any set of these poles is then
fitted by small matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..model.chi_squared import exceeded_by_chance
from .waves import least_left, real_block

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
    sets of modes, the one with the higher merit is preferred."""


@dataclass(frozen=True, slots=True)
class _Alike:
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

    def amplitudes(
        self, which: NDArray[np.intp], shapes: NDArray[np.complex128], weight: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return the best amplitude of some modes in each record, (n_records, p).

        `which` (p,): indices of their exponentials.  `shapes` (n_channels, p).  `weight`
        (n_channels,) is the inverse of the variance of the noise.
        """
        weighted = shapes * weight[:, None]
        products = np.einsum("ncp,cp->np", self.products[..., which], weighted)
        return _solved(self._normal(which, shapes, weighted), products)

    def for_shapes(
        self, which: NDArray[np.intp], amplitudes: NDArray[np.complex128]
    ) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Return the normal matrix, (2 p, 2 p), and products with the samples, (n_channels, p)."""
        products = np.einsum("ncp,np->cp", self.products[..., which], amplitudes)
        return self._normal(which, amplitudes, amplitudes), products

    def left_by(
        self,
        which: NDArray[np.intp],
        amplitudes: NDArray[np.complex128],
        shapes: NDArray[np.complex128],
    ) -> NDArray[np.float64]:
        """Return the squares left in each channel within the space, (n_channels,)."""
        residue = amplitudes[:, None] * shapes
        left = self.target - (residue @ self.waves[:, which].T).real
        return np.asarray(np.einsum("nck,nck->c", left, left))

    def _normal(
        self,
        which: NDArray[np.intp],
        left: NDArray[np.complex128],
        right: NDArray[np.complex128],
    ) -> NDArray[np.float64]:
        pairs = np.ix_(which, which)
        mixed, plain = self.mixed[pairs], self.plain[pairs]
        return real_block((left.conj().T @ right) * mixed, (left.T @ right) * plain)


@dataclass(frozen=True, slots=True)
class Projection:
    """Records projected on the exponentials of some poles."""

    poles: NDArray[np.complex128]
    """rad/s, imaginary parts of at least zero, shape (m,)."""
    alike: tuple[_Alike, ...]
    """The records of each length."""
    outside: NDArray[np.float64]
    """Squares of the samples outside the space of the exponentials, shape (n_channels,)."""
    n_records: int
    n_samples: int
    """`n_records`, `n_samples`: total numbers of records, and of samples of one channel."""

    @property
    def most_merit(self) -> float:
        """Upper bound of the merit: amplitudes free in every channel of every record."""
        return self._merit(self.outside[None], self.poles[None])[0]

    def merits_without(self, kept: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return an upper bound of the merit of some poles without each of them, (len(kept),)."""
        m, turning = len(kept), self.poles[kept].imag > 0.0
        left = np.repeat(self.outside[None], m, axis=0)
        for one in self.alike:
            waves = one.waves[:, kept]
            target = one.target.reshape(-1, one.target.shape[2]).T
            least = least_left(waves, turning, target)
            left += least.reshape(m, *one.target.shape[:2]).sum(axis=1)
        return np.array(self._merit(left, self.poles[without_each(kept)]))

    def fit(
        self, which: NDArray[np.intp], shapes: NDArray[np.complex128], sweeps: int = SWEEPS
    ) -> ModalFit:
        """Fit shapes and amplitudes of some of the poles by alternating least squares.

        `which` (p,): indices of the poles.  `shapes` (n_channels, p): to start from.  `sweeps`:
        most alternations; few rank sets that start near their optimum.  Noise is white, with an
        unknown level in each channel.
        """
        weight = 1.0 / np.maximum(self.outside / self.n_samples, _NOISE_FLOOR)
        residual = self.outside
        for _ in range(sweeps if len(which) else 0):
            before = residual
            amplitudes = [one.amplitudes(which, shapes, weight) for one in self.alike]
            both = list(zip(self.alike, amplitudes, strict=True))
            parts = [one.for_shapes(which, q) for one, q in both]
            normal, products = (sum(part) for part in zip(*parts, strict=True))
            shapes = _solved(normal, products)
            residual = self.outside + sum(one.left_by(which, q, shapes) for one, q in both)
            length = np.linalg.norm(shapes, axis=0)
            shapes = shapes / np.where(length > 0.0, length, 1.0)
            if np.all(np.abs(before - residual) <= _SETTLED * residual):
                break
        (merit,) = self._merit(residual[None], self.poles[which][None])
        return ModalFit(self.poles[which], shapes, merit)

    def _merit(self, left: NDArray[np.float64], poles: NDArray[np.complex128]) -> list[float]:
        """Return the merit of sets of poles, (s, p), that leave some squares, (s, n_channels)."""
        n = self.n_samples
        likelihood = -n * np.sum(np.log(np.maximum(left / n, _NOISE_FLOOR)), axis=1)
        noise = gain_by_noise(poles, left.shape[1], self.n_records, n)
        return list((likelihood - noise).tolist())


def without_each(kept: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return some indices without each of them, (m, m - 1)."""
    m = len(kept)
    return np.asarray(np.broadcast_to(kept, (m, m))[~np.eye(m, dtype=bool)].reshape(m, m - 1))


def project(
    decays: Sequence[NDArray[np.float64]], rate_hz: float, poles: NDArray[np.complex128]
) -> Projection:
    """Project records on some exponentials; those of one length share them.

    `decays`: records (n_i, n_channels), scaled alike, no channel of zeros.  `poles` (m,), rad/s,
    have an imaginary part of at least zero.
    """
    m, oscillating = len(poles), poles.imag > 0.0
    lengths = np.array([len(decay) for decay in decays])
    wave = np.exp(np.multiply.outer(np.arange(lengths.max()) / rate_hz, poles))
    columns = np.hstack([wave.real, wave.imag[:, oscillating]])
    n_channels = decays[0].shape[1]
    records = []
    outside = np.zeros(n_channels)
    for length in sorted(set(lengths.tolist())):
        mine = [decays[i] for i in np.flatnonzero(lengths == length).tolist()]
        basis, triangle = np.linalg.qr(columns[:length])
        samples = np.hstack(mine)
        within = basis.T @ samples
        left = samples - basis @ within
        outside += np.einsum("ij,ij->j", left, left).reshape(len(mine), n_channels).sum(axis=0)
        waves = triangle[:, :m].astype(complex)
        waves[:, oscillating] += 1j * triangle[:, m:]
        target = within.T.reshape(len(mine), n_channels, -1)
        records.append(
            _Alike(waves, target, target @ waves, waves.conj().T @ waves, waves.T @ waves)
        )
    return Projection(poles, tuple(records), outside, len(decays), int(lengths.sum()))


def _solved(normal: NDArray[np.float64], product: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Solve normal equations, (2 p, 2 p), for products (n, p).

    The ridge is far below noise; it matters only for poles that are equal to rounding.
    """
    n = len(normal)
    ridge = _RIDGE * np.trace(normal) / n + np.finfo(float).tiny
    target = np.concatenate([product.real, -product.imag], axis=1).T
    solution = np.linalg.solve(normal + ridge * np.eye(n), target)
    return np.asarray((solution[: n // 2] + 1j * solution[n // 2 :]).T)


def gain_by_noise(
    poles: NDArray[np.complex128], n_channels: int, n_records: int, n: int
) -> NDArray[np.float64]:
    """Return what some poles, or each of some sets, (.., p), may gain by following noise.

    Each free number gains about 1, so a mode's gain is chi-squared distributed; and noise may look
    like a mode at some n frequencies, of which the search finds the best.
    """
    numbers = n_channels + n_records
    pairs = np.sum(poles.imag > 0.0, axis=-1)
    chance = _FALSE_ALARM / n
    gain = pairs * exceeded_by_chance(2 * numbers, chance)
    return np.asarray(gain + (poles.shape[-1] - pairs) * exceeded_by_chance(numbers, chance))
