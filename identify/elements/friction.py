"""Dry friction by Dahl's law: it sticks over a short length, then slides at a constant force.

Parameters: F_c [N], the sliding force; d [m], the pre-sliding length (rubber of the top mount,
lip of the seal).  State: zeta, the share of F_c that acts, -1..1.  The law in this form
(Clavel, Sorine and Zhang) keeps its memory at reversals, has no stiff term at rest and needs no
events; at F_c = 0 its derivative by F_c exists.
"""

from __future__ import annotations

import numpy as np

from .hinge import Value


def rounded_speed(w: Value, width: Value) -> Value:
    """Return the speed without its sign, rounded at rest, m/s."""
    return np.sqrt(w * w + width * width)


def friction_rate(w: Value, zeta: Value, length: Value, width: Value, lag_s: Value) -> Value:
    """Return the rate of change of zeta, 1/s; `lag_s` bounds how fast it may turn."""
    speed = rounded_speed(w, width)
    return (w - speed * zeta) / (length + lag_s * speed)


def friction_rate_by_speed(
    w: Value, zeta: Value, length: Value, width: Value, lag_s: Value
) -> Value:
    """Return the derivative of `friction_rate` by w, 1/m."""
    speed = rounded_speed(w, width)
    turn = w / speed
    below = length + lag_s * speed
    return (1.0 - turn * zeta - (w - speed * zeta) / below * lag_s * turn) / below


def friction_rate_by_share(w: Value, length: Value, width: Value, lag_s: Value) -> Value:
    """Return the derivative of `friction_rate` by zeta, 1/s."""
    speed = rounded_speed(w, width)
    return -speed / (length + lag_s * speed)


def friction_rate_by_length(
    w: Value, zeta: Value, length: Value, width: Value, lag_s: Value
) -> Value:
    """Return the derivative of `friction_rate` by d, 1/(m s)."""
    speed = rounded_speed(w, width)
    below = length + lag_s * speed
    return -(w - speed * zeta) / (below * below)
