"""Defines the force elements of a simulated car beyond the 15 parameters, with their sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np
from numpy.typing import NDArray

from ..vehicle import VehicleParameters

Array = NDArray[np.float64]
PerCorner = tuple[float, float, float, float]
"""A value for each corner, in the order of `daq.vehicle.Corner`."""
PerAxle = tuple[float, float]
"""A value for a corner of the front axle and one for the rear axle."""

ALIKE: PerCorner = (1.0, 1.0, 1.0, 1.0)
SECANT_M_S = 0.1
"""Speed that defines c_s, m/s: c_s is the slope of the straight line between the forces at minus
and plus this speed."""


@dataclass(frozen=True, slots=True)
class Branch:
    """A damper in one direction; forces and speeds are positive.

    ``F(v) = high v + (low - high) knee tanh(v / knee) + sum(change max(v - speed, 0))``
    """

    low_ns_m: float
    """Slope at standstill, N s/m."""
    high_ns_m: float
    """Slope far above the knee, N s/m."""
    knee_m_s: float = 1.0
    """Speed of the soft knee, m/s."""
    bends: tuple[tuple[float, float], ...] = ()
    """Speed, m/s, and change of slope, N s/m, of each kink."""

    @classmethod
    def table(cls, points: Sequence[tuple[float, float]]) -> Branch:
        """Return the branch through points (m/s, N) of a test rig, straight between them."""
        lines = list(pairwise([(0.0, 0.0), *points]))
        begins_m_s = [v0 for (v0, _), _ in lines]
        slopes = [(f1 - f0) / (v1 - v0) for (v0, f0), (v1, f1) in lines]
        changes = [after - before for before, after in pairwise(slopes)]
        bends = tuple(zip(begins_m_s[1:], changes, strict=True))
        return cls(slopes[0], slopes[0], bends=bends)

    @property
    def knee_n(self) -> float:
        """The force that the knee adds far above it, N."""
        return (self.low_ns_m - self.high_ns_m) * self.knee_m_s

    def times(self, factor: float) -> Branch:
        """Return a branch of the same shape with other forces."""
        bends = tuple((speed, change * factor) for speed, change in self.bends)
        return Branch(self.low_ns_m * factor, self.high_ns_m * factor, self.knee_m_s, bends)

    def force(self, speed: Array) -> Array:
        """Return the force, N, at speeds in this direction, m/s."""
        kinks = sum(change * np.maximum(speed - bend, 0.0) for bend, change in self.bends)
        return np.asarray(
            self.high_ns_m * speed + self.knee_n * np.tanh(speed / self.knee_m_s) + kinks
        )


@dataclass(frozen=True, slots=True)
class DamperCurve:
    """A damper: force by closing speed, compression positive."""

    compression: Branch
    """Branch while the wheel approaches the body."""
    rebound: Branch
    """Branch while the wheel leaves the body."""

    @classmethod
    def straight(cls, compression_ns_m: float, rebound_ns_m: float) -> DamperCurve:
        """Return a damper with one slope for each direction."""
        up, down = (Branch(slope, slope) for slope in (compression_ns_m, rebound_ns_m))
        return cls(up, down)

    @property
    def is_linear(self) -> bool:
        """True if force is proportional to speed, with the same slope in both directions."""
        slopes = {s for b in (self.compression, self.rebound) for s in (b.low_ns_m, b.high_ns_m)}
        return len(slopes) == 1 and not self.compression.bends and not self.rebound.bends

    @property
    def secant_ns_m(self) -> float:
        """The slope between minus and plus `SECANT_M_S`, which is c_s, N s/m."""
        below, above = self.force(np.array([-SECANT_M_S, SECANT_M_S]))
        return float((above - below) / (2.0 * SECANT_M_S))

    def times(self, factor: float) -> DamperCurve:
        """Return a damper of the same shape with other forces."""
        return DamperCurve(self.compression.times(factor), self.rebound.times(factor))

    def scaled(self, secant_ns_m: float) -> DamperCurve:
        """Return a damper of the same shape with a given `secant_ns_m`."""
        return self.times(secant_ns_m / self.secant_ns_m)

    def force(self, closing: Array) -> Array:
        """Return the force, N, at closing speeds, m/s."""
        compression_n, rebound_n = self.compression.force(closing), -self.rebound.force(-closing)
        return np.where(closing > 0.0, compression_n, rebound_n)


@dataclass(frozen=True, slots=True)
class Friction:
    """Dry friction parallel to the springs: laws of Dahl, and of Canudas de Wit and others (LuGre).

    The rubber and the seals of a corner yield before it slides.  Their deflection, as a share of
    that at which sliding begins, remembers the past, with the closing speed w::

        share' = (w - |w| share / s(w)) / presliding          F = F_c share
        s(w) = 1 + (static ratio - 1) exp(-(w / stribeck)^2)
    """

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
    """Effects in a car that its 15 parameters do not describe; absent by default."""

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
            self.damper_front or DamperCurve.straight(self.compression * c_sf, self.rebound * c_sf),
            self.damper_rear or DamperCurve.straight(self.compression * c_sr, self.rebound * c_sr),
        )


NONE = Imperfections()


def means(factors: PerCorner) -> PerAxle:
    """Return the mean of the front corners and that of the rear ones."""
    return 0.5 * (factors[0] + factors[1]), 0.5 * (factors[2] + factors[3])


def half_differences(factors: PerCorner) -> PerAxle:
    """Return half of left minus right, front and rear."""
    return 0.5 * (factors[0] - factors[1]), 0.5 * (factors[2] - factors[3])
