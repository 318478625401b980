"""Lists real cars by name, with sources: parameter sets from public data, and worn versions."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from math import inf, isfinite
from typing import Any

import numpy as np

from daq.sim.engine import Array
from daq.vehicle import FORD_GRANADA, VehicleParameters
from dbc.words import InputError

from .elements import (
    ALIKE,
    NONE,
    Branch,
    DamperCurve,
    Friction,
    Imperfections,
    PerAxle,
    RealCar,
    half_differences,
    means,
)

GRANADA = "granada"
"""The paper's car: linear, without imperfections."""


@dataclass(frozen=True, slots=True)
class NamedCar:
    """A car with a name."""

    name: str
    """Name, for the command line."""
    title: str
    """Title, for people."""
    source: str
    """Source of its figures, and assumptions."""
    parameters: VehicleParameters
    """Its 15 parameters; c_s is the secant of the damper curve of an axle without wear."""
    imperfections: Imperfections
    """Effects that the parameters do not describe."""

    def simulated(self, **changes: Any) -> RealCar:
        """Return the car for a simulated bench; `changes` are fields of `RealCar`."""
        made = RealCar(parameters=self.parameters, imperfections=self.imperfections)
        return replace(made, **changes)


def car_names() -> tuple[str, ...]:
    """Return the names of all cars."""
    return (GRANADA, *_entries())


def named_car(name: str) -> NamedCar:
    """Return a car by its name.

    Raises InputError if there is none of that name; it names the nearest ones.
    """
    if name == GRANADA:
        return NamedCar(name, "Ford Granada", "the paper's Table 1", FORD_GRANADA, NONE)
    entries = _entries()
    if name not in entries:
        near = get_close_matches(name.lower(), car_names(), 3, 0.5)
        named = f"did you mean {' or '.join(near)}?" if near else f"use {', '.join(car_names())}"
        raise InputError(f"--car {name}", "is unknown", named)
    entry = entries[name]
    described = {**entries[entry["like"]], **entry} if "like" in entry else entry
    published = VehicleParameters(**described["parameters"])
    front = _curve(described, "front", published.c_sf)
    rear = _curve(described, "rear", published.c_sr)
    return NamedCar(
        name=name,
        title=described["title"],
        source=f"{described['source']}; assumed: {described['assumed']}",
        parameters=replace(published, c_sf=front.secant_ns_m, c_sr=rear.secant_ns_m),
        imperfections=_imperfections(described, front, rear),
    )


@cache
def _entries() -> Mapping[str, Mapping[str, Any]]:
    text = files(__package__).joinpath("cars.toml").read_text("utf-8")
    return {entry["name"]: entry for entry in tomllib.loads(text)["car"]}


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


# Lists the nonlinear elements of a simulated car, by the names used in the identification -------


_SPEEDS_M_S = np.linspace(-1.0, 1.0, 401)


@dataclass(frozen=True, slots=True)
class TrueElements:
    """Elements of a car in addition to its linear parameters, with their true values."""

    groups: tuple[str, ...]
    """Names as in `[vehicle.structure]`; empty for a linear car."""
    values: Mapping[str, float]
    """Values, SI, with the axle at the end of the name: `F_cf` is the friction of a front
    corner."""
    curves: tuple[tuple[Array, Array], tuple[Array, Array]]
    """Speeds, m/s, compression positive, and forces, N, of a front and of a rear damper."""


def true_elements(car: RealCar) -> TrueElements:
    """Return the nonlinear elements of a simulated car."""
    i = car.imperfections
    dampers = i.dampers(car.parameters)
    sized = nonlinear_sizes(i)
    linear: dict[str, PerAxle] = {
        "anti_roll_bars": (i.bar_front_n_m, i.bar_rear_n_m),
        "tyre_damping": (i.tyre_damping_front_ns_m, i.tyre_damping_rear_ns_m),
        "cg_offset": (i.cg_offset_m, 0.0),
    }
    groups = [name for name, both in linear.items() if any(both)]
    groups += [name for name, kinds in sized.items() if any(any(v) for v in kinds.values())]
    if not all(damper.is_linear for damper in dampers):
        groups += ["one_sided_dampers", "damper_knees"]
    values = {"d_cf": i.friction.presliding_m, "d_cr": i.friction.presliding_m}
    values |= {"v_cf": i.friction.stribeck_m_s, "v_cr": i.friction.stribeck_m_s}
    for kinds in sized.values():
        values |= with_axles(kinds)
    gaps = zip("fr", i.stop_gap_m, strict=True)
    for axle, gap in gaps:
        if isfinite(gap):
            values |= {f"g_b{axle}": gap, f"p_b{axle}": 1.0}  # a hard edge
    return TrueElements(tuple(groups), values, (_true_curve(dampers[0]), _true_curve(dampers[1])))


def with_axles(kinds: Mapping[str, PerAxle]) -> dict[str, float]:
    """Return sizes by kind with the axle at the end of each name."""
    return {
        f"{kind}{axle}": size
        for kind, both in kinds.items()
        for axle, size in zip("fr", both, strict=True)
    }


def _true_curve(damper: DamperCurve) -> tuple[Array, Array]:
    return _SPEEDS_M_S, damper.force(_SPEEDS_M_S)


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
