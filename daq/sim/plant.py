"""The simulated car: seven degrees of freedom by force balance, spring by spring.

Nothing here is a matrix of Eqs. 3-10; those are assembled in `identify.model.matrices`, and a test
holds that both agree.  Axes and degrees of freedom are those of `daq.vehicle`.  Displacements are
counted from the pose in which every spring and tyre has its free length, so the loads under gravity
come out of the balance instead of being put in.  Rotations are small: lever arms are those of the
level car.  A tyre can only push: where it would have to pull, the wheel is off the ground.
Friction, bars, one-sided dampers and other departures from the linear car are those of
`imperfections`.

Within the arrays of the balance axis 0 is the degree of freedom or the corner and axis 1 is time,
so that one function serves a single instant and a whole record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..vehicle import AddedMass, BodyWeight, Corner, VehicleParameters
from .imperfections import ALIKE, NONE, Imperfections, PerCorner

GRAVITY_M_S2 = 9.80665
_ACROSS = [1, 0, 3, 2]
"""The other corner of the same axle."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Plant:
    """A car in one state of loading, ready for the force balance."""

    corner_x_m: Array
    corner_y_m: Array
    """`corner_x_m`, `corner_y_m`: where suspension and body meet, from the CG of the baseline body,
    shape (4, 1)."""
    suspension_n_m: Array
    bar_n_m: Array
    """`suspension_n_m`, `bar_n_m`: stiffness of each corner's spring and of its axle's anti-roll
    bar, N/m, shape (4, 1)."""
    compression_ns_m: Array
    rebound_ns_m: Array
    """`compression_ns_m`, `rebound_ns_m`: damping of each corner as the wheel approaches the body
    and as it leaves it, N s/m, shape (4, 1)."""
    friction_n: float
    friction_speed_m_s: float
    """`friction_n`, `friction_speed_m_s`: as in `Imperfections`."""
    tyre_n_m: Array
    tyre_damping_ns_m: Array
    """`tyre_n_m`, `tyre_damping_ns_m`: stiffness and damping of each tyre, shape (4, 1)."""
    weight_n: Array
    """Gravity on each degree of freedom: N, and N m about the baseline CG, shape (7, 1)."""
    inertia: Array
    """Minus the inertia forces of unit accelerations, one column each, shape (7, 7); kg, kg m, kg
    m2."""
    mobility: Array
    """Accelerations from forces, the inverse of `inertia`, shape (7, 7)."""

    @property
    def smooth(self) -> bool:
        """Whether no force turns round with the direction of travel."""
        return self.friction_n == 0.0 and np.array_equal(self.compression_ns_m, self.rebound_ns_m)


@dataclass(frozen=True, slots=True)
class Contact:
    """What acts between the parts of the car, each (4, n) in the order of `Corner`."""

    suspension_n: Array
    """Force of spring, damper, bar and friction: up on the body, down on the wheel, shape (4,
    n)."""
    tyre_n: Array
    """Force of the road on the wheel, never negative, shape (4, n)."""


def load_car(
    parameters: VehicleParameters, added: AddedMass, imperfections: Imperfections = NONE
) -> Plant:
    """Put the added masses on a car.

    Parameters
    ----------
    parameters : VehicleParameters
        The unloaded car.
    added : AddedMass
        Weights, which have gravity and inertia; a matrix given directly has inertia only.
    imperfections : Imperfections
        What the car has beyond its parameters.
    """
    p, i = parameters, imperfections
    inertia = -inertia_forces(p, added, i, np.eye(7))
    damper_ns_m = _per_corner(p.c_sf, p.c_sr, i.damper)
    corner_x_m = np.array([[p.a if corner.front else -p.b] for corner in Corner])
    half_width_m = np.array([[p.t_f if corner.front else p.t_r] for corner in Corner])
    return Plant(
        corner_x_m=corner_x_m,
        corner_y_m=half_width_m * np.array([[corner.side] for corner in Corner]) - i.cg_offset_m,
        suspension_n_m=_per_corner(p.k_sf, p.k_sr, i.suspension),
        bar_n_m=_per_corner(i.bar_front_n_m, i.bar_rear_n_m),
        compression_ns_m=i.compression * damper_ns_m,
        rebound_ns_m=i.rebound * damper_ns_m,
        friction_n=i.friction_n,
        friction_speed_m_s=i.friction_speed_m_s,
        tyre_n_m=_per_corner(p.k_tf, p.k_tr, i.tyre),
        tyre_damping_ns_m=_per_corner(i.tyre_damping_front_ns_m, i.tyre_damping_rear_ns_m),
        weight_n=_gravity(p, added, i),
        inertia=inertia,
        mobility=np.asarray(np.linalg.inv(inertia), dtype=np.float64),
    )


def _per_corner(front: float, rear: float, factor: PerCorner = ALIKE) -> Array:
    return np.array([[(front if c.front else rear) * factor[c.position]] for c in Corner])


def inertia_forces(
    parameters: VehicleParameters,
    added: AddedMass,
    imperfections: Imperfections,
    acceleration: Array,
) -> Array:
    """Return the forces with which every mass resists an acceleration (d'Alembert).

    Parameters
    ----------
    parameters : VehicleParameters
        Body and wheels.
    added : AddedMass
        Each weight on the body is a point that the body carries along.
    imperfections : Imperfections
        Unequal wheels; the offset of the CG, about which the body turns.
    acceleration : (7, n) float64
        Of the degrees of freedom.

    Returns
    -------
    (7, n) float64
        Forces, N, and moments about the CG of the baseline body, N m.
    """
    p, i = parameters, imperfections
    heave, pitch, roll = acceleration[:3]
    force = np.zeros_like(acceleration)
    force[0] = -p.m_s * heave
    force[1] = -p.I_yy * pitch
    force[2] = -p.I_xx * roll
    force[3:] = -_per_corner(p.m_uf, p.m_ur, i.wheel) * acceleration[3:]
    for weight in added.weights:
        m = weight.mass_kg
        if isinstance(weight, BodyWeight):
            x, y, h = weight.x_m + p.a, weight.y_m - i.cg_offset_m, weight.height_m
            # Rigid body: the weight's acceleration is that of the CG plus angular acceleration x r.
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


def _gravity(
    parameters: VehicleParameters, added: AddedMass, imperfections: Imperfections
) -> Array:
    p, i = parameters, imperfections
    force = np.zeros((7, 1))
    force[0] = -p.m_s * GRAVITY_M_S2
    force[3:] = -_per_corner(p.m_uf, p.m_ur, i.wheel) * GRAVITY_M_S2
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
    return np.asarray(body[0] - plant.corner_x_m * body[1] + plant.corner_y_m * body[2])


def contact(
    plant: Plant, pose: Array, velocity: Array, road: Array, road_speed: Array | float = 0.0
) -> Contact:
    """Return the forces of springs, dampers, bars, friction and tyres.

    Parameters
    ----------
    plant : Plant
        The car.
    pose, velocity : (7, n) float64
        State, from the free length of all springs.
    road : (4, n) float64
        Height of the road under each wheel, m.
    road_speed : (4, n) float64 or 0
        How fast it rises there, m/s; only tyre damping feels it.
    """
    compression = pose[3:] - corner_motion(plant, pose)
    closing = velocity[3:] - corner_motion(plant, velocity)
    damper_ns_m = np.where(closing > 0.0, plant.compression_ns_m, plant.rebound_ns_m)
    suspension = plant.suspension_n_m * compression + damper_ns_m * closing
    suspension += plant.bar_n_m * (compression - compression[_ACROSS])
    suspension += plant.friction_n * np.tanh(closing / plant.friction_speed_m_s)
    squash = road - pose[3:]
    tyre = plant.tyre_n_m * squash + plant.tyre_damping_ns_m * (road_speed - velocity[3:])
    # In the air a tyre does nothing, however fast it comes down.
    return Contact(suspension, np.maximum(tyre, 0.0) * (squash > 0.0))


def forces(
    plant: Plant, pose: Array, velocity: Array, road: Array, road_speed: Array | float = 0.0
) -> Array:
    """Return the sum of all forces but inertia, (7, n); the arguments are those of `contact`."""
    act = contact(plant, pose, velocity, road, road_speed)
    total = np.empty(pose.shape)
    total[0] = act.suspension_n.sum(axis=0)
    total[1] = -(plant.corner_x_m * act.suspension_n).sum(axis=0)
    total[2] = (plant.corner_y_m * act.suspension_n).sum(axis=0)
    total[3:] = act.tyre_n - act.suspension_n
    total += plant.weight_n
    return total


def static_pose(plant: Plant) -> Array:
    """Return where the car stands on a flat road, (7, 1), from the free length of all springs.

    Raises
    ------
    ValueError
        If it does not stand on all four wheels (the weights would tip it over).
    """
    still, flat = np.zeros((7, 1)), np.zeros((4, 1))
    # Far enough down for every tyre to touch; there the balance is linear, so Newton's first step
    # lands and the second only removes rounding.
    pose = np.full((7, 1), -1.0)
    pose[1:3] = 0.0
    for _ in range(3):
        balance = forces(plant, pose, still, flat)
        step = -0.1 * np.eye(7)
        slope = (forces(plant, pose + step, still, flat) - balance) / -0.1
        pose = pose - np.linalg.solve(slope, balance)
        if np.any(pose[3:] >= 0.0):
            raise ValueError("a wheel is off the ground at rest: the weights lie too far out")
    return np.asarray(pose, dtype=np.float64)
