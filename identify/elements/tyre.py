"""The tyre: a progressive spring with a little damping that can push and never pull.

Parameters: k_t [N/m] at the static load, beta [1/m] of its progressivity, c_t [N s/m].  It acts
beyond the static load W [N], against which the heave of the wheel is counted.
"""

from __future__ import annotations

from .hinge import Value, hinge, hinge_slope

LIFT_OFF_N = 20.0
"""Half the range of load, N, over which a tyre leaves the road: small beside any static load."""


def tyre_load(z: Value, v: Value, k_t: Value, beta: Value, c_t: Value, static: Value) -> Value:
    """Return the load that the tyre would carry if it could pull, N, at heave z and speed v."""
    return static - k_t * z * (1.0 - beta * z) - c_t * v


def tyre_force(load: Value, static: Value) -> Value:
    """Return the force of the road on the wheel beyond the static load, N."""
    return hinge(load, LIFT_OFF_N) - static


def tyre_contact(load: Value) -> Value:
    """Return the derivative of `tyre_force` by the load: 1 on the road, 0 in the air."""
    return hinge_slope(load, LIFT_OFF_N)


def tyre_load_by_heave(z: Value, k_t: Value, beta: Value) -> Value:
    """Return the derivative of `tyre_load` by z, N/m."""
    return -k_t * (1.0 - 2.0 * beta * z)
