"""Solves normal equations of arrow form: runs that are coupled only by poles and shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_RIDGE = 1e-13
"""Ridge, relative; it matters only for poles that are equal to rounding."""
_ROUNDING = 1e-16
"""Ridge where the inverse itself is the result: weak shapes must not look better known."""


@dataclass(frozen=True, slots=True)
class System:
    """Normal equations of poles, the amplitudes of each run, and the shapes of each owner.

    Every family has 2 m unknowns, the real parts first.
    """

    pole_pole: NDArray[np.float64]
    """Shape (2 m, 2 m)."""
    pole_run: NDArray[np.float64]
    """Shape (n_runs, 2 m, 2 m), poles along the rows."""
    run_run: NDArray[np.float64]
    """Shape (n_runs, 2 m, 2 m)."""
    shape_pole: NDArray[np.float64]
    """Shape (n_owners, 2 m, 2 m), shapes along the rows."""
    shape_run: NDArray[np.float64]
    """Shape (n_owners, n_runs, 2 m, 2 m), shapes along the rows."""
    shape_shape: NDArray[np.float64]
    """Shape (n_owners, 2 m, 2 m)."""
    by_poles: NDArray[np.float64]
    """Right-hand side of the poles, (2 m,); that of the shapes is zero, as they are the best."""
    by_runs: NDArray[np.float64]
    """Right-hand sides of the amplitudes, (n_runs, 2 m)."""
    free: NDArray[np.bool_]
    """True for the poles (first row) and amplitudes that are free, shape (1 + n_runs, 2 m)."""

    def step(
        self, damping: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the steps of poles (2 m,), amplitudes (n_runs, 2 m) and shapes (n_owners, 2 m).

        `damping` is in units of the diagonal with the shapes projected out.
        """
        added = damping * self._projected_diagonal()
        reduced, target, solved = self._without_runs(added)
        n = self.by_poles.size
        reduced[:n, :n][np.diag_indices(n)] += added[0]
        scale = unit_scale(reduced)
        scaled = reduced * np.multiply.outer(scale, scale)
        scaled[np.diag_indices_from(scaled)] += _RIDGE
        found = scale * np.linalg.solve(scaled, scale * target)
        by_runs = solved[..., -1] - solved[..., :-1] @ found
        return found[:n], np.where(self.free[1:], by_runs, 0.0), found[n:].reshape(-1, n)

    def pole_information(self) -> NDArray[np.float64]:
        """Return the information of the poles, all else projected out, (2 m, 2 m)."""
        size = np.einsum("rii->ri", np.concatenate([self.pole_pole[None], self.run_run]))
        added = np.where(size > 0.0, _ROUNDING * size, 1.0)  # a wave of zeros has no effect
        reduced, _, _ = self._without_runs(added)
        n = self.by_poles.size
        scale = unit_scale(reduced)
        scaled = reduced * np.multiply.outer(scale, scale)
        own = scaled[n:, n:] + _ROUNDING * np.eye(len(scaled) - n)
        left = scaled[:n, :n] - scaled[:n, n:] @ np.linalg.solve(own, scaled[n:, :n])
        return np.asarray(left / np.multiply.outer(scale[:n], scale[:n]))

    def _projected_diagonal(self) -> NDArray[np.float64]:
        """Return the diagonal of poles and amplitudes with the shapes projected out."""
        n_owners, n_runs, n = self.shape_run.shape[:3]
        mixed = np.concatenate([self.shape_pole[:, None], self.shape_run], axis=1)
        mixed = mixed.swapaxes(1, 2).reshape(n_owners, n, -1)
        taken = np.einsum("gij,gij->j", mixed, solve(self.shape_shape, mixed))
        own = np.einsum("rii->ri", np.concatenate([self.pole_pole[None], self.run_run]))
        size = own - taken.reshape(1 + n_runs, n)
        return np.where(self.free & (size > 0.0), size, 1.0)

    def _without_runs(self, added: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Eliminate the amplitudes; `added` (1 + n_runs, 2 m) goes to their diagonals.

        Returns
        -------
        reduced : (n, n) float64
            Normal matrix of poles and shapes, n = 2 m (1 + n_owners).
        target : (n,) float64
            Its right-hand side.
        solved : (n_runs, 2 m, n + 1) float64
            Each run's normal matrix inverted, times its border and its right-hand side.
        """
        n_owners, n_runs, n = self.shape_run.shape[:3]
        poles, runs = self.free[0], self.free[1:]
        border = np.empty((n_runs, n, 1 + n_owners, n))
        border[:, :, 0] = np.where(poles[:, None], self.pole_run, 0.0).swapaxes(1, 2)
        border[:, :, 1:] = self.shape_run.transpose(1, 3, 0, 2)
        border = np.where(runs[:, :, None], border.reshape(n_runs, n, -1), 0.0)
        own = np.where(runs[:, :, None] & runs[:, None], self.run_run, 0.0)
        np.einsum("rii->ri", own)[...] += np.where(runs, added[1:], 1.0)
        gradient = np.where(runs, self.by_runs, 0.0)
        solved = np.linalg.solve(own, np.concatenate([border, gradient[..., None]], axis=-1))
        flat = border.reshape(-1, border.shape[-1])
        taken = flat.T @ solved.reshape(len(flat), -1)
        whole = np.zeros((1 + n_owners, n, 1 + n_owners, n))
        whole[0, :, 0] = np.where(poles[:, None] & poles, self.pole_pole, 0.0) + np.diag(~poles)
        mixed = np.where(poles, self.shape_pole, 0.0)
        ridge = _ridge(self.shape_shape)
        for owner in range(n_owners):
            whole[1 + owner, :, 1 + owner] = self.shape_shape[owner] + ridge[owner] * np.eye(n)
            whole[1 + owner, :, 0], whole[0, :, 1 + owner] = mixed[owner], mixed[owner].T
        reduced = whole.reshape(taken.shape[0], -1) - taken[:, :-1]
        target = np.zeros(len(reduced))
        target[:n] = np.where(poles, self.by_poles, 0.0)
        return reduced, target - taken[:, -1], solved


def unit_scale(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the factors that make the diagonal 1; unknowns without any effect are held fixed."""
    size = np.diag(normal)
    return np.asarray(1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)))


def solve(normal: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve normal equations, stacked."""
    n = normal.shape[-1]
    return np.asarray(np.linalg.solve(normal + _ridge(normal)[..., None, None] * np.eye(n), target))


def _ridge(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    size = np.trace(normal, axis1=-2, axis2=-1) / normal.shape[-1]
    return np.asarray(_RIDGE * size + np.finfo(float).tiny)
