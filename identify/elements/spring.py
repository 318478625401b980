"""The suspension spring: linear, progressive and cubic part.

Parameters: k_s [N/m], k_2 [N/m2] (stiffer in compression where positive), k_3 [N/m3].
"""

from __future__ import annotations

from .hinge import Value


def spring_force(u: Value, k_s: Value, k_2: Value, k_3: Value) -> Value:
    """Return the force, N, at the travel u, m; its derivatives by k_s, k_2, k_3 are u, u2, u3."""
    return u * (k_s + u * (k_2 + u * k_3))


def spring_stiffness(u: Value, k_s: Value, k_2: Value, k_3: Value) -> Value:
    """Return the derivative of `spring_force` by u, N/m."""
    return k_s + u * (2.0 * k_2 + 3.0 * k_3 * u)
