"""Fits records by modes that have one shape each: how much given poles explain.

The shape of a mode is common to all records, its amplitude is each record's own.  This is what
makes two modes with nearly the same pole (a vehicle has two such pairs) visible: one pole could
follow both in each single record, but not with one shape in all records.

Records are projected once on the exponentials of some poles; any sets of these poles are then
fitted by small matrices, many sets at once.
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
_AT_ONCE = 1 << 20
"""Numbers in the largest array of the sets that are fitted at once."""


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

    def of(self, sets: NDArray[np.intp]) -> _Chosen:
        """Return the part that belongs to some sets of the exponentials, (s, p)."""
        left, right = sets[:, :, None], sets[:, None]
        waves = self.waves[:, sets].transpose(1, 2, 0)
        products = self.products[:, :, sets].transpose(2, 0, 1, 3)
        return _Chosen(
            waves, self.target, products, self.mixed[left, right], self.plain[left, right]
        )


@dataclass(frozen=True, slots=True)
class _Chosen:
    """The same quantities for s sets of p exponentials each, the sets along the first axis."""

    waves: NDArray[np.complex128]
    """Shape (s, p, k)."""
    target: NDArray[np.float64]
    """Shape (n_records, n_channels, k)."""
    products: NDArray[np.complex128]
    """Shape (s, n_records, n_channels, p)."""
    mixed: NDArray[np.complex128]
    plain: NDArray[np.complex128]
    """`mixed`, `plain`: shape (s, p, p)."""

    def amplitudes(
        self, shapes: NDArray[np.complex128], weight: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return the best amplitude of each mode in each record, (s, n_records, p).

        `weight` (n_channels,) is the inverse of the variance of the noise.
        """
        weighted = shapes * weight[:, None]
        turned = shapes.swapaxes(1, 2)
        normal = real_block(
            (turned.conj() @ weighted) * self.mixed, (turned @ weighted) * self.plain
        )
        return _solved(normal, np.einsum("sncp,scp->snp", self.products, weighted))

    def for_shapes(
        self, amplitudes: NDArray[np.complex128]
    ) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Return normal matrices, (s, 2 p, 2 p), and products with the samples, (s, c, p)."""
        turned = amplitudes.swapaxes(1, 2)
        normal = real_block(
            (turned.conj() @ amplitudes) * self.mixed, (turned @ amplitudes) * self.plain
        )
        return normal, np.einsum("sncp,snp->scp", self.products, amplitudes)

    def left_by(
        self, amplitudes: NDArray[np.complex128], shapes: NDArray[np.complex128]
    ) -> NDArray[np.float64]:
        """Return the squares left in each channel within the space, (s, n_channels)."""
        s, p, k = self.waves.shape
        residue = (amplitudes[:, :, None] * shapes[:, None]).reshape(s, -1, p)
        fitted = residue.real @ self.waves.real - residue.imag @ self.waves.imag
        left = self.target - fitted.reshape(s, *self.target.shape[:2], k)
        return np.asarray(np.einsum("snck,snck->sc", left, left))


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

    def fits(
        self, sets: NDArray[np.intp], shapes: NDArray[np.complex128], sweeps: int = SWEEPS
    ) -> list[ModalFit]:
        """Fit shapes and amplitudes of some sets of the poles by alternating least squares.

        Noise is white, with an unknown level in each channel.

        Parameters
        ----------
        sets : (s, p) intp
            Indices of the poles of each set.
        shapes : (n_channels, m) complex128
            Shapes of all poles, to start from.
        sweeps : int
            Largest number of alternations; few are enough to compare sets that start near their
            optimum.
        """
        size = self.n_records * len(shapes) * max(1, sets.shape[1])
        step = max(1, _AT_ONCE // size)
        found: list[ModalFit] = []
        for first in range(0, len(sets), step):
            found += self._fits(sets[first : first + step], shapes, sweeps)
        return found

    def _fits(
        self, sets: NDArray[np.intp], shapes: NDArray[np.complex128], sweeps: int
    ) -> list[ModalFit]:
        records = [one.of(sets) for one in self.alike]
        weight = 1.0 / np.maximum(self.outside / self.n_samples, _NOISE_FLOOR)
        mine = shapes[:, sets].swapaxes(0, 1)
        residual = np.broadcast_to(self.outside, (len(sets), len(shapes)))
        for _ in range(sweeps if sets.shape[1] else 0):
            before = residual
            amplitudes = [r.amplitudes(mine, weight) for r in records]
            parts = [r.for_shapes(q) for r, q in zip(records, amplitudes, strict=True)]
            mine = _solved(*(np.sum(part, axis=0) for part in zip(*parts, strict=True)))
            inside = [r.left_by(q, mine) for r, q in zip(records, amplitudes, strict=True)]
            residual = self.outside + np.sum(inside, axis=0)
            length = np.linalg.norm(mine, axis=1, keepdims=True)
            mine = mine / np.where(length > 0.0, length, 1.0)
            if np.all(np.abs(before - residual) <= _SETTLED * residual):
                break
        merits = self._merit(residual, self.poles[sets])
        return [
            ModalFit(self.poles[chosen], shape, merit)
            for chosen, shape, merit in zip(sets, mine, merits, strict=True)
        ]

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

    Parameters
    ----------
    decays : sequence of (n_i, n_channels) float64
        Records, scaled alike, no channel of zeros.
    rate_hz : float
        Samples a second.
    poles : (m,) complex128
        Poles with an imaginary part of at least zero, rad/s.
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
    """Solve stacked normal equations, (s, 2 p, 2 p), for products (s, n, p).

    The ridge is far below noise; it matters only for poles that are equal to rounding.
    """
    n = normal.shape[-1]
    ridge = _RIDGE * np.trace(normal, axis1=1, axis2=2) / n + np.finfo(float).tiny
    target = np.concatenate([product.real, -product.imag], axis=2).swapaxes(1, 2)
    found = np.linalg.solve(normal + ridge[:, None, None] * np.eye(n), target)
    return np.asarray((found[:, : n // 2] + 1j * found[:, n // 2 :]).swapaxes(1, 2))


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
