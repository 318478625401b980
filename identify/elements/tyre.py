"""The tyre: a progressive spring with a little damping that can push and never pull.

Parameters: k_t [N/m] at the static load, beta [1/m] of its progressivity, c_t [N s/m].  It acts
beyond the static load W [N], against which the heave of the wheel is counted.  In the air it does
nothing, however fast it comes down: its damping begins with its load.  `width`: half the range of
load, N, over which it meets and leaves the road.
"""

from __future__ import annotations

from .hinge import Value, hinge, hinge_bend, hinge_slope


def tyre_load(z: Value, k_t: Value, beta: Value, static: Value) -> Value:
    """Return the load of the tyre's spring if it could pull, N, at heave z, m."""
    return static - k_t * z * (1.0 - beta * z)


def tyre_load_by_heave(z: Value, k_t: Value, beta: Value) -> Value:
    """Return the derivative of `tyre_load` by z, N/m."""
    return -k_t * (1.0 - 2.0 * beta * z)


def tyre_grip(load: Value, width: Value) -> Value:
    """Return the share of its damping that acts under a load: 1 on the road, 0 in the air."""
    return hinge_slope(load, width)


def tyre_push(load: Value, v: Value, c_t: Value, width: Value) -> Value:
    """Return spring and damping together, N, while the wheel rises at v, m/s."""
    return load - c_t * v * tyre_grip(load, width)


def tyre_push_by_load(load: Value, v: Value, c_t: Value, width: Value) -> Value:
    """Return the derivative of `tyre_push` by the load."""
    return 1.0 - c_t * v * hinge_bend(load, width)


def tyre_force(push: Value, static: Value, width: Value) -> Value:
    """Return the force of the road on the wheel beyond the static load, N."""
    return hinge(push, width) - static


def tyre_contact(push: Value, width: Value) -> Value:
    """Return the derivative of `tyre_force` by the push: 1 on the road, 0 in the air."""
    return hinge_slope(push, width)
