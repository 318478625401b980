"""Draws the bench of a car of the fleet: sensors with stated errors, weights, runs, scales."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple
from math import sqrt
from typing import Any

import numpy as np

from daq.runs import ADDED, BASELINE, Excitation
from daq.sim.car import NOISE, SimulatedCar, Spread
from daq.sim.plant import GRAVITY_M_S2, contact, load_car, static_pose
from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    VehicleParameters,
)

from .campaign import Plan, PlannedBump
from .instruments import Fitting, channels

_SCALE_KG, _WHEELBASE_M, _TRACK_M = 0.5, 0.002, 0.004
"""Standard uncertainty of a corner's scales, kg, and of the tape measure along the car and across
it, m."""
_THREE = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
_FURTHER = (*_THREE, Excitation.WARP)
_CORNER_FACTS = [FactQuantity[f"CORNER_{corner}"] for corner in Corner]


def spread(factor: float) -> Spread:
    """Return the noise of real parts, times a factor."""
    return Spread(*(factor * sigma for sigma in astuple(NOISE)))


def fitted_plan(
    p: VehicleParameters,
    ranges: Mapping[str, Any],
    rng: np.random.Generator,
    messages: tuple[str, ...],
    weights: bool,
) -> Plan:
    """Draw sensors and runs for a car: six to eight runs, half of them with any weights.

    `p`: the car.  `ranges`: ranges of `fleet.toml`.  `messages`: fitted devices.  `weights`: True
    for additional runs with added mass.
    """
    sensors = ranges["sensors"]
    fitting = Fitting(
        messages=messages,
        imu_m=(-p.a + float(rng.uniform(-0.4, 0.4)), float(rng.uniform(-0.2, 0.2))),
        place_sigma_m=sensors["place_sigma_m"],
        delay_s={name: float(rng.uniform(*sensors["late_s"])) for name in messages},
        delay_sigma_s=sensors["late_sigma_s"],
        low_pass_hz={name: float(rng.uniform(*sensors["low_pass_hz"])) for name in messages},
    )
    rates_hz = {name: float(rng.choice(sensors["rates_hz"])) for name in messages}
    states = [BASELINE, ADDED] if weights else [BASELINE, BASELINE]
    kinds = [(state, excitation) for state in states for excitation in _THREE]
    for _ in range(int(rng.integers(0, 3))):
        kinds.append((states[int(rng.integers(2))], _FURTHER[int(rng.integers(4))]))
    heights = rng.uniform(0.03, 0.05, len(kinds))
    bumps = [
        PlannedBump(state, excitation, float(height))
        for (state, excitation), height in zip(kinds, heights, strict=True)
    ]
    limits = ranges["weights"]
    loads = _weights(p, limits, rng)
    mass_states = (MassState(BASELINE), MassState(ADDED, loads))[: len(set(states))]
    return Plan(
        bumps=tuple(bumps),
        channels=channels(fitting),
        mass_states=mass_states,
        rates_hz=rates_hz,
        stuck=0.5,
    )


def _weights(
    p: VehicleParameters, limits: Mapping[str, Any], rng: np.random.Generator
) -> AddedMass:
    """Draw weights over the axles, with the heavier one at the front left, and on the hubs."""
    sigma_kg = limits["mass_kg"] / sqrt(3.0)
    total = p.m_s * float(rng.uniform(*limits["share"]))
    placed = ((0.35, 0.1, 0.6), (0.15, 0.1, -0.6), (0.15, -1.0, 0.6), (0.35, -1.0, -0.6))
    wheelbase = p.a + p.b
    body = [
        BodyWeight(
            mass_kg=round(total * share, 1),
            x_m=round(0.15 if along > 0.0 else -wheelbase - 0.1, 2),
            y_m=round(across * (p.t_f if along > 0.0 else p.t_r), 2),
            sigma_kg=sigma_kg,
            position_sigma_m=limits["place_m"] / sqrt(3.0),
        )
        for share, along, across in placed
    ]
    hubs = [
        HubWeight(round(0.1 * (p.m_uf if c.front else p.m_ur), 1), c, sigma_kg / 10.0)
        for c in Corner
    ]
    return AddedMass((*body, *hubs))


def facts_of(car: SimulatedCar, rng: np.random.Generator) -> tuple[Fact, ...]:
    """Return the facts that corner scales and a tape measure show of a car."""
    p = car.parameters
    plant = load_car(p, AddedMass(), car.imperfections)
    still, flat = np.zeros((7, 1)), np.zeros((4, 1))
    loads = contact(plant, static_pose(plant), still, flat).tyre_n[:, 0] / GRAVITY_M_S2
    known = [
        *((q, float(load), _SCALE_KG) for q, load in zip(_CORNER_FACTS, loads, strict=True)),
        (FactQuantity.WHEELBASE, p.a + p.b, _WHEELBASE_M),
        (FactQuantity.FRONT_TRACK, 2.0 * p.t_f, _TRACK_M),
        (FactQuantity.REAR_TRACK, 2.0 * p.t_r, _TRACK_M),
    ]
    return tuple(
        Fact(quantity, value + sigma * float(rng.standard_normal()), sigma)
        for quantity, value, sigma in known
    )
