"""How a real car departs from the linear, symmetric one: forces that no model knows of.

`load` makes a plant of them, corner by corner.  All are absent by default.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from .dampers import DamperCurve

PerCorner = tuple[float, float, float, float]
"""A figure for each corner, in the order of `daq.vehicle.Corner`."""
PerAxle = tuple[float, float]
"""A figure for a corner of the front axle and of the rear axle."""

ALIKE: PerCorner = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Friction:
    """Dry friction beside the springs (`daq.sim.friction` has the law)."""

    front_n: float = 0.0
    """Sliding friction of a front corner, N."""
    rear_n: float = 0.0
    """Sliding friction of a rear corner, N."""
    presliding_m: float = 0.5e-3
    """Travel over which the rubber and the seals yield before it slides: sliding friction over the
    stiffness at rest, m."""
    static_ratio: float = 1.0
    """Static over sliding friction: 1 is Dahl's law, above 1 that of LuGre."""
    stribeck_m_s: float = 0.01
    """Speed over which static friction falls to sliding friction, m/s."""
    sides: PerCorner = ALIKE
    """Factors on the friction of each corner."""


@dataclass(frozen=True, slots=True)
class Imperfections:
    """Effects in a car that its 15 parameters do not describe."""

    friction: Friction = Friction()
    """Stiction and friction of the suspension."""
    compression: float = 1.0
    """Factor on c_s while the wheel approaches the body; for an axle without a damper curve."""
    rebound: float = 1.0
    """The same while the wheel leaves the body."""
    damper_front: DamperCurve | None = None
    """Force of a front damper against speed; None leaves it straight, with slope c_sf."""
    damper_rear: DamperCurve | None = None
    """The same of a rear damper."""
    mount_n_m: PerAxle = (inf, inf)
    """Stiffness of the rubber between damper and body, in series with the damper, N/m."""
    quadratic_n_m2: PerAxle = (0.0, 0.0)
    """Progressive springs: force by the square of the deflection from the bare car's rest, N/m2."""
    cubic_n_m3: PerAxle = (0.0, 0.0)
    """The same by the cube, N/m3."""
    stop_gap_m: PerAxle = (inf, inf)
    """Compression from the bare car's rest at which the bump stop is touched, m."""
    stop_n_m: PerAxle = (0.0, 0.0)
    """Stiffness of the bump stop, N/m."""
    bar_front_n_m: float = 0.0
    """Anti-roll bar: force on either corner of the front axle by the difference of their suspension
    travels, N/m.  It holds nothing while both wheels travel alike.  A solid axle acts like a bar of
    negative stiffness: its springs stand closer together than its wheels."""
    bar_rear_n_m: float = 0.0
    """The same of the rear axle."""
    tyre_damping_front_ns_m: float = 0.0
    """Damping of each front tyre while it touches the road, N s/m."""
    tyre_damping_rear_ns_m: float = 0.0
    """The same of each rear tyre."""
    tyre_progression_per_m: PerAxle = (0.0, 0.0)
    """Share by which half the stiffness of a tyre grows with each metre of squash beyond that of
    the bare car at rest: force ``k c (1 + this c)``, 1/m."""
    suspension: PerCorner = ALIKE
    """Factors on each corner's spring."""
    damper: PerCorner = ALIKE
    """Factors on each corner's damper."""
    tyre: PerCorner = ALIKE
    """Factors on each corner's tyre stiffness."""
    wheel: PerCorner = ALIKE
    """Factors on each corner's unsprung mass."""
    cg_offset_m: float = 0.0
    """Where the CG of the unloaded body lies to the left of the middle of the car, m."""


NONE = Imperfections()
