"""The anti-roll bar of an axle: a force by the difference of the travels of its two corners.

Parameter: k_a [N/m]; negative where the axle itself holds the sides apart (a solid axle).
"""

from __future__ import annotations

from .hinge import Value


def bar_force(u: Value, u_across: Value, k_a: Value) -> Value:
    """Return the force, N, at one corner; its derivative by k_a is the difference of travels."""
    return k_a * (u - u_across)
