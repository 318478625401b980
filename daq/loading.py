"""Computes the effect of added weights on a car in closed form, for a person who will bolt them on.

Positions are those of `daq.vehicle`: from the middle of the front axle, x forward, y left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dbc.units import G_M_S2

from .vehicle import (
    FORD_GRANADA,
    BodyWeight,
    Corner,
    FactQuantity,
    HubWeight,
    Vehicle,
    VehicleParameters,
)

Weight = BodyWeight | HubWeight


@dataclass(frozen=True, slots=True)
class Loading:
    """The effect of added weights."""

    body_kg: float
    """Mass on the body, kg."""
    hub_kg: float
    """Mass on the hubs, kg."""
    x_shift_m: float
    """Shift of the CG of the sprung mass, forward, m."""
    y_shift_m: float
    """Shift of the CG of the sprung mass, to the left, m."""
    I_xx: float
    """Added roll inertia about the CG without the weights, kg m2."""
    I_yy: float
    """Added pitch inertia about the CG without the weights, kg m2."""
    front_kg: float
    """Added load of the front axle, as scales show it, kg."""
    rear_kg: float
    """Added load of the rear axle, as scales show it, kg."""


def loading(weights: Sequence[Weight], car: VehicleParameters) -> Loading:
    """Return the effect of weights on a car (docs/method.md, "Added mass")."""
    body = [w for w in weights if isinstance(w, BodyWeight)]
    hubs = [w for w in weights if isinstance(w, HubWeight)]
    body_kg = sum(w.mass_kg for w in body)
    front_kg, rear_kg = axle_loads(body, car.a + car.b)
    return Loading(
        body_kg=body_kg,
        hub_kg=sum(w.mass_kg for w in hubs),
        x_shift_m=sum(w.mass_kg * (w.x_m + car.a) for w in body) / (car.m_s + body_kg),
        y_shift_m=sum(w.mass_kg * w.y_m for w in body) / (car.m_s + body_kg),
        I_xx=sum(w.mass_kg * (w.y_m**2 + w.height_m**2) for w in body),
        I_yy=sum(w.mass_kg * ((w.x_m + car.a) ** 2 + w.height_m**2) for w in body),
        front_kg=front_kg + sum(w.mass_kg for w in hubs if w.corner.front),
        rear_kg=rear_kg + sum(w.mass_kg for w in hubs if not w.corner.front),
    )


def axle_loads(body: Sequence[BodyWeight], wheelbase_m: float) -> tuple[float, float]:
    """Return the load that weights on the body add to the front and the rear axle, kg."""
    rear_kg = sum(w.mass_kg * -w.x_m / wheelbase_m for w in body)
    return sum(w.mass_kg for w in body) - rear_kg, rear_kg


def sag_stiffness(
    weights: Sequence[Weight],
    wheelbase_m: float,
    before_m: Mapping[Corner, float],
    after_m: Mapping[Corner, float],
) -> tuple[float | None, float | None]:
    """Return the stiffness of one front and one rear spring, N/m, from the sinking of the body.

    Weights on hubs do not load the springs of the suspension.

    `before_m` and `after_m`: suspension travel at rest, positive in compression, without and with
    the weights.  None for an axle if a corner has no travel, or did not sink under a load.
    """
    body = [w for w in weights if isinstance(w, BodyWeight)]
    found: list[float | None] = []
    for front, load_kg in zip((True, False), axle_loads(body, wheelbase_m), strict=True):
        corners = [c for c in Corner if c.front is front]
        if not all(c in before_m and c in after_m for c in corners):
            found.append(None)
            continue
        sum_m = sum(after_m[c] - before_m[c] for c in corners)
        stiffness = load_kg * G_M_S2 / sum_m if sum_m else 0.0
        found.append(stiffness if stiffness > 0.0 else None)
    return found[0], found[1]


def expected_car(vehicle: Vehicle) -> VehicleParameters:
    """Return a typical car: that of the paper, scaled to the weighed and measured facts.

    Masses, springs and dampers are proportional to the total mass, so that the frequencies are
    those of a usual car; inertias are also proportional to the square of the lengths.
    """
    known = {fact.quantity: fact.value for fact in vehicle.facts}
    usual = FORD_GRANADA
    usual_kg = usual.m_s + 2.0 * (usual.m_uf + usual.m_ur)
    front_kg = known.get(FactQuantity.FRONT_AXLE)
    rear_kg = known.get(FactQuantity.REAR_AXLE)
    axles_kg = front_kg + rear_kg if front_kg and rear_kg else usual_kg
    size = known.get(FactQuantity.TOTAL_MASS, axles_kg) / usual_kg
    given = vehicle.geometry
    long_m = known.get(FactQuantity.WHEELBASE, given.a + given.b if given else usual.a + usual.b)
    m_uf, m_ur, m_s = size * usual.m_uf, size * usual.m_ur, size * usual.m_s
    share = usual.a / (usual.a + usual.b)
    if front_kg and rear_kg:
        share = min(max((rear_kg - 2.0 * m_ur) / (axles_kg - 2.0 * (m_uf + m_ur)), 0.1), 0.9)
    a, b = share * long_m, (1.0 - share) * long_m
    t_f = known.get(FactQuantity.FRONT_TRACK, 2.0 * usual.t_f) / 2.0
    t_r = known.get(FactQuantity.REAR_TRACK, 2.0 * usual.t_r) / 2.0
    if given:
        a, b, t_f, t_r = given.a, given.b, given.t_f, given.t_r
    wide, deep = (t_f + t_r) / (usual.t_f + usual.t_r), (a * b) / (usual.a * usual.b)
    # The springs of an axle are scaled by the axle's load relative to that of the usual car.
    front = size * (b / (a + b)) / (usual.b / (usual.a + usual.b))
    rear = size * (a / (a + b)) / (usual.a / (usual.a + usual.b))
    return replace(
        usual,
        m_s=m_s,
        I_yy=size * deep * usual.I_yy,
        I_xx=size * wide**2 * usual.I_xx,
        m_uf=m_uf,
        m_ur=m_ur,
        k_sf=front * usual.k_sf,
        k_sr=rear * usual.k_sr,
        k_tf=front * usual.k_tf,
        k_tr=rear * usual.k_tr,
        c_sf=front * usual.c_sf,
        c_sr=rear * usual.c_sr,
        a=a,
        b=b,
        t_f=t_f,
        t_r=t_r,
    )
