"""Terms that keep a damper's force from falling as the speed grows.

A force that falls as the speed grows feeds energy into the car: no damper does it, and on a mount
such a curve has no finite path.  The data do not prevent this at speeds that hardly occur, so
one-sided terms raise slopes below a floor; slopes above it are not affected.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..elements.damper import secant_share
from ..model.complex_step import COMPLEX_STEP, stepped
from .car import KNEE_M_S, Model

_FLOOR, _FLOOR_SD = 0.02, 0.01
"""Least slope of a damper's curve over its coefficient, and the deviation at which a smaller one
counts."""


def too_flat(
    model: Model, eta: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by how much each segment of the dampers' curves is flatter than the floor.

    `eta`: (P,).  Returns (segments,) float64, front first, in units of the floor's deviation,
    negative where a segment is steeper; and its fall per unit of each unknown, (segments, P).
    Negative values cost nothing.
    """
    shares = _shares(model, stepped(eta))
    return (_FLOOR - shares[0].real) / _FLOOR_SD, shares[1:].imag.T / COMPLEX_STEP / _FLOOR_SD


def _shares(model: Model, eta: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the slope of each segment of both axles' curves over the coefficient, at (n, P)."""
    value = model.element_values(eta)
    full = model.box.full(eta)
    knots = np.array(model.knots)
    share = np.array([secant_share(knot, KNEE_M_S) for knot in model.knots])
    # A knot acts at all speeds beyond it, outwards from rest; a knot at 0 acts in compression.
    edges = np.concatenate([knots, [0.0]])
    middle = np.sort(np.unique(edges))
    speeds = np.concatenate([[middle[0] - 1.0], 0.5 * (middle[1:] + middle[:-1]), [middle[-1] + 1]])
    beyond = np.where(knots < 0.0, speeds[:, None] < knots, speeds[:, None] > knots)
    found = []
    for axle, corner in (("f", 15), ("r", 17)):
        c = 0.5 * (full[:, corner] + full[:, corner + 1])
        h = np.stack([value[f"h_{axle}{j + 1}"] for j in range(len(knots))], axis=1)
        found.append(1.0 + (h / c[:, None]) @ (beyond - share).T)
    return np.concatenate(found, axis=1)
