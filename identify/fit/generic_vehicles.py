"""The vehicles from which a search may start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_MID_SIZE_CAR = np.array(
    [1500, 2500, 500, 40, 40, 20e3, 20e3, 200e3, 200e3, 1500, 1500, 1.3, 1.4, 0.75, 0.75]
)
_INERTIAS = slice(0, 5)
_FORCES = slice(5, 11)


def generic_vehicles() -> tuple[NDArray[np.float64], ...]:
    """Return the vehicles, each (15,), from which a search may start: a car and its variants.

    The variants are lighter, heavier, stiffer and more strongly damped; together they lie within a
    factor of two or three of anything on four wheels that is bumped by hand.
    """
    vehicles = []
    for mass, force in ((1.0, 1.0), (2.0, 2.0), (0.5, 0.5), (1.0, 2.0), (2.0, 1.0), (4.0, 4.0)):
        vehicle = _MID_SIZE_CAR.copy()
        vehicle[_INERTIAS] *= mass
        vehicle[_FORCES] *= force
        vehicles.append(vehicle)
    return tuple(vehicles)
