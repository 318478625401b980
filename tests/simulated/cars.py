"""Lists real cars by name, with sources: parameter sets from public data, and worn versions."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from math import inf
from typing import Any

from daq.errors import InputError
from daq.sim.car import SimulatedCar
from daq.sim.elements import ALIKE, NONE, Branch, DamperCurve, Friction, Imperfections, PerAxle
from daq.vehicle import FORD_GRANADA, VehicleParameters

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

    def simulated(self, **changes: Any) -> SimulatedCar:
        """Return the car for a simulated bench; `changes` are fields of `SimulatedCar`."""
        made = SimulatedCar(parameters=self.parameters, imperfections=self.imperfections)
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
