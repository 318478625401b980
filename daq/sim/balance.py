"""Computes the balance of forces on each degree of freedom, from pose and velocity.

If friction and mounts remember their past, this memory is part of the state; without it a corner
has no friction and a damper has the speed of its corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .plant import Array, Memory, Plant, corner_motion

_ACROSS = [1, 0, 3, 2]
"""Index of the other corner of the same axle."""
_SETTLED_M = 1e-13
"""Change of pose below which a car has settled, m: rounding."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Forces between the parts of the car, each (4, n) in the order of `Corner`."""

    suspension_n: Array
    """Force of spring, stop, damper, bar and friction, N: up on the body, down on the wheel."""
    tyre_n: Array
    """Force of the road on the wheel, N, never negative."""


def contact(
    plant: Plant,
    pose: Array,
    velocity: Array,
    road: Array,
    road_speed: Array | float = 0.0,
    memory: Memory | None = None,
) -> Contact:
    """Return the forces of springs, stops, dampers, bars, friction and tyres.

    `pose` and `velocity`, (7, n) float64: state, from the free length of all springs.  `road`, (4,
    n) float64: height of the road under each wheel, m.  `road_speed`, (4, n) float64 or 0: vertical
    speed of the road there, m/s; only used for tyre damping.  `memory`: state of friction and
    mounts.
    """
    compression = pose[3:] - corner_motion(plant, pose)
    damper_n = damping(plant, velocity, memory)
    suspension = plant.suspension_n_m * compression + damper_n
    suspension += plant.bar_n_m * (compression - compression[_ACROSS])
    if memory is not None:
        suspension += plant.friction.force_n * memory.friction
    squash = road - pose[3:]
    tyre = plant.tyre_n_m * squash
    if plant.progression is not None:
        suspension += plant.progression.suspension_n(compression)
        tyre += plant.progression.tyre_n(squash)
    damped = tyre + plant.tyre_damping_ns_m * (road_speed - velocity[3:])
    # In the air a tyre has no force, however fast it comes down.
    return Contact(suspension, np.maximum(damped, 0.0) * (tyre > 0.0))


def damping(plant: Plant, velocity: Array, memory: Memory | None) -> Array:
    """Return the force of each damper, from its law or from its mount, N, (4, n)."""
    if memory is None or plant.mounts is None:
        return plant.damper.force(velocity[3:] - corner_motion(plant, velocity))
    held = plant.mounts.stiffness_n_m * memory.mount_m
    if plant.mounts.elastic.all():
        return held
    rigid = plant.damper.force(velocity[3:] - corner_motion(plant, velocity))
    return np.where(plant.mounts.elastic, held, rigid)


def forces(
    plant: Plant,
    pose: Array,
    velocity: Array,
    road: Array,
    road_speed: Array | float = 0.0,
    memory: Memory | None = None,
) -> Array:
    """Return the sum of all forces except inertia, (7, n); the arguments are those of `contact`."""
    act = contact(plant, pose, velocity, road, road_speed, memory)
    total = np.empty(pose.shape)
    total[0] = act.suspension_n.sum(axis=0)
    total[1] = -(plant.corner_x_m * act.suspension_n).sum(axis=0)
    total[2] = (plant.corner_y_m * act.suspension_n).sum(axis=0)
    total[3:] = act.tyre_n - act.suspension_n
    total += plant.weight_n
    return total


def static_pose(plant: Plant, memory: Memory | None = None) -> Array:
    """Return the pose of a car at rest on a flat road, (7, 1), from the free length of all springs.

    `memory`: state of its friction; without it the car has settled without friction.  Raises
    ValueError if it does not stand on all four wheels (the weights would tip it over).
    """
    still, flat = np.zeros((7, 1)), np.zeros((4, 1))
    straight = plant.progression is None
    # Far enough down for every tyre to touch.  If all springs are linear, Newton's first step is
    # exact and the second only removes rounding.
    pose, reach = np.full((7, 1), -1.0), 0.1
    pose[1:3] = 0.0
    if plant.progression is not None:
        pose, reach = plant.progression.pose, 1e-6
    for _ in range(3 if straight else 20):
        balance = forces(plant, pose, still, flat, memory=memory)
        step = -reach * np.eye(7)
        slope = (forces(plant, pose + step, still, flat, memory=memory) - balance) / -reach
        change = np.linalg.solve(slope, balance)
        pose = pose - change
        if not straight and np.abs(change).max() < _SETTLED_M:
            break
    if np.any(pose[3:] >= 0.0):
        raise ValueError("a wheel is off the ground at rest: the weights are too far out")
    return np.asarray(pose, dtype=np.float64)
