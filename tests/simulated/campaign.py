"""Defines sensors for any car: an inertial unit, hub accelerometers, suspension travels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field
from math import sqrt
from types import MappingProxyType
from typing import Any

import numpy as np

from daq.channels import Channel, Quantity, message_of
from daq.runs import ADDED, BASELINE, Excitation, Run, RunStatus, SampleGroup
from daq.sessions import Session
from daq.sim.car import (
    NOISE,
    Spread,
    Truth,
    low_pass,
    measured,
    true_reading,
)
from daq.sim.motion import GRAVITY_M_S2, Bump, Moving
from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Vehicle,
    VehicleParameters,
)

from .elements import RealCar
from .engine import RealMotion, RealPlant, drive, forces, standing

IMU = "IMU"
"""The message of the inertial unit: acceleration of a body point, roll and pitch rate."""
HUBS = ("HUB_Front", "HUB_Rear")
"""The messages of the hub accelerometers, two hubs each."""
TRAVELS = ("SUSP_Front", "SUSP_Rear")
"""The messages of the suspension travels, two corners each."""
MESSAGES = (IMU, *HUBS, *TRAVELS)
"""All devices."""


@dataclass(frozen=True, slots=True)
class Fitting:
    """The fitting of sensors, as known from data sheets and a tape measure."""

    messages: tuple[str, ...] = MESSAGES
    imu_m: tuple[float, float] = (-1.05, 0.12)
    """Position of the inertial unit from the middle of the front axle: forward, left, m."""
    place_sigma_m: float = 0.0
    delay_s: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Stated delay of each device, s; 0 for devices that are not named."""
    delay_sigma_s: float = 0.0
    low_pass_hz: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Cut-off frequency of each device's second-order Butterworth low-pass, Hz; none for devices
    that are not named."""


def channels(fitting: Fitting) -> tuple[Channel, ...]:
    """Return the channels of a set of sensors."""
    sensors: list[tuple[str, Quantity, str, Corner | None]] = [
        ("body_acc_z", Quantity.BODY_ACCELERATION, IMU, None),
        ("roll_rate", Quantity.ROLL_RATE, IMU, None),
        ("pitch_rate", Quantity.PITCH_RATE, IMU, None),
    ]
    for stem, quantity, (front, rear) in (
        ("hub_acc", Quantity.HUB_ACCELERATION, HUBS),
        ("travel", Quantity.SUSPENSION_TRAVEL, TRAVELS),
    ):
        sensors += [
            (f"{stem}_{c.lower()}", quantity, front if c.front else rear, c) for c in Corner
        ]
    return tuple(
        Channel(
            name,
            quantity,
            signal=f"{message}.{name}",
            corner=corner,
            x_m=fitting.imu_m[0] if name == "body_acc_z" else 0.0,
            y_m=fitting.imu_m[1] if name == "body_acc_z" else 0.0,
            position_sigma_m=fitting.place_sigma_m if name == "body_acc_z" else 0.0,
            delay_s=fitting.delay_s.get(message, 0.0),
            delay_sigma_s=fitting.delay_sigma_s,
            low_pass_hz=fitting.low_pass_hz.get(message, 0.0),
        )
        for name, quantity, message, corner in sensors
        if message in fitting.messages
    )


# Simulates a complete campaign as a session, without frames and bus, for Monte Carlo studies ----


FINE_S = 1e-4
"""Time step, s, at which a run is read before the sensors sample it: that of the simulation."""


@dataclass(frozen=True, slots=True)
class PlannedBump:
    """One run of a campaign."""

    mass_state: str
    excitation: Excitation
    height_m: float = 0.05


@dataclass(frozen=True, slots=True)
class Plan:
    """The bumps and the channels of a campaign, as stated in the session."""

    bumps: tuple[PlannedBump, ...]
    """The runs, in order; each is simulated separately."""
    channels: tuple[Channel, ...]
    """The sensors; sensors whose signals are in the same message share a clock."""
    mass_states: tuple[MassState, ...] = (MassState(BASELINE),)
    """The weights, as measured by scales and tape."""
    vehicle: Vehicle = field(default_factory=lambda: Vehicle("simulated car"))
    """The structure and facts that are given to the identification."""
    rates_hz: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Sample rate of each message, Hz; 200 for messages that are not named."""
    bump_s: float = 0.2
    rest_s: float = 0.6
    """Recorded rest before the bump, s."""
    decay_s: float = 2.2
    """Recorded time after the bump, s."""
    stuck: float = 0.0
    """Largest load that the friction of each corner carries before a bump, as a share of its
    friction."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """A simulated session, with the truth."""

    session: Session
    truth: Truth
    motions: tuple[RealMotion, ...]
    """The motion of the car in each run."""


def simulate(car: RealCar, plan: Plan, seed: int) -> Simulated:
    """Simulate a campaign.

    `car`: the simulated car; its bump height, lead and tail are not used.  `plan`: runs, sensors
    and weights.  `seed`: determines every draw and all noise.
    """
    drawn = car.draw(plan.channels, plan.mass_states, seed)
    plants = {name: car.plant(added) for name, added in drawn.mass_states.items()}
    motions = _driven(plants, plan, np.random.default_rng([seed, 3]))
    unloaded = car.plant(AddedMass())
    repeats: Counter[tuple[str, Excitation]] = Counter()
    runs = []
    for number, (bump, motion) in enumerate(zip(plan.bumps, motions, strict=True)):
        kind = (bump.mass_state, bump.excitation)
        repeats[kind] += 1
        rng = np.random.default_rng([seed, 1, number])
        groups = _sampled(plan, car, drawn, unloaded, motion, rng)
        status = RunStatus.ACCEPTED
        runs.append(Run(*kind, repeats[kind], 0, plan.bump_s, groups, status))
    source = {"source": "simulation"}
    session = Session(plan.vehicle, plan.channels, plan.mass_states, tuple(runs), source)
    return Simulated(session, drawn, tuple(motions))


def _driven(
    plants: Mapping[str, RealPlant], plan: Plan, rng: np.random.Generator
) -> list[RealMotion]:
    """Return the motion of each run; time counts from the first sample at rest."""
    stuck = plan.stuck * rng.uniform(-1.0, 1.0, (len(plan.bumps), 4, 1))
    end_s = plan.rest_s + plan.bump_s + plan.decay_s
    motions = []
    for bump, share in zip(plan.bumps, stuck, strict=True):
        plant = plants[bump.mass_state]
        road = Bump(bump.excitation, bump.height_m, plan.rest_s, plan.bump_s)
        motions.append(drive(plant, road, end_s, standing(plant, share)))
    return motions


def _sampled(
    plan: Plan,
    car: RealCar,
    drawn: Truth,
    unloaded: RealPlant,
    motion: Moving,
    rng: np.random.Generator,
) -> tuple[SampleGroup, ...]:
    """Return the readings of the sensors in a run."""
    length_s = plan.rest_s + plan.bump_s + plan.decay_s
    latest_s = max(sensor.delay_s for sensor in drawn.sensors.values())
    fine_s = np.arange(-latest_s - FINE_S, length_s, FINE_S)
    seen = motion.at(fine_s)
    groups: dict[str, list[Channel]] = {}
    for channel in plan.channels:
        groups.setdefault(message_of(channel.signal), []).append(channel)
    result = []
    for name, channels in groups.items():
        clock = drawn.clocks[name]
        period_s = (1.0 + clock.error) / plan.rates_hz.get(name, 200.0)
        ticks = np.arange(round(length_s / period_s), dtype=np.float64)
        tick_s = (ticks + clock.phase) * period_s
        tick_s = tick_s[tick_s < length_s]
        values = {}
        for channel in channels:
            sensor = drawn.sensors[channel.name]
            fine = true_reading(channel, sensor, unloaded, seen)
            if sensor.low_pass_hz:
                fine = low_pass(fine, FINE_S, sensor.low_pass_hz, sensor.low_pass_order)
            reading = np.interp(tick_s - sensor.delay_s, fine_s, fine)
            values[channel.name] = measured(channel, sensor, car.noise, reading, rng)
        t_ns = np.rint(tick_s * 1e9).astype(np.int64)
        result.append(SampleGroup(name, tick_s, t_ns, values, np.zeros(len(tick_s), np.uint8)))
    return tuple(result)


# Draws the bench of a car of the fleet: sensors with stated errors, weights, runs, scales -------


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


def facts_of(car: RealCar, rng: np.random.Generator) -> tuple[Fact, ...]:
    """Return the facts that corner scales and a tape measure show of a car."""
    p = car.parameters
    plant = car.plant(AddedMass())
    still, flat = np.zeros((7, 1)), np.zeros((4, 1))
    loads = forces(plant, plant.static_pose(), still, flat)[1][:, 0] / GRAVITY_M_S2
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
