"""Least squares of a few unknowns (Levenberg and Marquardt).

`scipy.optimize` has it too, but would take longer to import than a session takes to be fitted.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_MAX_STEPS = 100
"""Ten usually suffice; a fit that needs more wanders among matrices that belong to no vehicle."""
_SAME = 1e-12
"""Change of the unknowns, relative to their size, below which a step is the last."""
_DAMPING = 1e-6

_Real = NDArray[np.float64]


def least_squares(
    residuals: Callable[[_Real], _Real], jacobian: Callable[[_Real], _Real], start: _Real
) -> _Real | None:
    """Return the unknowns, (p,), of the least sum of squares near a start; None if none is found.

    `residuals`: of (p,), (n,).  `jacobian`: their derivatives, (n, p).
    """
    here, left, slopes, damping = start, residuals(start), jacobian(start), _DAMPING
    for _ in range(_MAX_STEPS):
        size = np.linalg.norm(slopes, axis=0)
        held = np.vstack([slopes, np.diag(np.sqrt(damping) * size)])
        step = -np.linalg.lstsq(held, np.concatenate([left, np.zeros(len(here))]))[0]
        trial = residuals(here + step)
        small = np.linalg.norm(step) <= _SAME * np.linalg.norm(here)
        if trial @ trial <= left @ left:
            here, left, damping = here + step, trial, damping / 10.0
            slopes = jacobian(here)
        else:
            damping *= 10.0
        if small:
            return here
    return None
