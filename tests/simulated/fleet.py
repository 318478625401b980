"""Draws a fleet of plausible real cars, each with its bench and its campaign.

`fleet.toml` holds the measured ranges and their sources.  Every draw is uniform within its range;
that of an inertia is the range of 5 to 95 % of measured vehicles.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from math import inf, pi, sqrt
from typing import Any

import numpy as np

from daq.sim.motion import GRAVITY_M_S2
from daq.vehicle import AddedMass, VehicleParameters

from .campaign import HUBS, IMU, MESSAGES, Plan, Simulated, facts_of, fitted_plan, simulate, spread
from .elements import (
    Branch,
    DamperCurve,
    Friction,
    Imperfections,
    PerAxle,
    PerCorner,
    RealCar,
    half_differences,
    load_car,
    means,
)

Facts = Mapping[str, Any]
Range = Sequence[float]


@dataclass(frozen=True, slots=True)
class FleetCar:
    """One car of the fleet with its campaign."""

    number: int
    """Its number in the fleet, from 0."""
    kind: str
    """Its class: city, suv, van, formula, solid axles."""
    car: RealCar
    """The car and its sensors' noise."""
    plan: Plan
    """Its campaign."""
    seed: int
    """Seed of the campaign's noise."""

    def simulate(self) -> Simulated:
        """Return its session, the same at each call."""
        return simulate(self.car, self.plan, self.seed)


@cache
def fleet_facts() -> Facts:
    """Return the ranges of `fleet.toml`."""
    text = files(__package__).joinpath("fleet.toml").read_text("utf-8")
    return tomllib.loads(text)


def fleet_car(number: int, seed: int, facts: bool = False, travels: bool = True) -> FleetCar:
    """Draw a car of a fleet.

    `number`: number of the car; the classes alternate.  `seed`: seed of the fleet.  `facts`: True
    for corner scales and a tape measure instead of added mass.  `travels`: True if suspension
    travels are measured in addition to the inertial unit and the hubs.
    """
    ranges = fleet_facts()
    kind = ranges["class"][number % len(ranges["class"])]
    rng = np.random.default_rng([seed, number, 17])
    parameters, imperfections = drawn_car(kind, ranges, rng)
    noise = spread(rng.uniform(*ranges["sensors"]["noise"]))
    car = RealCar(parameters, noise=noise, imperfections=imperfections)
    messages = MESSAGES if travels else (IMU, *HUBS)
    plan = fitted_plan(parameters, ranges, rng, messages, weights=not facts)
    if facts:
        plan = replace(plan, vehicle=replace(plan.vehicle, facts=facts_of(car, rng)))
    return FleetCar(number, kind["name"], car, plan, int(rng.integers(2**31)))


def drawn_car(
    kind: Facts, ranges: Facts, rng: np.random.Generator
) -> tuple[VehicleParameters, Imperfections]:
    """Draw the parameters and the imperfections of a car."""
    p = _parameters(kind, ranges, rng)
    i = _imperfections(kind, ranges, p, rng)
    curves = [curve for curve in (i.damper_front, i.damper_rear) if curve is not None]
    front, rear = (curve.secant_ns_m for curve in curves)
    return replace(p, c_sf=front, c_sr=rear), i


def _parameters(kind: Facts, ranges: Facts, rng: np.random.Generator) -> VehicleParameters:
    """Draw a car of a class, still with linear dampers."""

    def of(name: str) -> float:
        return float(rng.uniform(*kind[name]))

    m_s, wheelbase, track = of("m_s"), of("wheelbase_m"), of("track_m")
    share = of("front_share")
    a, b = (1.0 - share) * wheelbase, share * wheelbase
    low, _, high = ranges["indices"]["roll_gyration_over_track"]
    k_x = rng.uniform(low, high) * track
    low, _, high = ranges["indices"]["pitch_index"]
    index = rng.uniform(low, high)
    front_hz = of("heave_hz")
    rear_hz = front_hz * rng.uniform(1.05, 1.25)
    corner_f, corner_r = 0.5 * m_s * share, 0.5 * m_s * (1.0 - share)
    k_sf, k_sr = (2 * pi * front_hz) ** 2 * corner_f, (2 * pi * rear_hz) ** 2 * corner_r
    low, high = ranges["damper"]["ratio"]
    ratio = rng.uniform(low, high, 2)
    k_t = of("k_t")
    return VehicleParameters(
        m_s=m_s,
        I_yy=m_s * index * a * b,
        I_xx=m_s * k_x**2,
        m_uf=of("m_u"),
        m_ur=of("m_u"),
        k_sf=k_sf,
        k_sr=k_sr,
        k_tf=k_t,
        k_tr=k_t * rng.uniform(0.95, 1.1),
        c_sf=2.0 * ratio[0] * sqrt(k_sf * corner_f),
        c_sr=2.0 * ratio[1] * sqrt(k_sr * corner_r),
        a=a,
        b=b,
        t_f=0.5 * track,
        t_r=0.5 * track * rng.uniform(0.97, 1.03),
    )


def _imperfections(
    kind: Facts, ranges: Facts, p: VehicleParameters, rng: np.random.Generator
) -> Imperfections:
    springs, tyre = ranges["suspension"], ranges["tyre"]

    def both(span: Range, *factor: float) -> PerAxle:
        low, high = span
        front, rear = rng.uniform(low, high, 2) * np.array(factor or (1.0, 1.0))
        return float(front), float(rear)

    most_n = springs["friction_share"] * p.m_s * GRAVITY_M_S2
    low_n, high_n = kind["friction_n"]
    friction_n = both((low_n, max(low_n, min(high_n, most_n))))
    lugre = rng.uniform() < 0.5
    stops = rng.uniform() < 0.5
    low, high = np.log(springs["mount_n_m"])
    mounted = rng.uniform() < kind["mounted"]
    mounts = tuple(float(k) for k in np.exp(rng.uniform(low, high, 2)))
    damping = both(tyre["damping_ns_m"])
    bars = both(kind["bar_n_m"])
    unequal = ranges["unequal"]["corner"]
    return Imperfections(
        friction=Friction(
            *friction_n,
            presliding_m=float(rng.uniform(*springs["presliding_m"])),
            static_ratio=float(rng.uniform(*springs["static_ratio"])) if lugre else 1.0,
            sides=_sides(unequal, rng),
        ),
        damper_front=_damper(p.c_sf, ranges["damper"], rng),
        damper_rear=_damper(p.c_sr, ranges["damper"], rng),
        mount_n_m=(mounts[0], mounts[1]) if mounted else (inf, inf),
        quadratic_n_m2=both(springs["quadratic_per_m"], p.k_sf, p.k_sr),
        cubic_n_m3=both(springs["cubic_per_m2"], p.k_sf, p.k_sr),
        stop_gap_m=both(springs["stop_gap_m"]) if stops else (inf, inf),
        stop_n_m=both(springs["stop_over_spring"], p.k_sf, p.k_sr) if stops else (0.0, 0.0),
        bar_front_n_m=bars[0],
        bar_rear_n_m=bars[1],
        tyre_damping_front_ns_m=damping[0],
        tyre_damping_rear_ns_m=damping[1],
        tyre_progression_per_m=both(tyre["progression_per_m"]),
        suspension=_sides(unequal, rng),
        damper=_sides(unequal, rng),
        tyre=_sides(unequal, rng),
        wheel=_sides(unequal, rng),
        cg_offset_m=float(rng.uniform(-1.0, 1.0) * ranges["unequal"]["cg_m"]),
    )


def _sides(most: float, rng: np.random.Generator) -> PerCorner:
    """Draw factors of the corners; the mean of each axle is 1, so that its parameter stays true."""
    front, rear = rng.uniform(-most, most, 2).tolist()
    return 1.0 + front, 1.0 - front, 1.0 + rear, 1.0 - rear


def _damper(secant: float, ranges: Facts, rng: np.random.Generator) -> DamperCurve:
    """Draw a damper of a given secant: half of them with soft knees, half as a printed table."""
    bump_fall = rng.uniform(*ranges["compression_low_over_high"])
    rebound_fall = rng.uniform(*ranges["rebound_low_over_high"])
    bump = Branch(1.0, 1.0 / bump_fall, rng.uniform(*ranges["knee_m_s"]))
    rebound = Branch(1.0, 1.0 / rebound_fall, rng.uniform(*ranges["knee_m_s"]))
    back, ahead = DamperCurve(bump, rebound).force(np.array([-0.3, 0.3]))
    wanted = rng.uniform(*ranges["rebound_over_compression"])
    curve = DamperCurve(bump, rebound.times(-wanted * ahead / back)).scaled(secant)
    return curve if rng.uniform() < 0.5 else _printed(curve)


def _printed(curve: DamperCurve) -> DamperCurve:
    """Return a curve as a table of a test rig: a few speeds, straight between them."""
    bump = np.array([curve.compression.knee_m_s, 0.3, 0.6])
    rebound = np.array([curve.rebound.knee_m_s, 0.3, 0.6])
    ways = ((curve.compression, bump), (curve.rebound, rebound))
    return DamperCurve(
        *(
            Branch.table(list(zip(v.tolist(), way.force(v).tolist(), strict=True)))
            for way, v in ways
        )
    )


def elements(fleet_car: FleetCar, simulated: Simulated) -> dict[str, dict[str, float]]:
    """Return the force elements that this car has and its runs excite, with their true sizes, SI.

    Names are those of `[vehicle.structure]`, with `damper_curve` for both elements of the dampers;
    sizes have the names under which an identification reports them (`F_cf`: friction of a front
    corner, N; `s_mf`: compliance of a front mount, m/N).  A damper curve has no single size.
    """
    i = fleet_car.car.imperfections
    met = _met_stops(fleet_car, simulated)
    pairs: dict[str, dict[str, PerAxle]] = {
        "anti_roll_bars": {"k_a": (i.bar_front_n_m, i.bar_rear_n_m)},
        **nonlinear_sizes(i),
        "tyre_damping": {"c_t": (i.tyre_damping_front_ns_m, i.tyre_damping_rear_ns_m)},
        "corners_left_right": {
            "dk_s": half_differences(i.suspension),
            "dk_t": half_differences(i.tyre),
            "dm_u": half_differences(i.wheel),
        },
        "bump_stops": {"k_b": (i.stop_n_m[0] * met[0], i.stop_n_m[1] * met[1])},
    }
    sizes = {name: with_axles(kinds) for name, kinds in pairs.items()}
    sizes["cg_offset"] = {"y_s": i.cg_offset_m}
    found = {name: size for name, size in sizes.items() if any(size.values())}
    if i.damper_front is not None or i.damper_rear is not None:
        found["damper_curve"] = {}
    return found


def _met_stops(fleet_car: FleetCar, simulated: Simulated) -> tuple[bool, bool]:
    """Return whether a front and a rear stop were touched after the wheels left the bump."""
    i, p = fleet_car.car.imperfections, fleet_car.car.parameters
    bare = load_car(p, AddedMass(), i)
    met = np.zeros(4, dtype=bool)
    begin = fleet_car.plan.rest_s + fleet_car.plan.bump_s
    t_s = np.arange(begin, begin + 0.5, 1e-3)
    for motion in simulated.motions:
        pose = motion.at(t_s).pose
        u = pose[3:] - motion.plant.at_corners(pose) - bare.column("ride_m")
        met |= (u > bare.column("stop_gap_m")).any(axis=1)
    return bool(met[:2].any()), bool(met[2:].any())


def with_axles(kinds: Mapping[str, PerAxle]) -> dict[str, float]:
    """Return sizes by kind with the axle at the end of each name."""
    return {
        f"{kind}{axle}": size
        for kind, both in kinds.items()
        for axle, size in zip("fr", both, strict=True)
    }


def nonlinear_sizes(i: Imperfections) -> dict[str, dict[str, PerAxle]]:
    """Return the sizes of all nonlinear elements except damper curves, SI, by element and kind.

    Kinds are the beginnings of the names under which an identification reports them, such as `F_c`.
    """
    friction: PerAxle = (i.friction.front_n, i.friction.rear_n)
    split = half_differences(i.friction.sides)
    split_c, mean_c = half_differences(i.damper), means(i.damper)
    return {
        "friction": {"F_c": friction},
        "static_friction": {"r_c": (i.friction.static_ratio - 1.0,) * 2},
        "damper_mounts": {"s_m": (1.0 / i.mount_n_m[0], 1.0 / i.mount_n_m[1])},
        "progressive_springs": {"k_2": i.quadratic_n_m2, "k_3": i.cubic_n_m3},
        "bump_stops": {"k_b": i.stop_n_m},
        "progressive_tyres": {"b_t": i.tyre_progression_per_m},
        "friction_left_right": {"dF_c": (friction[0] * split[0], friction[1] * split[1])},
        "dampers_left_right": {"s_c": (split_c[0] / mean_c[0], split_c[1] / mean_c[1])},
    }
