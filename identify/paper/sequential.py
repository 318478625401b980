"""Follows the paper's order of estimation: from M, C and K to parameters in three linear steps.

Masses are the diagonal of M.  Stiffnesses and damping come from those elements of K and C that
hold nothing else, by least squares; then the geometry comes from the elements of K that are linear
in it (paper, section 4.1).  With its Wilson-theta simulation this gives all of the paper's Table 2
to 0.02 percentage points; `physical.nearest_vehicle` uses every element at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import VehicleParameters

from ..model.matrices import N_DOF, PhysicalModel, matrices

_STIFFNESS = slice(5, 9)  # positions among the 15 parameters
_DAMPING = slice(9, 11)
_GEOMETRY = slice(11, 15)


def sequential_vehicle(model: PhysicalModel) -> VehicleParameters:
    """Return the 15 parameters in the order of the paper.

    `model`: M, C and K as identified (Eqs. 30-33).
    """
    theta = np.ones(15)
    masses = np.diag(model.M)
    theta[:5] = (*masses[:3], masses[3:5].mean(), masses[5:].mean())
    theta[_STIFFNESS] = _solved(theta, _STIFFNESS, 2, _without_geometry(), model.K)
    theta[_DAMPING] = _solved(theta, _DAMPING, 1, _without_geometry(), model.C)
    theta[_GEOMETRY] = _solved(theta, _GEOMETRY, 2, _linear_in_geometry(), model.K)
    return VehicleParameters(*(float(value) for value in theta))


def _without_geometry() -> NDArray[np.bool_]:
    """Return which elements of K and C hold no length, (7, 7)."""
    mask = np.eye(N_DOF, dtype=bool)
    mask[0, 3:] = mask[3:, 0] = True
    mask[1, 1] = mask[2, 2] = False
    return mask


def _linear_in_geometry() -> NDArray[np.bool_]:
    """Return which elements of K are linear in the lengths, (7, 7)."""
    mask = np.zeros((N_DOF, N_DOF), dtype=bool)
    mask[1:3, 3:] = mask[1:3, 0] = True
    return mask | mask.T


def _solved(
    theta: NDArray[np.float64],
    unknown: slice,
    which: int,
    mask: NDArray[np.bool_],
    identified: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the unknown parameters, which enter the masked elements linearly, by least squares.

    `theta`, (15,) float64: the other parameters.  `which`: 1 for C, 2 for K, as `matrices` returns
    them.  `mask`, (7, 7) bool: the elements used.  `identified`, (7, 7) float64: the matrix found.
    """
    n = len(theta[unknown])
    base = theta.copy()
    base[unknown] = 0.0
    constant = matrices(base)[which].real[mask]
    columns = []
    for unit in np.eye(n):
        base[unknown] = unit
        columns.append(matrices(base)[which].real[mask] - constant)
    found = np.linalg.lstsq(np.array(columns).T, identified[mask] - constant)[0]
    return np.asarray(found, dtype=np.float64)
