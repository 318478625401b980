"""Defines how a real car deviates from the linear, symmetric one: forces that no model knows.

`load` makes a plant from them, corner by corner.  All are absent by default.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from ..vehicle import VehicleParameters
from .dampers import DamperCurve, Straight

PerCorner = tuple[float, float, float, float]
"""A value for each corner, in the order of `daq.vehicle.Corner`."""
PerAxle = tuple[float, float]
"""A value for a corner of the front axle and one for the rear axle."""

ALIKE: PerCorner = (1.0, 1.0, 1.0, 1.0)


def means(factors: PerCorner) -> PerAxle:
    """Return the mean of the front corners and that of the rear ones."""
    return 0.5 * (factors[0] + factors[1]), 0.5 * (factors[2] + factors[3])


def half_differences(factors: PerCorner) -> PerAxle:
    """Return half of left minus right, front and rear."""
    return 0.5 * (factors[0] - factors[1]), 0.5 * (factors[2] - factors[3])


@dataclass(frozen=True, slots=True)
class Friction:
    """Dry friction parallel to the springs (`daq.sim.friction` has the law)."""

    front_n: float = 0.0
    """Sliding friction of a front corner, N."""
    rear_n: float = 0.0
    """Sliding friction of a rear corner, N."""
    presliding_m: float = 0.5e-3
    """Travel over which the rubber and the seals yield before sliding, m: ratio of sliding friction
    to the stiffness at rest."""
    static_ratio: float = 1.0
    """Ratio of static to sliding friction: 1 is Dahl's law, above 1 that of LuGre."""
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
    """Factor on c_s while the wheel leaves the body."""
    damper_front: DamperCurve | None = None
    """Force of a front damper by speed; None: linear with slope c_sf."""
    damper_rear: DamperCurve | None = None
    """Force of a rear damper by speed; None: linear with slope c_sr."""
    mount_n_m: PerAxle = (inf, inf)
    """Stiffness of the rubber between damper and body, in series with the damper, N/m."""
    quadratic_n_m2: PerAxle = (0.0, 0.0)
    """Progressive springs: force per square of the deflection from the unloaded car's rest,
    N/m2."""
    cubic_n_m3: PerAxle = (0.0, 0.0)
    """Progressive springs: force per cube of the deflection, N/m3."""
    stop_gap_m: PerAxle = (inf, inf)
    """Compression from the unloaded car's rest at which the bump stop is touched, m."""
    stop_n_m: PerAxle = (0.0, 0.0)
    """Stiffness of the bump stop, N/m."""
    bar_front_n_m: float = 0.0
    """Anti-roll bar: force on either corner of the front axle per difference of their suspension
    travels, N/m.  It has no force while both wheels travel equally.  A solid axle acts like a bar
    of negative stiffness, because its springs are closer together than its wheels."""
    bar_rear_n_m: float = 0.0
    """Anti-roll bar of the rear axle, N/m."""
    tyre_damping_front_ns_m: float = 0.0
    """Damping of each front tyre while it touches the road, N s/m."""
    tyre_damping_rear_ns_m: float = 0.0
    """Damping of each rear tyre, N s/m."""
    tyre_progression_per_m: PerAxle = (0.0, 0.0)
    """Relative growth of half the stiffness of a tyre per metre of squash above that of the
    unloaded car at rest, 1/m: force ``k c (1 + this c)``."""
    suspension: PerCorner = ALIKE
    """Factors on each corner's spring."""
    damper: PerCorner = ALIKE
    """Factors on each corner's damper."""
    tyre: PerCorner = ALIKE
    """Factors on each corner's tyre stiffness."""
    wheel: PerCorner = ALIKE
    """Factors on each corner's unsprung mass."""
    cg_offset_m: float = 0.0
    """Distance of the CG of the unloaded body to the left of the middle of the car, m."""

    def dampers(self, parameters: VehicleParameters) -> tuple[DamperCurve, DamperCurve]:
        """Return the curves of a front and of a rear damper."""
        c_sf, c_sr = parameters.c_sf, parameters.c_sr
        return (
            self.damper_front or Straight(self.compression * c_sf, self.rebound * c_sf),
            self.damper_rear or Straight(self.compression * c_sr, self.rebound * c_sr),
        )


NONE = Imperfections()
