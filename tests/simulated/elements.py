"""Force elements of simulated cars beyond the 15 parameters, and faults of their sensors.

`cars.toml` lists real cars by name, with sources: parameter sets from public data.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from daq.channels import Channel
from daq.sim.car import SensorTruth, SimulatedCar, Truth
from daq.sim.motion import Array, per_axle
from daq.vehicle import FORD_GRANADA, AddedMass, Corner, MassState, VehicleParameters

from .engine import RealPlant
from .engine import load_car as load_car_of_fields

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
    tyre_damping_front_ns_m: float = 0.0
    """Damping of each front tyre while it touches the road, N s/m."""
    tyre_damping_rear_ns_m: float = 0.0
    tyre_progression_per_m: PerAxle = (0.0, 0.0)
    """Relative growth of half the stiffness of a tyre per metre of squash above that of the
    unloaded car at rest, 1/m: force ``k c (1 + this c)``."""
    suspension: PerCorner = ALIKE
    """Factors on each corner's spring; the next on its damper, tyre stiffness and wheel mass."""
    damper: PerCorner = ALIKE
    tyre: PerCorner = ALIKE
    wheel: PerCorner = ALIKE
    cg_offset_m: float = 0.0
    """Distance of the CG of the unloaded body to the left of the middle of the car, m."""

    def fields(self, p: VehicleParameters) -> dict[str, Array]:
        """Return the fields of `engine.CORNER`."""

        def each(front: float, rear: float, factor: PerCorner = ALIKE) -> Array:
            return np.asarray(per_axle(front, rear) * np.reshape(factor, (4, 1)), np.float64)

        zero, friction = np.zeros((4, 1)), self.friction
        ways = [(damper.compression, damper.rebound) for damper in self.four_dampers(p)]
        progression = each(*self.tyre_progression_per_m)
        is_progressive = progression > 0.0
        # The force k c (1 + progression c) is least at this c.
        turn_m = -0.5 / np.where(is_progressive, progression, 1.0)
        sides = np.array([[corner.side] for corner in Corner])
        result = {
            "y_m": each(p.t_f, p.t_r) * sides - self.cg_offset_m,
            "wheel_kg": each(p.m_uf, p.m_ur, self.wheel),
            "spring_n_m": each(p.k_sf, p.k_sr, self.suspension),
            "quadratic_n_m2": each(*self.quadratic_n_m2),
            "cubic_n_m3": each(*self.cubic_n_m3),
            "stop_gap_m": each(*self.stop_gap_m),
            "stop_n_m": each(*self.stop_n_m),
            "bar_n_m": each(self.bar_front_n_m, self.bar_rear_n_m),
            "mount_n_m": each(*self.mount_n_m),
            "friction_n": each(friction.front_n, friction.rear_n, friction.sides),
            "presliding_m": zero + friction.presliding_m,
            "surplus": zero + friction.static_ratio - 1.0,
            "stribeck_m_s": zero + friction.stribeck_m_s,
            "tyre_n_m": each(p.k_tf, p.k_tr, self.tyre),
            "tyre_n_m2": each(p.k_tf, p.k_tr, self.tyre) * progression,
            "tyre_turn_m": np.where(is_progressive, turn_m, -np.inf),
            "tyre_ns_m": each(self.tyre_damping_front_ns_m, self.tyre_damping_rear_ns_m),
        }
        for way, name in enumerate(("in", "out")):
            result[f"{name}_ns_m"] = np.array([[pair[way].high_ns_m] for pair in ways])
            result[f"{name}_knee_n"] = np.array([[pair[way].knee_n] for pair in ways])
            result[f"{name}_knee_m_s"] = np.array([[pair[way].knee_m_s] for pair in ways])
        return result

    def bends(self, p: VehicleParameters) -> Array:
        """Return the kinks of the four dampers as `Plant.bends`, filled up with changes of 0."""
        ways = [(damper.compression, damper.rebound) for damper in self.four_dampers(p)]
        most = max(len(branch.bends) for pair in ways for branch in pair)
        bends = np.zeros((4, 2, most, 2))
        for corner, pair in enumerate(ways):
            for way, branch in enumerate(pair):
                bends[corner, way, : len(branch.bends)] = np.reshape(branch.bends, (-1, 2))
        return bends

    def four_dampers(self, p: VehicleParameters) -> list[DamperCurve]:
        """Return the damper of each corner."""
        front, rear = self.dampers(p)
        return [
            (front if corner.front else rear).times(factor)
            for corner, factor in zip(Corner, self.damper, strict=True)
        ]

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


def load_car(
    parameters: VehicleParameters, added: AddedMass, imperfections: Imperfections = NONE
) -> RealPlant:
    """Put added masses on a car with elements beyond its parameters."""
    i = imperfections
    return load_car_of_fields(parameters, added, i.fields(parameters), i.bends(parameters))


@dataclass(frozen=True, slots=True)
class SensorFault:
    """Deviations of one sensor from its channel's description.

    The order is that of the chain: the motion is delayed, passes the low-pass, gets its offset and
    noise, saturates, and is multiplied by the gain.
    """

    channel: str
    """Name of the channel."""
    gain: float = 1.0
    """Factor on the value: 1.02 for a wrong calibration, -1 for a sensor mounted upside down, 1 /
    9.80665 for g where m/s2 are stated."""
    late_s: float = 0.0
    """Delay in addition to the channel's own delay, s."""
    offset: float = 0.0
    """Constant added, in the channel's SI unit."""
    low_pass_hz: float = 0.0
    """Cut-off frequency (-3 dB) of a Butterworth low-pass, Hz; 0 keeps that of the channel."""
    low_pass_order: int = 2
    """Order of that low-pass."""
    limit: float = math.inf
    """Magnitude, SI, gravity included, at which the sensor saturates in both directions."""


@dataclass(frozen=True, slots=True)
class RealCar(SimulatedCar):
    """A simulated car with elements beyond its parameters, and with faulty sensors."""

    imperfections: Imperfections = NONE
    """Effects that the 15 parameters do not describe."""
    faults: tuple[SensorFault, ...] = ()
    """Faults of sensors, at most one entry per channel."""

    def plant(self, added: AddedMass) -> RealPlant:
        """Return the car with weights."""
        return load_car(self.parameters, added, self.imperfections)

    def draw(
        self, channels: Sequence[Channel], mass_states: Sequence[MassState], seed: int
    ) -> Truth:
        """Draw as `SimulatedCar.draw`, then spoil the sensors that have a fault."""
        drawn = SimulatedCar.draw(self, channels, mass_states, seed)
        wrong = {f.channel: spoilt(drawn.sensors[f.channel], f) for f in self.faults}
        return replace(drawn, sensors={**drawn.sensors, **wrong})


def spoilt(sensor: SensorTruth, fault: SensorFault) -> SensorTruth:
    """Return a sensor with its fault.

    Delays and constant errors add, gains multiply; the fault's limit, and its low-pass if it has
    one, replace those of the sensor.
    """
    has_low_pass = fault.low_pass_hz > 0.0
    return replace(
        sensor,
        delay_s=sensor.delay_s + fault.late_s,
        bias=sensor.bias + fault.offset,
        low_pass_hz=fault.low_pass_hz if has_low_pass else sensor.low_pass_hz,
        low_pass_order=fault.low_pass_order if has_low_pass else sensor.low_pass_order,
        gain=sensor.gain * fault.gain,
        limit=fault.limit,
    )


def named_car(name: str) -> RealCar:
    """Return a car of `cars.toml`, or the paper's, `granada`, which is linear."""
    if name == "granada":
        return RealCar(FORD_GRANADA)
    text = Path(__file__).with_name("cars.toml").read_text("utf-8")
    entries = {entry["name"]: entry for entry in tomllib.loads(text)["car"]}
    entry = entries[name]
    described = {**entries[entry["like"]], **entry} if "like" in entry else entry
    published = VehicleParameters(**described["parameters"])
    front = _curve(described, "front", published.c_sf)
    rear = _curve(described, "rear", published.c_sr)
    # c_s is the secant of the damper curve of an axle without wear.
    parameters = replace(published, c_sf=front.secant_ns_m, c_sr=rear.secant_ns_m)
    return RealCar(parameters, imperfections=_imperfections(described, front, rear))


def _curve(entry: Mapping[str, Any], axle: str, c_s: float) -> DamperCurve:
    """Return a damper: a printed table, a shape that is scaled to c_s, or a straight line."""
    if table := entry.get(f"table_{axle}"):
        return DamperCurve(Branch.table(table["compression"]), Branch.table(table["rebound"]))
    if shape := entry.get(f"damper_{axle}"):
        return DamperCurve(Branch(*shape["compression"]), Branch(*shape["rebound"])).scaled(c_s)
    return DamperCurve.straight(c_s, c_s)


def _imperfections(
    entry: Mapping[str, Any], front: DamperCurve, rear: DamperCurve
) -> Imperfections:
    def axles(key: str, absent: float) -> PerAxle:
        at_front, at_rear = entry.get(key, (absent, absent))
        return at_front, at_rear

    bars = axles("bars_n_m", 0.0)
    fl, fr, rl, rr = entry.get("damper_factors", ALIKE)
    return Imperfections(
        friction=Friction(*axles("friction_n", 0.0)),
        damper_front=front,
        damper_rear=rear,
        mount_n_m=axles("mounts_n_m", inf),
        quadratic_n_m2=axles("quadratic_n_m2", 0.0),
        stop_gap_m=axles("stop_gap_m", inf),
        stop_n_m=axles("stop_n_m", 0.0),
        bar_front_n_m=bars[0],
        bar_rear_n_m=bars[1],
        tyre_progression_per_m=axles("tyre_progression_per_m", 0.0),
        damper=(fl, fr, rl, rr),
    )


def true_parameters(car: RealCar) -> dict[str, float]:
    """Return the true parameters; for an axle with unequal corners, the mean of both.

    The 15 first; c_s is the secant of the damper's curve between minus and plus 0.1 m/s.  Then
    `k_af k_ar` anti-roll bars, `c_tf c_tr` tyre damping, `y_s` the CG off the middle, `F_cf F_cr`
    sliding friction of a corner.
    """
    p, i = car.parameters, car.imperfections
    values = asdict(p)
    for name, curve in zip(("c_sf", "c_sr"), i.dampers(p), strict=True):
        values[name] = curve.secant_ns_m
    for kind, factors in (
        ("m_u", i.wheel),
        ("k_s", i.suspension),
        ("k_t", i.tyre),
        ("c_s", i.damper),
    ):
        for axle, mean in zip("fr", means(factors), strict=True):
            values[f"{kind}{axle}"] *= mean
    friction_means = means(i.friction.sides)
    return values | {
        "k_af": i.bar_front_n_m,
        "k_ar": i.bar_rear_n_m,
        "c_tf": i.tyre_damping_front_ns_m,
        "c_tr": i.tyre_damping_rear_ns_m,
        "y_s": i.cg_offset_m,
        "F_cf": i.friction.front_n * friction_means[0],
        "F_cr": i.friction.rear_n * friction_means[1],
    }
