"""Products of the derivatives of a modal model, summed over the samples of one block.

Series that are sampled alike share their exponentials: their sums over the samples are the same,
and only the shapes and amplitudes before them differ.  Taken out of the sums, what is left for a
run is elementwise in the modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .waves import real_block

_Complex = NDArray[np.complex128]
_Real = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Part:
    """One block of samples at one point of the poles."""

    runs: NDArray[np.intp]
    """Runs that have series in the block, shape (r,)."""
    weight: _Real
    """Inverse variance of each series, zero where a run has none, shape (r, n_channels)."""
    mixed: _Complex
    plain: _Complex
    """`mixed`, `plain`: sums of ``conj(f) g`` and of ``f g`` of the functions ``exp(pole t)`` and
    ``t exp(pole t)``, shape (2 m, 2 m)."""

    def run_run(self, shapes: _Complex) -> _Real:
        """Return the products of amplitudes with each other, (r, 2 m, 2 m)."""
        mixed, plain = self._of(0, 0)
        across, along = self._pairs(shapes)
        return real_block(across * mixed, along * plain)

    def pole_run(self, shapes: _Complex, amplitudes: _Complex) -> _Real:
        """Return the products of poles with amplitudes, (r, 2 m, 2 m); amplitudes (r, m)."""
        mixed, plain = self._of(1, 0)
        across, along = self._pairs(shapes)
        q = amplitudes[:, :, None]
        return real_block(q.conj() * across * mixed, q * along * plain)

    def pole_pole(self, shapes: _Complex, amplitudes: _Complex) -> _Real:
        """Return the products of poles with each other, (2 m, 2 m)."""
        mixed, plain = self._of(1, 1)
        across, along = self._pairs(shapes)
        left, right = amplitudes[:, :, None], amplitudes[:, None]
        first = np.sum(left.conj() * right * across, axis=0)
        second = np.sum(left * right * along, axis=0)
        return real_block(first * mixed, second * plain)

    def shape_shape(self, member: _Real, sign: _Real, amplitudes: _Complex) -> _Real:
        """Return the products of each owner's entries with each other, (n_owners, 2 m, 2 m)."""
        mixed, plain = self._of(0, 0)
        each = np.einsum("gc,rc->gcr", member, self.weight)
        tied = np.einsum("gcr,ci,cj->gijr", each, sign, sign, optimize=True)
        left, right = amplitudes.T[:, None], amplitudes.T[None]  # (m, 1, r), (1, m, r)
        first = np.sum(tied * (left.conj() * right), axis=-1)
        second = np.sum(tied * (left * right), axis=-1)
        return real_block(first * mixed, second * plain)

    def with_shapes(
        self, member: _Real, sign: _Real, shapes: _Complex, amplitudes: _Complex
    ) -> tuple[_Real, _Real]:
        """Return the products of each owner's entries with poles and with amplitudes.

        Parameters
        ----------
        member : (n_owners, n_channels) float64
            1 where a channel takes its entries from an owner.
        sign : (n_channels, m) float64
            With which sign.
        shapes : (n_channels, m) complex128
        amplitudes : (r, m) complex128

        Returns
        -------
        (n_owners, 2 m, 2 m) and (n_owners, r, 2 m, 2 m) float64
        """
        m = shapes.shape[1]
        pairs = (sign[:, :, None] * shapes[:, None]).reshape(len(shapes), -1)
        each = member[:, None] * self.weight  # (n_owners, r, n_channels)
        own = (each @ pairs).reshape(*each.shape[:2], m, m)
        left = amplitudes[:, :, None]
        across, along = left.conj() * own, left * own
        mixed, plain = self._of(0, 0)
        by_runs = real_block(across * mixed, along * plain)
        mixed, plain = self._of(0, 1)
        right = amplitudes[:, None]
        first, second = np.sum(across * right, axis=1), np.sum(along * right, axis=1)
        return real_block(first * mixed, second * plain), by_runs

    def _of(self, left: int, right: int) -> tuple[_Complex, _Complex]:
        """Return the products of exp (0) or t exp (1) with exp or t exp."""
        m = len(self.mixed) // 2
        where = slice(m * left, m * (left + 1)), slice(m * right, m * (right + 1))
        return self.mixed[where], self.plain[where]

    def _pairs(self, shapes: _Complex) -> tuple[_Complex, _Complex]:
        """Return each run's weighted sums over channels of ``conj(s_i) s_j`` and ``s_i s_j``."""
        m = shapes.shape[1]
        left, right = shapes[:, :, None], shapes[:, None]
        across = self.weight @ (left.conj() * right).reshape(len(shapes), -1)
        along = self.weight @ (left * right).reshape(len(shapes), -1)
        return across.reshape(-1, m, m), along.reshape(-1, m, m)
