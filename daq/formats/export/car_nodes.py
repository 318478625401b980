"""Describes the car as nodes and lines that modal analysis programs draw.

Metres from the middle of the front axle: x forward, y left, z up.  The method does not use heights;
hubs are drawn at 0 and the body at `BODY_HEIGHT_M`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...channels import ON_BODY, Channel, Quantity
from ...vehicle import Corner, FactQuantity, Vehicle, VehicleGeometry

BODY_HEIGHT_M = 0.5
CG_NODE = 5
FIRST_BODY_NODE, FIRST_HUB_NODE, FIRST_SENSOR_NODE = 1, 11, 101
X, Y, Z, ABOUT_X, ABOUT_Y = 1, 2, 3, 4, 5
"""Directions of universal files."""


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a channel: a node, a direction, and the reference node of the motion."""

    node: int
    """Number of the node; 0 if it is not known."""
    direction: int
    """Direction of a universal file; 0 if it is not known."""
    against: int = 0
    """Node that the motion is relative to; 0 for the ground."""


@dataclass(frozen=True, slots=True)
class CarNodes:
    """The nodes of a car."""

    labels: NDArray[np.int64]
    """1..4 the body over the wheels FL FR RL RR, 5 the CG, 11..14 the hubs, from 101 the sensors on
    the body, in the order of the channels, shape (n,)."""
    positions_m: NDArray[np.float64]
    """Positions x, y, z, m, shape (n, 3)."""


def wheel_places(vehicle: Vehicle) -> tuple[float, float, float, float] | None:
    """Return `a`, wheelbase and half tracks, m, if they are known; `a` is NaN without geometry."""
    if vehicle.geometry is not None:
        g = vehicle.geometry
        return g.a, g.a + g.b, g.t_f, g.t_r
    facts = {fact.quantity: fact.value for fact in vehicle.facts}
    names = (FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK)
    if not all(name in facts for name in names):
        return None
    base, front, rear = (facts[name] for name in names)
    return float("nan"), base, front / 2.0, rear / 2.0


def car_nodes(vehicle: Vehicle, channels: Sequence[Channel]) -> CarNodes | None:
    """Return the nodes of a car and its sensors; None if the wheel positions are not known."""
    known = wheel_places(vehicle)
    if known is None:
        return None
    a_m, base_m, *half_m = known
    wheels = [(0.0 if c.front else -base_m, c.side * half_m[0 if c.front else 1]) for c in Corner]
    rows = [(FIRST_BODY_NODE + i, *wheels[i], BODY_HEIGHT_M) for i in range(4)]
    if np.isfinite(a_m):
        rows.append((CG_NODE, -a_m, 0.0, BODY_HEIGHT_M))
    rows += [(FIRST_HUB_NODE + i, *wheels[i], 0.0) for i in range(4)]
    for i, channel in enumerate(channels):
        if channel.quantity in ON_BODY and not channel.at_cg:
            rows.append((FIRST_SENSOR_NODE + i, channel.x_m, channel.y_m, BODY_HEIGHT_M))
    table = np.array(rows)
    return CarNodes(table[:, 0].astype(np.int64), table[:, 1:])


def car_lines() -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Return the lines to draw, by name; 0 lifts the pen."""
    body, hub = FIRST_BODY_NODE, FIRST_HUB_NODE
    legs = [node for i in range(4) for node in (0, body + i, hub + i)][1:]
    return (
        ("body", (body, body + 1, body + 3, body + 2, body)),
        ("suspension", tuple(legs)),
        ("axles", (hub, hub + 1, 0, hub + 2, hub + 3)),
    )


def place_of(number: int, channel: Channel) -> Place:
    """Return the place of a channel.

    `number`: its position among the channels of the session.
    """
    if channel.corner is not None:
        hub = FIRST_HUB_NODE + channel.corner.position
        relative = channel.quantity is Quantity.SUSPENSION_TRAVEL
        return Place(hub, Z, FIRST_BODY_NODE + channel.corner.position if relative else 0)
    if channel.quantity in ON_BODY:
        return Place(CG_NODE if channel.at_cg else FIRST_SENSOR_NODE + number, Z)
    if channel.quantity in (Quantity.PITCH_RATE, Quantity.PITCH_ACCELERATION):
        return Place(CG_NODE, ABOUT_Y)
    if channel.quantity in (Quantity.ROLL_RATE, Quantity.ROLL_ACCELERATION):
        return Place(CG_NODE, ABOUT_X)
    return Place(0, 0)


def vertical_motion(
    nodes: CarNodes, shapes: NDArray[np.complex128], geometry: VehicleGeometry
) -> NDArray[np.complex128]:
    """Return the vertical motion of nodes for motions of the degrees of freedom.

    `nodes`: n nodes.  `shapes`, (7, m) complex128: motion of `daq.vehicle.DOF`, one column for each
    mode.  `geometry`: states the position of the CG.  Returns (n, m) complex128: ``z_s - x theta +
    y phi`` with x and y from the CG for the body, the wheels' heave for hubs.
    """
    motion = np.zeros((len(nodes.labels), shapes.shape[1]), complex)
    for i, (label, (x_m, y_m, _)) in enumerate(zip(nodes.labels, nodes.positions_m, strict=True)):
        if FIRST_HUB_NODE <= label < FIRST_HUB_NODE + 4:
            motion[i] = shapes[3 + label - FIRST_HUB_NODE]
        else:
            motion[i] = shapes[0] - (x_m + geometry.a) * shapes[1] + y_m * shapes[2]
    return motion
