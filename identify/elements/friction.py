"""Dry friction: it sticks over a short length, then slides (Dahl; Canudas de Wit and others).

Parameters: F_c [N], the sliding force; d [m], the pre-sliding length (rubber of the top mount,
lip of the seal); r, by what share of F_c the static force exceeds it, and v [m/s], the speed over
which that surplus falls off (Stribeck).  State: zeta, the share of F_c that acts.  Without surplus
it is Dahl's law, and zeta lies within -1..1.  The law in this form (Clavel, Sorine and Zhang) keeps
its memory at reversals, has no stiff term at rest and needs no events; at F_c = 0 its derivative by
F_c exists.
"""

from __future__ import annotations

import numpy as np

from .hinge import Value


def rounded_speed(w: Value, width: Value) -> Value:
    """Return the speed without its sign, rounded at rest, m/s."""
    return np.sqrt(w * w + width * width)


def sliding_share(w: Value, surplus: Value, fall: Value) -> Value:
    """Return the share of F_c at which it slides steadily at a speed w; `fall` is v, m/s."""
    return 1.0 + surplus * np.exp(-(w * w) / (fall * fall))


def sliding_share_by_speed(w: Value, surplus: Value, fall: Value) -> Value:
    """Return the derivative of `sliding_share` by w, s/m."""
    return -2.0 * w / (fall * fall) * surplus * np.exp(-(w * w) / (fall * fall))


def sliding_share_by_surplus(w: Value, fall: Value) -> Value:
    """Return the derivative of `sliding_share` by r."""
    return np.exp(-(w * w) / (fall * fall))


def sliding_share_by_fall(w: Value, surplus: Value, fall: Value) -> Value:
    """Return the derivative of `sliding_share` by v, s/m."""
    return -w / fall * sliding_share_by_speed(w, surplus, fall)


def friction_rate(
    w: Value, zeta: Value, length: Value, limit: Value, width: Value, lag_s: Value
) -> Value:
    """Return the rate of change of zeta, 1/s.

    `limit`: the share at which it slides.  `lag_s` bounds how fast zeta may turn.
    """
    speed = rounded_speed(w, width)
    return (w - speed * zeta / limit) / (length + lag_s * speed)


def friction_rate_by_speed(
    w: Value, zeta: Value, length: Value, limit: Value, width: Value, lag_s: Value
) -> Value:
    """Return the derivative of `friction_rate` by w at a constant limit, 1/m."""
    speed = rounded_speed(w, width)
    turn = w / speed
    share = zeta / limit
    below = length + lag_s * speed
    return (1.0 - turn * share - (w - speed * share) / below * lag_s * turn) / below


def friction_rate_by_share(
    w: Value, length: Value, limit: Value, width: Value, lag_s: Value
) -> Value:
    """Return the derivative of `friction_rate` by zeta, 1/s."""
    speed = rounded_speed(w, width)
    return -speed / limit / (length + lag_s * speed)


def friction_rate_by_limit(
    w: Value, zeta: Value, length: Value, limit: Value, width: Value, lag_s: Value
) -> Value:
    """Return the derivative of `friction_rate` by the share at which it slides, 1/s."""
    speed = rounded_speed(w, width)
    return speed * zeta / (limit * limit) / (length + lag_s * speed)


def friction_rate_by_length(
    w: Value, zeta: Value, length: Value, limit: Value, width: Value, lag_s: Value
) -> Value:
    """Return the derivative of `friction_rate` by d, 1/(m s)."""
    speed = rounded_speed(w, width)
    below = length + lag_s * speed
    return -(w - speed * zeta / limit) / (below * below)
