"""Describes the car as nodes and lines that modal analysis programs draw.

Metres from the middle of the front axle: x forward, y left, z up.  The method does not use heights;
hubs are drawn at 0 and the body at `BODY_HEIGHT_M`.  Nodes are 1..4 the body over the wheels FL FR
RL RR, 5 the CG, 11..14 the hubs, and from 101 the sensors on the body in the channels' order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...channels import ON_BODY, Channel, Quantity
from ...vehicle import Corner, FactQuantity, Vehicle, VehicleGeometry

BODY_HEIGHT_M = 0.5
_BODY, _CG, _HUB, _SENSOR = 1, 5, 11, 101
_Z, _ABOUT_X, _ABOUT_Y = 3, 4, 5
"""Directions of universal files."""

Nodes = Mapping[int, tuple[float, float, float]]
"""Positions x, y, z, m, by number."""
LINES = {
    "body": (1, 2, 4, 3, 1),
    "suspension": (1, 11, 0, 2, 12, 0, 3, 13, 0, 4, 14),
    "axles": (11, 12, 0, 13, 14),
}
"""Nodes of the lines to draw, by name; 0 lifts the pen."""


def car_nodes(vehicle: Vehicle, channels: Sequence[Channel]) -> Nodes:
    """Return the nodes of a car and its sensors; none if the wheel positions are not known.

    Wheelbase and tracks are those of the geometry or of the facts; facts do not state the CG.
    """
    facts = {fact.quantity: fact.value for fact in vehicle.facts}
    names = (FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK)
    nodes: dict[int, tuple[float, float, float]] = {}
    if vehicle.geometry is not None:
        g = vehicle.geometry
        base_m, half_m = g.a + g.b, (g.t_f, g.t_r)
        nodes[_CG] = (-g.a, 0.0, BODY_HEIGHT_M)
    elif all(name in facts for name in names):
        base_m, front_m, rear_m = (facts[name] for name in names)
        half_m = front_m / 2.0, rear_m / 2.0
    else:
        return {}
    for i, corner in enumerate(Corner):
        x_m = 0.0 if corner.front else -base_m
        y_m = corner.side * half_m[0 if corner.front else 1]
        nodes[_BODY + i] = (x_m, y_m, BODY_HEIGHT_M)
        nodes[_HUB + i] = (x_m, y_m, 0.0)
    for i, channel in enumerate(channels):
        if channel.quantity in ON_BODY and not channel.at_cg:
            nodes[_SENSOR + i] = (channel.x_m, channel.y_m, BODY_HEIGHT_M)
    return dict(sorted(nodes.items()))


def place_of(number: int, channel: Channel) -> tuple[int, int, int]:
    """Return node and direction of a channel, and the node that its motion is relative to.

    A node or direction that is not known, and the ground, are 0.  `number`: position of the channel
    among those of the session.
    """
    if channel.corner is not None:
        relative = channel.quantity is Quantity.SUSPENSION_TRAVEL
        i = channel.corner.position
        return _HUB + i, _Z, _BODY + i if relative else 0
    if channel.quantity in ON_BODY:
        return _CG if channel.at_cg else _SENSOR + number, _Z, 0
    if channel.quantity in (Quantity.PITCH_RATE, Quantity.PITCH_ACCELERATION):
        return _CG, _ABOUT_Y, 0
    if channel.quantity in (Quantity.ROLL_RATE, Quantity.ROLL_ACCELERATION):
        return _CG, _ABOUT_X, 0
    return 0, 0, 0


def vertical_motion(
    nodes: Nodes, shape: NDArray[np.complex128], geometry: VehicleGeometry
) -> dict[int, complex]:
    """Return the vertical motion of each node in a mode.

    `shape`, (7,): motion of `daq.vehicle.DOF`.  ``z_s - x theta + y phi`` with x and y from the CG
    for the body, the wheels' heave for hubs.
    """
    z, theta, phi, *hubs = shape.tolist()
    return {
        label: hubs[label - _HUB]
        if _HUB <= label < _HUB + 4
        else z - (x_m + geometry.a) * theta + y_m * phi
        for label, (x_m, y_m, _) in nodes.items()
    }
