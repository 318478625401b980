"""The damper: a curve of straight segments with rounded knees.

Parameters: c [N s/m], the slope before all knees; h_j [N s/m], by how much the slope grows where
the speed passes knot j outwards (from rebound to compression at a knot of 0).  With the secant
between `SECANT_M_S` instead of c, no h_j changes the reported coefficient.
"""

from __future__ import annotations

from .hinge import Value, hinge, hinge_slope

SECANT_M_S = 0.1
"""Speed, m/s, between whose negative and positive value a damper's coefficient is the secant:
the lowest that the usual tables of dampers state."""


def knee(w: Value, knot: Value, width: Value) -> Value:
    """Return the speed beyond a knot, m/s: 0 at rest; a knot below 0 acts towards rebound."""
    if knot < 0.0:
        return hinge(knot, width) - hinge(knot - w, width)
    return hinge(w - knot, width) - hinge(-knot, width)


def knee_slope(w: Value, knot: Value, width: Value) -> Value:
    """Return the derivative of `knee` by w, 0..1."""
    if knot < 0.0:
        return hinge_slope(knot - w, width)
    return hinge_slope(w - knot, width)


def secant_share(knot: float, width: float) -> float:
    """Return by how much one unit of h_j raises the secant between +-`SECANT_M_S`."""
    rise = knee(SECANT_M_S, knot, width) - knee(-SECANT_M_S, knot, width)
    return float(rise / (2.0 * SECANT_M_S))
