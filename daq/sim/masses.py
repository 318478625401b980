"""Computes inertia and weight of the masses of the car."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..vehicle import AddedMass, BodyWeight, Corner, VehicleParameters
from .imperfections import ALIKE, Imperfections, PerCorner

GRAVITY_M_S2 = 9.80665

Array = NDArray[np.float64]


def per_corner(front: float, rear: float, factor: PerCorner = ALIKE) -> Array:
    """Return a value for each corner, (4, 1): that of its axle times its factor."""
    return np.array([[(front if c.front else rear) * factor[c.position]] for c in Corner])


def inertia_forces(
    parameters: VehicleParameters,
    added: AddedMass,
    imperfections: Imperfections,
    acceleration: Array,
) -> Array:
    """Return the forces with which every mass resists an acceleration (d'Alembert).

    `parameters`: body and wheels.  `added`: each weight on the body is a point that moves with the
    body.  `imperfections`: unequal wheels; the offset of the CG, about which the body turns.
    `acceleration`, (7, n) float64: of the degrees of freedom.  Returns (7, n) float64: forces, N,
    and moments about the CG of the baseline body, N m.
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


def gravity(parameters: VehicleParameters, added: AddedMass, imperfections: Imperfections) -> Array:
    """Return gravity on each degree of freedom, (7, 1): N, and N m about the baseline CG."""
    p, i = parameters, imperfections
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
