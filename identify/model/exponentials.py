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

import numpy as np
from numpy.typing import NDArray

from .low_pass import LowPass

_EQUAL = 1e-7  # eigenvalues closer than this, relative, are one double eigenvalue


def waves(time_s: NDArray[np.float64], rates: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return ``exp(rate t)`` of every rate at every time, (n_samples, n_rates)."""
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
    """Changes of a state matrix by P unknowns, in modal coordinates, for all recordings.

    One pole represents each conjugate pair (`Spectrum.half`, h poles); the entries of the other are
    conjugate.
    """

    apart: NDArray[np.complex128]
    """Entries from each pole to one of `half` that differs from it, divided by their difference,
    shape (n, h, P)."""
    apart_into: NDArray[np.complex128]
    """Entries from one of `half` to each pole that differs from it, divided by their difference,
    shape (n, h, P)."""
    together: NDArray[np.complex128]
    """Entries from each pole to one of `half` that is equal, the diagonal included, shape
    (n, h, P)."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Some channels in modal coordinates: one preparation serves all recordings of a mass state."""

    rows: NDArray[np.complex128]
    """Output rows (row V), shape (n_channels, n)."""
    gain: NDArray[np.complex128]
    """Gain of the channels' low-pass at the poles, shape (n,)."""
    gained: NDArray[np.complex128]
    """The rows times the gain, shape (n_channels, h)."""
    bent: NDArray[np.complex128]
    """The rows times the derivative of the gain by the pole, s, shape (n_channels, h)."""
    through: NDArray[np.complex128]
    """The rows times `Change.apart_into`, times the gain, shape (n_channels, h, P)."""


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
    half: NDArray[np.intp]
    """Numbers of the real poles and of the upper one of each pair, shape (h,)."""

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
        apart, together = modal * inverse, modal * same
        return Change(
            np.ascontiguousarray(apart[:, self.half].T),
            np.ascontiguousarray(apart[:, :, self.half].transpose(1, 2, 0)),
            np.ascontiguousarray(together[:, self.half].T),
        )

    def outputs(self, rows: NDArray[np.complex128], change: Change, low_pass: LowPass) -> Outputs:
        """Prepare channels with one low-pass; `rows`, (n_channels, n): row V of each."""
        gain, slope, half = low_pass.gain(self.poles), low_pass.gain_slope(self.poles), self.half
        through = _along(rows, change.apart_into) * gain[half, None]
        return Outputs(rows, gain, (rows * gain)[:, half], (rows * slope)[:, half], through)

    def propagator_slope(
        self, seen: Outputs, change: Change, z: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return coefficients of ``row . d(H(A) exp(A t)) . x0`` on exp and on t exp.

        By the divided differences of ``H(l) exp(l t)`` (Daleckii and Krein), for the poles of
        `half`: two of (.., n_channels, h, P).  `z`, (.., n): initial states in modal coordinates (W
        x0).
        """
        apart = _along(z, change.apart)[..., None, :, :]
        together = _along(z, change.together)[..., None, :, :]
        gained = seen.gained[..., None]
        plain = gained * apart
        plain += seen.bent[..., None] * together
        plain -= seen.through * z[..., None, self.half, None]
        return plain, gained * together

    def on_real_basis(
        self, plain: NDArray[np.complex128], timed: NDArray[np.complex128]
    ) -> NDArray[np.float64]:
        """Bring coefficients on exp and on t exp, (.., h, P), on the real basis, (.., 2 n, P).

        ``c exp + conj(c exp)`` is ``2 Re c Re exp - 2 Im c Im exp``; a real pole has no conjugate.
        """
        turning = self.poles[self.half].imag > 0
        share = np.where(turning, 2.0, 1.0)[:, None]
        # By exp or t exp, pole, and Re or Im: the order of the basis.
        on_basis = np.empty((*plain.shape[:-2], 2, len(turning), 2, plain.shape[-1]))
        for k, part in enumerate((plain, timed)):
            np.multiply(part.real, share, out=on_basis[..., k, :, 0, :])
            np.multiply(part.imag, -2.0, out=on_basis[..., k, :, 1, :])
        on_basis = on_basis.reshape(*plain.shape[:-2], -1, plain.shape[-1])
        if turning.all():
            return on_basis
        # A real pole has no Im.
        in_basis = np.stack([np.ones_like(turning), turning], axis=1).ravel()
        return np.asarray(on_basis[..., np.tile(in_basis, 2), :])


def _along(
    vectors: NDArray[np.complex128], matrices: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Multiply some vectors, (.., n), with P matrices, (n, h, P): (.., h, P)."""
    product = vectors @ matrices.reshape(len(matrices), -1)
    return product.reshape(*vectors.shape[:-1], *matrices.shape[1:])


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
    return Spectrum(poles, V, np.linalg.inv(V), to_real, np.flatnonzero(poles.imag >= 0))
