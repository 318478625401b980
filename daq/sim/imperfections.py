"""How a real car departs from the linear, symmetric one: forces that no model is told of.

`plant` makes forces of them, corner by corner.  All are absent by default.
"""

from __future__ import annotations

from dataclasses import dataclass

PerCorner = tuple[float, float, float, float]
"""A figure for each corner, in the order of `daq.vehicle.Corner`."""

ALIKE: PerCorner = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Imperfections:
    """What distinguishes a car from its 15 parameters."""

    friction_n: float = 0.0
    """Coulomb friction in the suspension of each corner, N."""
    friction_speed_m_s: float = 0.005
    """Speed over which friction turns round: its force is ``friction_n tanh(speed / this)``, so
    that the equation of motion stays smooth.  Below that speed friction is a strong damper: a car
    that should stick creeps to its level instead, and at rest friction carries nothing."""
    compression: float = 1.0
    rebound: float = 1.0
    """`compression`, `rebound`: factors on the dampers while the wheel approaches the body, and
    while it leaves it."""
    bar_front_n_m: float = 0.0
    bar_rear_n_m: float = 0.0
    """`bar_front_n_m`, `bar_rear_n_m`: anti-roll bars: force on either corner of the axle by the
    difference of their suspension travels, N/m.  A bar holds nothing while both wheels travel
    alike."""
    tyre_damping_front_ns_m: float = 0.0
    tyre_damping_rear_ns_m: float = 0.0
    """`tyre_damping_front_ns_m`, `tyre_damping_rear_ns_m`: damping of each tyre, N s/m, while it
    touches the road."""
    suspension: PerCorner = ALIKE
    damper: PerCorner = ALIKE
    tyre: PerCorner = ALIKE
    wheel: PerCorner = ALIKE
    """Factors on each corner's spring, damper, tyre stiffness and unsprung mass."""
    cg_offset_m: float = 0.0
    """Where the CG of the unloaded body lies to the left of the middle of the car, m."""


NONE = Imperfections()
