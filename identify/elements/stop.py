"""The bump stop: a spring that begins at a gap.

Parameters: k_b [N/m] and the gap g [m] of travel from rest, in compression.
"""

from __future__ import annotations

from .hinge import Value, hinge, hinge_slope


def stop_force(u: Value, k_b: Value, gap: Value, width: Value) -> Value:
    """Return the force, N, at the travel u, m; `width` rounds the corner, m."""
    return k_b * hinge(u - gap, width)


def stop_stiffness(u: Value, k_b: Value, gap: Value, width: Value) -> Value:
    """Return the derivative of `stop_force` by u, N/m; by the gap it is the negative."""
    return k_b * hinge_slope(u - gap, width)


def stop_by_rate(u: Value, gap: Value, width: Value) -> Value:
    """Return the derivative of `stop_force` by k_b, m."""
    return hinge(u - gap, width)
