"""Makes a plant of a car with masses: parameters and imperfections, corner by corner."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..vehicle import AddedMass, Corner, VehicleParameters
from .balance import static_pose
from .dampers import damper_law
from .friction import FrictionLaw
from .imperfections import NONE, Friction, Imperfections
from .masses import gravity, inertia_forces, per_corner
from .plant import Array, Mounts, Plant, Progression, corner_motion


def load_car(
    parameters: VehicleParameters, added: AddedMass, imperfections: Imperfections = NONE
) -> Plant:
    """Put the added masses on a car.

    `parameters`: the unloaded car.  `added`: weights, which have gravity and inertia; a matrix
    given directly has only inertia.  `imperfections`: effects in addition to the parameters.
    """
    p, i = parameters, imperfections
    inertia = -inertia_forces(p, added, i, np.eye(7))
    front, rear = i.dampers(p)
    corner_x_m = np.array([[p.a if corner.front else -p.b] for corner in Corner])
    half_width_m = np.array([[p.t_f if corner.front else p.t_r] for corner in Corner])
    rubbing = i.friction
    plant = Plant(
        corner_x_m=corner_x_m,
        corner_y_m=half_width_m * np.array([[corner.side] for corner in Corner]) - i.cg_offset_m,
        suspension_n_m=per_corner(p.k_sf, p.k_sr, i.suspension),
        bar_n_m=per_corner(i.bar_front_n_m, i.bar_rear_n_m),
        damper=damper_law([front, front, rear, rear], i.damper),
        friction=FrictionLaw(
            force_n=per_corner(rubbing.front_n, rubbing.rear_n, rubbing.sides),
            presliding_m=np.full((4, 1), rubbing.presliding_m),
            surplus=_surplus(rubbing),
            stribeck_m_s=np.full((4, 1), rubbing.stribeck_m_s),
        ),
        mounts=_mounts(i),
        tyre_n_m=per_corner(p.k_tf, p.k_tr, i.tyre),
        tyre_damping_ns_m=per_corner(i.tyre_damping_front_ns_m, i.tyre_damping_rear_ns_m),
        weight_n=gravity(p, added, i),
        inertia=inertia,
        mobility=np.asarray(np.linalg.inv(inertia), dtype=np.float64),
    )
    return replace(plant, progression=_progression(p, i, plant))


def _surplus(friction: Friction) -> Array | None:
    if friction.static_ratio == 1.0:
        return None
    return np.full((4, 1), friction.static_ratio - 1.0)


def _mounts(i: Imperfections) -> Mounts | None:
    stiffness = per_corner(*i.mount_n_m)
    elastic = np.isfinite(stiffness)
    return Mounts(np.where(elastic, stiffness, 0.0), elastic) if elastic.any() else None


def _progression(p: VehicleParameters, i: Imperfections, plant: Plant) -> Progression | None:
    """Return the progressive elements of a car, None if there are none."""
    bent = (i.quadratic_n_m2, i.cubic_n_m3, i.stop_n_m, i.tyre_progression_per_m)
    if not any(any(pair) for pair in bent):
        return None
    bare = static_pose(replace(plant, weight_n=gravity(p, AddedMass(), i)))
    beta = per_corner(*i.tyre_progression_per_m)
    turn = np.full((4, 1), -np.inf)
    turn[beta > 0.0] = -0.5 / beta[beta > 0.0]
    return Progression(
        pose=bare,
        ride_m=bare[3:] - corner_motion(plant, bare),
        squash_m=-bare[3:],
        quadratic_n_m2=per_corner(*i.quadratic_n_m2),
        cubic_n_m3=per_corner(*i.cubic_n_m3),
        stop_gap_m=per_corner(*i.stop_gap_m),
        stop_n_m=per_corner(*i.stop_n_m),
        tyre_n_m2=plant.tyre_n_m * beta,
        tyre_turn_m=turn,
    )
