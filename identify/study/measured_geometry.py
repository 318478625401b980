"""Follows the paper's order of estimation with measured geometry (its sections 4.2 and 4.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import VehicleGeometry, VehicleParameters

from ..model.matrices import PhysicalModel, matrices

_STIFFNESS = slice(5, 9)  # positions among the 15 parameters
_DAMPING = slice(9, 11)


def vehicle_of_geometry(model: PhysicalModel, geometry: VehicleGeometry) -> VehicleParameters:
    """Return the parameters of a vehicle whose four lengths are measured.

    Masses are the diagonal of M, whatever the lengths.  Stiffnesses and damping enter K and C
    linearly and follow from all their elements by least squares, each element with the same weight:
    this reproduces the paper's Fig. 8; with elements scaled to equal size the figure differs.
    """
    theta = np.zeros(15)
    theta[-4:] = (geometry.a, geometry.b, geometry.t_f, geometry.t_r)
    masses = np.diag(model.M)
    theta[:5] = (*masses[:3], masses[3:5].mean(), masses[5:].mean())
    stiffness, damping = (_slopes(theta, part) for part in (_STIFFNESS, _DAMPING))
    theta[_STIFFNESS] = np.linalg.lstsq(stiffness[2].T, model.K.ravel())[0]
    theta[_DAMPING] = np.linalg.lstsq(damping[1].T, model.C.ravel())[0]
    return VehicleParameters(*(float(value) for value in theta))


def _slopes(theta: NDArray[np.float64], unknown: slice) -> NDArray[np.float64]:
    """Return M, C and K per unit of each unknown, (3, n_unknowns, 49)."""
    slopes = []
    for position in range(unknown.start, unknown.stop):
        unit = np.zeros(15)
        unit[-4:] = theta[-4:]
        unit[position] = 1.0
        slopes.append([matrix.real.ravel() for matrix in matrices(unit)])
    return np.array(slopes).swapaxes(0, 1)
