"""A fleet of cars whose laws are none of the fit's.  `python -m tests.simulated.other_laws 20`.

Sizes are drawn as for the fleet (`fleet.toml`); stops are of power 1 to 3 or exponential, dampers
of tanh, square root or blow-off, friction by Dahl, LuGre or a bare Coulomb law, springs of two
rates, tyres by a power of the squash.  The motion is that of `tests.identify.nonlinear.truth`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from time import process_time

import numpy as np
from numpy.typing import NDArray

import identify
from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Vehicle,
)
from tests.identify.nonlinear.truth import (
    BASELINE,
    SPEEDS,
    Truth,
    campaign,
    drive,
    records,
    session_of,
)

from .fleet import drawn_car, fleet_facts
from .fleet_study import FleetCase, fleet_case, fractions

SEED = 43
"""Seed of the fleet of `make fleet`."""
STOPS = (2.0, 1.0, 3.0, 0.0, 1.5)
"""Power of the stop's compression; 0 is exponential."""
DAMPERS = ("tanh", "square root", "blow-off")
FRICTIONS = ("Dahl", "LuGre", "Coulomb")
_COULOMB_M = 0.02e-3
"""Pre-sliding length of a bare Coulomb law, m: it has none, but the state needs one."""
_END_S = 2.0


@dataclass(frozen=True)
class OtherCar:
    """One car of the fleet."""

    name: str
    """Number, class and families of laws."""
    car: Truth
    loaded: MassState
    facts: tuple[Fact, ...]
    """Scales under the wheels to 1 kg, wheelbase and tracks by a tape to 4 mm."""
    seed: int
    """Seed of the noise."""


def other_car(number: int, seed: int = SEED) -> OtherCar:
    """Draw a car; classes and families alternate by its number."""
    ranges = fleet_facts()
    kind = ranges["class"][number % len(ranges["class"])]
    rng = np.random.default_rng([seed, number, 43])
    p, i = drawn_car(kind, ranges, rng)
    stop = STOPS[(number + number // 5) % len(STOPS)]
    damper = DAMPERS[(number + number // 3) % len(DAMPERS)]
    friction = FRICTIONS[number // 2 % len(FRICTIONS)]
    presliding_m = _COULOMB_M if friction == "Coulomb" else i.friction.presliding_m
    springs = np.array([p.k_sf, p.k_sr])

    def sides(front: float, rear: float) -> tuple[float, ...]:
        """Return the corners of an axle's mean: left and right differ by up to 3 % either way."""
        f, r = rng.uniform(-0.03, 0.03, 2)
        return front * (1 + f), front * (1 - f), rear * (1 + r), rear * (1 - r)

    car = Truth(
        m_s=p.m_s, I_yy=p.I_yy, I_xx=p.I_xx, a=p.a, b=p.b, t_f=p.t_f, t_r=p.t_r,
        y_s=float(rng.uniform(-0.03, 0.03)),
        m_u=sides(p.m_uf, p.m_ur), k_s=sides(p.k_sf, p.k_sr), k_t=sides(p.k_tf, p.k_tr),
        k_b=tuple((rng.uniform(0.5, 1.5, 2) * springs).tolist()),
        gap=tuple(rng.uniform(0.02, 0.045, 2).tolist()),
        power=stop,
        second=tuple((rng.uniform(0.0, 0.2, 2) * springs).tolist()),
        second_from=tuple(rng.uniform(0.005, 0.03, 2).tolist()),
        k_a=(i.bar_front_n_m, i.bar_rear_n_m),
        c_t=(i.tyre_damping_front_ns_m, i.tyre_damping_rear_ns_m),
        tyre_power=float(rng.uniform(1.0, 1.2)),
        friction=sides(i.friction.front_n, i.friction.rear_n),
        length=(presliding_m, presliding_m),
        static=float(rng.uniform(1.1, 1.4)) if friction == "LuGre" else 1.0,
        curves=(damper_curve(damper, p.c_sf, rng), damper_curve(damper, p.c_sr, rng)),
        ratio=sides(1.0, 1.0),
    )  # fmt: skip
    kg = float(rng.uniform(*ranges["weights"]["share"])) * p.m_s / 4.0
    weights = [BodyWeight(kg, x, y) for x in (0.1, -0.9 * (p.a + p.b)) for y in (0.5, -0.5)]
    wheels = [0.1 * (p.m_uf if corner.front else p.m_ur) for corner in Corner]
    hubs = [HubWeight(m, corner) for m, corner in zip(wheels, Corner, strict=True)]
    stop_name = f"stop of power {stop:g}" if stop else "exponential stop"
    name = f"{number} {kind['name']}: {stop_name}, {damper} dampers, {friction}"
    loaded = MassState("added", AddedMass((*weights, *hubs)))
    seed = int(rng.integers(2**31))
    return OtherCar(name, car, loaded, measured_facts(car, rng), seed)


def measured_facts(car: Truth, rng: np.random.Generator) -> tuple[Fact, ...]:
    """Return what scales and tape show of a car that stands level: loads in kg, lengths in m."""
    facts = []
    for i, name in enumerate(("corner_fl_kg", "corner_fr_kg", "corner_rl_kg", "corner_rr_kg")):
        to_other_axle, half_track = (car.b, car.t_f) if i < 2 else (car.a, car.t_r)
        share = (0.5 + (-1) ** i * 0.5 * car.y_s / half_track) * to_other_axle / (car.a + car.b)
        facts.append((name, car.m_s * share + car.m_u[i], 1.0))
    lengths = {
        "wheelbase_m": car.a + car.b,
        "front_track_m": 2 * car.t_f,
        "rear_track_m": 2 * car.t_r,
    }
    facts += [(name, length, 0.004) for name, length in lengths.items()]
    return tuple(
        Fact(FactQuantity(name), value + float(rng.normal(0.0, sigma)), sigma)
        for name, value, sigma in facts
    )


def damper_curve(family: str, secant: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the force at `SPEEDS` of a damper of a family, stronger in rebound.

    `secant`: slope between the forces at -0.1 and 0.1 m/s, N s/m.
    """
    knee_m_s = float(rng.uniform(0.05, 0.13))
    v = np.abs(SPEEDS)
    if family == "tanh":
        shape = 0.3 * v + 0.7 * knee_m_s * np.tanh(v / knee_m_s)
    elif family == "square root":
        shape = knee_m_s * (np.sqrt(1.0 + 2.0 * v / knee_m_s) - 1.0)
    else:  # an orifice that a valve opens beyond the knee
        closed = np.minimum(v, knee_m_s)
        shape = closed + 0.5 * closed**2 / knee_m_s + 0.35 * (v - closed)
    force = np.where(SPEEDS < 0.0, -float(rng.uniform(1.5, 2.5)) * shape, shape)
    low, high = np.interp([-0.1, 0.1], SPEEDS, force)
    return np.asarray(force * secant * 0.2 / (high - low))


def identified_other(number: int, seed: int = SEED) -> FleetCase:
    """Simulate a car of the fleet, identify it, and compare."""
    drawn = other_car(number, seed)
    car = drawn.car
    bumps = campaign((0.05,), states=(BASELINE, drawn.loaded))
    measured = records(car, bumps, drive(car, bumps, _END_S, 2e-4), drawn.seed)
    vehicle = Vehicle("other", facts=drawn.facts)
    session = session_of(measured, drawn.loaded.added.weights, vehicle)
    began_s = process_time()
    result = identify.identify_parameters(session)
    cpu_s = process_time() - began_s
    there: dict[str, dict[str, float]] = {
        name: {}
        for name in (
            "anti_roll_bars", "bump_stops", "cg_offset", "corners_left_right", "damper_curve",
            "dampers_left_right", "friction", "friction_left_right", "progressive_springs",
            "progressive_tyres", "tyre_damping", "static_friction",
        )
        if name != "static_friction" or car.static > 1.0
    }  # fmt: skip
    return fleet_case(drawn.name, result, _true_parameters(car), there, cpu_s)


def _true_parameters(car: Truth) -> dict[str, float]:
    """Return the parameters by which a case is judged; of an axle the mean."""
    truth = {name: float(getattr(car, name)) for name in ("m_s", "I_yy", "I_xx")}
    truth |= {name: float(getattr(car, name)) for name in ("a", "b", "t_f", "t_r")}
    for kind in ("m_u", "k_s", "k_t"):
        for axle, first in (("f", 0), ("r", 2)):
            left, right = getattr(car, kind)[first : first + 2]
            truth[f"{kind}{axle}"] = 0.5 * (left + right)
    return truth


if __name__ == "__main__":
    cases = []
    for one in range(int(sys.argv[1])):
        cases.append(identified_other(one))
        sys.stdout.write(f"{cases[-1]}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{fractions(cases)}\n")
