"""Derivatives by a complex step (Squire and Trapp 1998): exact, in one evaluation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COMPLEX_STEP = 1e-30
"""Step of the derivatives: without a subtraction, rounding sets no lower limit."""


def stepped(eta: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the point itself and one `COMPLEX_STEP` along each unknown, (P + 1, P)."""
    steps = np.vstack([np.zeros(len(eta)), np.eye(len(eta))])
    return np.asarray(eta + 1j * COMPLEX_STEP * steps)
