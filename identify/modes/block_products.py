"""Products of the derivatives of a modal model, summed over the samples of each block.

Series that are sampled alike share their exponentials: their sums over the samples are the same,
and only the shapes and amplitudes before them differ.  With these taken out of the sums, the work
for a run is elementwise in the modes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .waves import real_block

_Complex = NDArray[np.complex128]
_Real = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Products:
    """All series at one point of the poles, one row for each block of each run."""

    first: NDArray[np.intp]
    """First row of each run, shape (n_runs,); the rows are in the order of the runs."""
    run: NDArray[np.intp]
    """Run of each row, shape (n,)."""
    weight: _Real
    """Inverse variance of each series, zero where the row has none, shape (n, n_channels)."""
    mixed: _Complex
    plain: _Complex
    """`mixed`, `plain`: sums of ``conj(f) g`` and of ``f g`` of the functions ``exp(pole t)`` and
    ``t exp(pole t)`` over the samples of a row, shape (n, 2 m, 2 m)."""

    def run_run(self, shapes: _Complex) -> _Real:
        """Return the products of amplitudes with each other, (n_runs, 2 m, 2 m)."""
        mixed, plain = self._of(0, 0)
        across, along = self._pairs(shapes)
        return real_block(self._by_run(across * mixed), self._by_run(along * plain))

    def pole_run(self, shapes: _Complex, amplitudes: _Complex) -> _Real:
        """Return the products of poles with amplitudes, (n_runs, 2 m, 2 m)."""
        mixed, plain = self._of(1, 0)
        across, along = self._pairs(shapes)
        q = amplitudes[self.run, :, None]
        first, second = q.conj() * across * mixed, q * along * plain
        return real_block(self._by_run(first), self._by_run(second))

    def pole_pole(self, shapes: _Complex, amplitudes: _Complex) -> _Real:
        """Return the products of poles with each other, (2 m, 2 m)."""
        mixed, plain = self._of(1, 1)
        across, along = self._pairs(shapes)
        left, right = amplitudes[self.run, :, None], amplitudes[self.run, None]
        first = np.sum(left.conj() * right * across * mixed, axis=0)
        return real_block(first, np.sum(left * right * along * plain, axis=0))

    def shape_shape(self, member: _Real, sign: _Real, amplitudes: _Complex) -> _Real:
        """Return the products of each owner's entries with each other, (n_owners, 2 m, 2 m).

        `member` and `sign` as in `with_shapes`.
        """
        mixed, plain = self._of(0, 0)
        m = sign.shape[1]
        left, right = amplitudes[self.run, :, None], amplitudes[self.run, None]
        pairs = (sign[:, :, None] * sign[:, None]).reshape(len(sign), -1)
        own = self._owned(member, pairs)  # (n_owners, n, m m)
        first = np.einsum("gnp,np->gp", own, (left.conj() * right * mixed).reshape(-1, m * m))
        second = np.einsum("gnp,np->gp", own, (left * right * plain).reshape(-1, m * m))
        return real_block(first.reshape(-1, m, m), second.reshape(-1, m, m))

    def with_shapes(
        self, member: _Real, sign: _Real, shapes: _Complex, amplitudes: _Complex
    ) -> tuple[_Real, _Real]:
        """Return the products of each owner's entries with poles and with amplitudes.

        Parameters
        ----------
        member : (n_owners, n_channels) float64
            1 where a channel takes its entries from an owner.
        sign : (n_channels, m) float64
            Sign with which it takes them.
        shapes : (n_channels, m) complex128
        amplitudes : (n_runs, m) complex128

        Returns
        -------
        (n_owners, 2 m, 2 m) and (n_owners, n_runs, 2 m, 2 m) float64
        """
        m = shapes.shape[1]
        pairs = (sign[:, :, None] * shapes[:, None]).reshape(len(shapes), -1)
        own = self._owned(member, pairs).reshape(len(member), -1, m, m)
        left, right = amplitudes[self.run, :, None], amplitudes[self.run, None]
        across, along = left.conj() * own, left * own
        mixed, plain = self._of(0, 0)
        by_runs = real_block(
            np.add.reduceat(across * mixed, self.first, axis=1),
            np.add.reduceat(along * plain, self.first, axis=1),
        )
        mixed, plain = self._of(0, 1)
        first = np.sum(across * (right * mixed), axis=1)
        return real_block(first, np.sum(along * (right * plain), axis=1)), by_runs

    def _of(self, left: int, right: int) -> tuple[_Complex, _Complex]:
        """Return the products of exp (0) or t exp (1) with exp or t exp."""
        m = self.mixed.shape[1] // 2
        where = slice(None), slice(m * left, m * (left + 1)), slice(m * right, m * (right + 1))
        return self.mixed[where], self.plain[where]

    def _pairs(self, shapes: _Complex) -> tuple[_Complex, _Complex]:
        """Return each row's weighted sums over channels of ``conj(s_i) s_j`` and ``s_i s_j``."""
        m = shapes.shape[1]
        left, right = shapes[:, :, None], shapes[:, None]
        across = self.weight @ (left.conj() * right).reshape(len(shapes), -1)
        along = self.weight @ (left * right).reshape(len(shapes), -1)
        return across.reshape(-1, m, m), along.reshape(-1, m, m)

    def _owned(self, member: _Real, pairs: NDArray[Any]) -> NDArray[Any]:
        """Return weighted sums of pairs, (n_channels, k), over each owner's channels and row."""
        each = member[:, None] * self.weight
        return np.asarray((each.reshape(-1, each.shape[-1]) @ pairs).reshape(*each.shape[:2], -1))

    def _by_run(self, rows: _Complex) -> _Complex:
        return np.add.reduceat(rows, self.first, axis=0)
