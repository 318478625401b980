"""Sums of exponentials as data: the basis of every free decay and of its derivatives.

With the eigenvalues l_k of the state matrix, a channel of a free decay is a sum of ``exp(l_k t)``,
and its derivative by any parameter is a sum of ``exp(l_k t)`` and ``t exp(l_k t)``.  So a recording
enters a fit only through the products of these 28 functions (and a few of the channels' own: a
constant, the transients of a low-pass) with each other and with the samples: the cost of a fit is
linear in the samples, whatever the number of parameters.  The functions are evaluated at each
sample's own time; there is no common grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, isqrt

import numpy as np
from numpy.typing import NDArray

from .low_pass import LowPass

_FEW = 64  # samples for which factors would save nothing
_EVEN = 8.0  # spacings of float64 by which even times may depart from their line
_EQUAL = 1e-7  # eigenvalues closer than this, relative, are one double eigenvalue


def waves(time_s: NDArray[np.float64], rates: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return ``exp(rate t)`` of every rate at every time, (n_samples, n_rates).

    Most of a fit's time goes into these.  Where the times are even up to rounding, as those of a
    counted clock are, they are products of two short tables (each t is a coarse and a fine step).
    """
    n = len(time_s)
    if n >= _FEW:
        step = float(time_s[-1] - time_s[0]) / (n - 1)
        line = time_s[0] + step * np.arange(n)
        if np.abs(time_s - line).max() <= _EVEN * np.spacing(np.abs(time_s).max()):
            width = isqrt(n)
            fine = np.exp(np.multiply.outer(step * np.arange(width), rates))
            coarse = np.exp(np.multiply.outer(line[::width], rates))
            return np.asarray((coarse[:, None] * fine).reshape(ceil(n / width) * width, -1)[:n])
    return np.asarray(np.exp(np.multiply.outer(time_s, rates)))


def real_part(
    waves: NDArray[np.complex128], amplitudes: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return the real part of waves, (.., m), times amplitudes, (n_channels, m): (.., n_channels).

    It takes half of the products that complex numbers would.
    """
    turned = np.ascontiguousarray(amplitudes.conj())
    return np.asarray(waves.view(np.float64) @ turned.view(np.float64).T)


@dataclass(frozen=True, slots=True)
class Change:
    """Changes of a state matrix, in modal coordinates: one preparation serves all recordings."""

    apart: NDArray[np.complex128]
    """Entries between eigenvalues that differ, divided by the difference, shape (P, n, n)."""
    together: NDArray[np.complex128]
    """Entries between equal eigenvalues, the diagonal included, shape (P, n, n)."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Some channels in modal coordinates: one preparation serves all recordings of a mass state."""

    rows: NDArray[np.complex128]
    """Output rows (row V), shape (n_channels, n)."""
    through: NDArray[np.complex128]
    """The rows times `Change.apart`, shape (P, n_channels, n)."""
    gain: NDArray[np.complex128]
    """Gain of the channels' low-pass at the poles, shape (n,)."""
    gain_slope: NDArray[np.complex128]
    """Derivative of the gain by the pole, s, shape (n,)."""


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Eigenvalues and eigenvectors of a real state matrix, and how real functions span them."""

    poles: NDArray[np.complex128]
    """Eigenvalues, rad/s, shape (n,); conjugate pairs adjacent."""
    V: NDArray[np.complex128]
    W: NDArray[np.complex128]
    """`V`, `W`: right eigenvectors and their inverse, shape (n, n)."""
    to_real: NDArray[np.complex128]
    """Coefficients on (exp, t exp) to coefficients on the real basis, shape (2 n, 2 n)."""

    def basis(self, time_s: NDArray[np.float64], spare: int = 0) -> NDArray[np.float64]:
        """Return the real basis at the given times, (n_samples, 2 n + spare).

        The last `spare` columns are left for the caller to fill.
        """
        n = len(self.poles)
        out = np.empty((len(time_s), 2 * n + spare))
        upper = np.flatnonzero(self.poles.imag > 0)
        real = np.flatnonzero(self.poles.imag == 0)
        wave = waves(time_s, self.poles[upper])
        if len(real):
            out[:, upper], out[:, upper + 1] = wave.real, wave.imag
            out[:, real] = np.exp(np.multiply.outer(time_s, self.poles[real].real))
        else:  # the pairs are in this order already
            out[:, :n] = wave.view(np.float64)
        np.multiply(time_s[:, None], out[:, :n], out=out[:, n : 2 * n])
        return out

    def change(self, dA: NDArray[np.float64]) -> Change:
        """Bring changes of the state matrix, (P, n, n) in 1/s, into modal coordinates."""
        modal = self.W @ dA @ self.V
        gap = self.poles[:, None] - self.poles[None, :]
        scale = np.abs(self.poles)[:, None] + np.abs(self.poles)[None, :]
        same = np.abs(gap) < _EQUAL * scale
        inverse = np.where(same, 0.0, 1.0 / np.where(same, 1.0, gap))
        return Change(modal * inverse, modal * same)

    def outputs(self, rows: NDArray[np.complex128], change: Change, low_pass: LowPass) -> Outputs:
        """Prepare channels with one low-pass; `rows`, (n_channels, n): row V of each."""
        gain, slope = low_pass.gain(self.poles), low_pass.gain_slope(self.poles)
        return Outputs(rows, rows @ change.apart, gain, slope)

    def propagator_slope(
        self, seen: Outputs, change: Change, z: NDArray[np.complex128]
    ) -> NDArray[np.complex128]:
        """Coefficients of ``row . d(H(A) exp(A t)) . x0`` on (exp, t exp).

        Parameters
        ----------
        seen : Outputs
            The channels (`outputs`).
        change : Change
            Change of the state matrix (`change`).
        z : (.., n) complex128
            Initial states in modal coordinates (W x0).

        Returns
        -------
        (.., P, n_channels, 2 n) complex128
            By the divided differences of ``H(l) exp(l t)`` (Daleckii and Krein).
        """
        apart = seen.rows * _turned(change.apart, z)[..., None, :]
        apart -= seen.through * z[..., None, None, :]
        together = seen.rows * _turned(change.together, z)[..., None, :]
        return np.concatenate(
            [apart * seen.gain + together * seen.gain_slope, together * seen.gain], axis=-1
        )

    def on_real_basis(self, on: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the real part of `to_real` times coefficients on (exp, t exp), (.., 2 n)."""
        out = on.real.copy()
        upper = np.flatnonzero(self.poles.imag > 0)
        for k in (upper, upper + len(self.poles)):
            out[..., k] += on[..., k + 1].real
            out[..., k + 1] = on[..., k + 1].imag - on[..., k].imag
        return out


def _turned(matrices: NDArray[np.complex128], z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Multiply each of some matrices, (P, n, n), with each of some vectors, (.., n): (.., P, n)."""
    turned = matrices @ z.reshape(-1, z.shape[-1]).T  # (P, n, n_vectors)
    return np.moveaxis(turned, 2, 0).reshape(*z.shape[:-1], *matrices.shape[:2])


def spectrum(A: NDArray[np.float64]) -> Spectrum:
    """Decompose a real state matrix, (n, n) in 1/s."""
    poles, V = np.linalg.eig(A)
    poles, V = poles.astype(complex), V.astype(complex)
    n = len(poles)
    to_real = np.zeros((2 * n, 2 * n), dtype=complex)
    for offset in (0, n):
        for k in np.flatnonzero(poles.imag >= 0):
            if poles[k].imag == 0:
                to_real[offset + k, offset + k] = 1.0
            else:  # exp(conj(l) t) = cos part - i sin part
                to_real[offset + k, [offset + k, offset + k + 1]] = 1.0
                to_real[offset + k + 1, [offset + k, offset + k + 1]] = (1j, -1j)
    return Spectrum(poles, V, np.linalg.inv(V), to_real)
