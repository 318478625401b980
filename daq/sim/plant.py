"""Makes a plant of a car with its weights, and computes its forces and its rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..vehicle import AddedMass, BodyWeight, Corner, VehicleParameters
from .elements import ALIKE, NONE, Array, DamperCurve, Imperfections, PerCorner
from .engine import CORNER, STATE, Plant, balances

GRAVITY_M_S2 = 9.80665
_SETTLED_M = 1e-13
"""Change of pose below which a car has settled, m: rounding."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Forces between the parts of the car, each (4, n) in the order of `Corner`."""

    suspension_n: Array
    """Force of spring, stop, damper, bar and friction, N: up on the body, down on the wheel."""
    tyre_n: Array
    """Force of the road on the wheel, N, never negative."""


def per_corner(front: float, rear: float, factor: PerCorner = ALIKE) -> Array:
    """Return a value for each corner, (4, 1): that of its axle times its factor."""
    return np.array([[(front if c.front else rear) * factor[c.position]] for c in Corner])


def load_car(
    parameters: VehicleParameters, added: AddedMass, imperfections: Imperfections = NONE
) -> Plant:
    """Put the added masses on a car.

    `parameters`: the unloaded car.  `added`: weights, which have gravity and inertia; a matrix
    given directly has only inertia.  `imperfections`: effects in addition to the parameters.
    """
    p, i = parameters, imperfections
    front, rear = i.dampers(p)
    dampers = [
        (front if c.front else rear).times(factor)
        for c, factor in zip(Corner, i.damper, strict=True)
    ]
    half_width_m, zero = per_corner(p.t_f, p.t_r), np.zeros((4, 1))
    friction, progression = i.friction, per_corner(*i.tyre_progression_per_m)
    is_progressive = progression > 0.0
    # The force k c (1 + progression c) is least at this c.
    turn_m = -0.5 / np.where(is_progressive, progression, 1.0)
    mass = -inertia_forces(p, added, i, np.eye(7))
    linear = Plant(
        np.zeros(4, CORNER),
        _bends(dampers),
        _gravity(p, added, i),
        np.asarray(np.linalg.inv(mass), dtype=np.float64),
    ).other(
        x_m=per_corner(p.a, -p.b),
        y_m=half_width_m * np.array([[corner.side] for corner in Corner]) - i.cg_offset_m,
        spring_n_m=per_corner(p.k_sf, p.k_sr, i.suspension),
        stop_gap_m=per_corner(*i.stop_gap_m),
        bar_n_m=per_corner(i.bar_front_n_m, i.bar_rear_n_m),
        in_ns_m=np.array([[damper.compression.high_ns_m] for damper in dampers]),
        in_knee_n=np.array([[damper.compression.knee_n] for damper in dampers]),
        in_knee_m_s=np.array([[damper.compression.knee_m_s] for damper in dampers]),
        out_ns_m=np.array([[damper.rebound.high_ns_m] for damper in dampers]),
        out_knee_n=np.array([[damper.rebound.knee_n] for damper in dampers]),
        out_knee_m_s=np.array([[damper.rebound.knee_m_s] for damper in dampers]),
        mount_n_m=per_corner(*i.mount_n_m),
        friction_n=per_corner(friction.front_n, friction.rear_n, friction.sides),
        presliding_m=zero + friction.presliding_m,
        surplus=zero + friction.static_ratio - 1.0,
        stribeck_m_s=zero + friction.stribeck_m_s,
        tyre_n_m=per_corner(p.k_tf, p.k_tr, i.tyre),
        tyre_turn_m=np.where(is_progressive, turn_m, -np.inf),
        tyre_ns_m=per_corner(i.tyre_damping_front_ns_m, i.tyre_damping_rear_ns_m),
    )
    # The progressive terms count from the pose of the unloaded car, which has linear springs.
    unloaded = static_pose(linear._replace(weight_n=_gravity(p, AddedMass(), i)))
    return linear.other(
        quadratic_n_m2=per_corner(*i.quadratic_n_m2),
        cubic_n_m3=per_corner(*i.cubic_n_m3),
        stop_n_m=per_corner(*i.stop_n_m),
        tyre_n_m2=per_corner(p.k_tf, p.k_tr, i.tyre) * progression,
        ride_m=unloaded[3:] - corner_motion(linear, unloaded),
        squash_m=-unloaded[3:],
    )


def _bends(dampers: Sequence[DamperCurve]) -> Array:
    """Return the kinks of four dampers as `Plant.bends`, filled up with changes of 0."""
    branches = [(damper.compression, damper.rebound) for damper in dampers]
    most = max(len(branch.bends) for pair in branches for branch in pair)
    bends = np.zeros((4, 2, most, 2))
    for corner, pair in enumerate(branches):
        for direction, branch in enumerate(pair):
            bends[corner, direction, : len(branch.bends)] = np.reshape(branch.bends, (-1, 2))
    return bends


def inertia_forces(
    parameters: VehicleParameters,
    added: AddedMass,
    imperfections: Imperfections,
    acceleration: Array,
) -> Array:
    """Return the forces with which every mass resists an acceleration (d'Alembert).

    Order, axes and signs of the degrees of freedom are those of `daq.vehicle`: heave upwards, pitch
    nose down, roll left side up, then each wheel upwards.

    `parameters`: body and wheels.  `added`: each weight is a point that moves with the body or a
    wheel; its `matrix` of inertia is about the CG of the baseline body.  `imperfections`: unequal
    wheels; the offset of the CG, about which the body turns.  `acceleration`, (7, n) float64.
    Returns (7, n) float64: forces, N, and moments about the CG of the baseline body, N m.
    """
    p, i = parameters, imperfections
    heave, pitch, roll = acceleration[:3]
    force = np.zeros_like(acceleration)
    force[0] = -p.m_s * heave
    force[1] = -p.I_yy * pitch
    force[2] = -p.I_xx * roll
    force[3:] = -per_corner(p.m_uf, p.m_ur, i.wheel) * acceleration[3:]
    for weight in added.weights:
        m = weight.mass_kg
        if isinstance(weight, BodyWeight):
            x, y, h = weight.x_m + p.a, weight.y_m - i.cg_offset_m, weight.height_m
            # Rigid body, r = (x, y, h) from the CG, angular acceleration (roll, pitch, 0): the
            # weight's acceleration is that of the CG plus angular acceleration x r; the moment of
            # its force is r x force.
            force_x = -m * h * pitch
            force_y = m * h * roll
            force_z = -m * (heave - x * pitch + y * roll)
            force[0] += force_z
            force[1] += h * force_x - x * force_z
            force[2] += y * force_z - h * force_y
        else:
            wheel = 3 + weight.corner.position
            force[wheel] -= m * acceleration[wheel]
    return np.asarray(force - added.matrix @ acceleration, dtype=np.float64)


def _gravity(p: VehicleParameters, added: AddedMass, i: Imperfections) -> Array:
    """Return gravity on each degree of freedom, (7, 1): N, and N m about the baseline CG."""
    force = np.zeros((7, 1))
    force[0] = -p.m_s * GRAVITY_M_S2
    force[3:] = -per_corner(p.m_uf, p.m_ur, i.wheel) * GRAVITY_M_S2
    for weight in added.weights:
        pull = -weight.mass_kg * GRAVITY_M_S2
        if isinstance(weight, BodyWeight):
            force[0] += pull
            force[1] -= (weight.x_m + p.a) * pull
            force[2] += (weight.y_m - i.cg_offset_m) * pull
        else:
            force[3 + weight.corner.position] += pull
    return force


def corner_motion(plant: Plant, body: Array) -> Array:
    """Return the heave of the body at the corners, (4, n), from its three motions, (3, n)."""
    return np.asarray(body[0] - plant.column("x_m") * body[1] + plant.column("y_m") * body[2])


def contact(plant: Plant, pose: Array, velocity: Array, road: Array) -> Contact:
    """Return the forces of suspensions and tyres, for poses and velocities (7, n), road (4, n).

    Friction and mounts are unloaded.
    """
    suspension, tyre, _ = balances(plant, _states(pose, velocity), road, np.zeros(road.shape))
    return Contact(suspension, tyre)


def forces(plant: Plant, pose: Array, velocity: Array, road: Array) -> Array:
    """Return the sum of all forces except inertia, (7, n); arguments as for `contact`."""
    states = _states(pose, velocity)
    return np.asarray(balances(plant, states, road, np.zeros(road.shape))[2])


def _states(pose: Array, velocity: Array, friction: Array | None = None) -> Array:
    """Return states (`engine`), (22, n), with unloaded mounts."""
    states = np.zeros((STATE, pose.shape[1]))
    states[:7], states[7:14] = pose, velocity
    states[14:18] = 0.0 if friction is None else friction
    return states


def static_pose(
    plant: Plant,
    friction: Array | None = None,
    road: Array | None = None,
    load: Array | None = None,
) -> Array:
    """Return the pose of a car at rest, (7, 1), from the free length of all springs.

    `friction`, (4, 1): share of its sliding friction that each corner carries; default: none, the
    car has settled.  `road`, (4, 1): height under each wheel, m; default: flat.  `load`, (7, 1):
    further forces, N and N m.  Raises ValueError if the car does not stand on all four wheels (the
    weights would tip it over).
    """
    height = np.zeros((4, 1)) if road is None else road
    zero = np.zeros((4, 1))
    linear = plant.other(quadratic_n_m2=zero, cubic_n_m3=zero, stop_n_m=zero, tyre_n_m2=zero)
    # The linear car first, far enough down for every tyre to touch: Newton's first step is exact
    # there, and the next removes rounding.  It is close enough for the real springs.
    pose = np.full((7, 1), -1.0)
    pose[1:3] = 0.0
    for car, step, most_iterations in ((linear, -0.1, 3), (plant, -1e-6, 20)):
        for _ in range(most_iterations):
            poses = np.hstack([pose, pose + step * np.eye(7)])  # then each coordinate moved alone
            states = _states(poses, np.zeros((7, 8)), friction)
            force = balances(car, states, np.repeat(height, 8, axis=1), np.zeros((4, 8)))[2]
            force = force if load is None else force + load
            slope = (force[:, 1:] - force[:, :1]) / step
            change = np.linalg.solve(slope, force[:, :1])
            pose = pose - change
            if np.abs(change).max() < _SETTLED_M:
                break
        if np.any(pose[3:] >= height):
            raise ValueError("a wheel is off the ground at rest: the weights are too far out")
    return np.asarray(pose, dtype=np.float64)
