"""The hinge: zero on one side, a line on the other, rounded by a parabola between.

Beyond its rounding it is exact, so that a hinge which is never reached leaves no trace.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Value = Any
"""A float64 scalar or array: the formulas of the elements take and return either."""


def hinge(x: Value, width: Value) -> Value:
    """Return 0 below -width, x above width, and a parabola between."""
    inside = np.minimum(np.maximum(x, -width), width) + width
    return inside * inside / (4.0 * width) + np.maximum(x - width, 0.0)


def hinge_slope(x: Value, width: Value) -> Value:
    """Return the derivative of `hinge` by x, 0..1."""
    return (np.minimum(np.maximum(x, -width), width) + width) / (2.0 * width)


def hinge_bend(x: Value, width: Value) -> Value:
    """Return the second derivative of `hinge` by x: that of its parabola, and 0 beyond."""
    return (np.abs(x) < width) / (2.0 * width)
