"""Simulates a complete campaign as a session, without frames and bus, for Monte Carlo studies.

Everything except the wire is as on the simulated bench: the car is driven over its bumps; the
sensors measure with delay, low-pass, bias and noise, each message at its own times.  The weights,
positions and delays stated in the session differ from the truth by errors of the stated
uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from types import MappingProxyType

import numpy as np

from daq.channels import Channel, message_of
from daq.runs import BASELINE, Excitation, Run, RunStatus, SampleGroup
from daq.sessions import Session
from daq.sim.car import SensorTruth, SimulatedCar, Truth, draw
from daq.sim.elements import Array
from daq.sim.engine import Plant
from daq.sim.motion import Bump, Kinematics, Motion, Moving, drive, standing
from daq.sim.plant import load_car
from daq.sim.sensors import Installation, install, low_pass, measured, true_reading
from daq.vehicle import MassState, Vehicle

FINE_S = 1e-4
"""Time step, s, at which a run is read before the sensors sample it: that of the simulation."""


@dataclass(frozen=True, slots=True)
class PlannedBump:
    """One run of a campaign."""

    mass_state: str
    """Name of the mass state."""
    excitation: Excitation
    """Kind of bump."""
    height_m: float = 0.05
    """Height of the bump, m."""


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
    """Duration of the bump, s."""
    rest_s: float = 0.6
    """Recorded rest before the bump, s."""
    decay_s: float = 2.2
    """Recorded time after the bump, s."""
    from_decay: bool = False
    """True if records begin with the free decay: the first sample of each sensor is after the bump.
    Else they begin at rest."""
    stuck: float = 0.0
    """Largest load that the friction of each corner carries before a bump, as a share of its
    friction."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """A simulated session, with the truth."""

    session: Session
    """The recorded session."""
    truth: Truth
    """The drawn true values."""
    motions: tuple[Motion, ...]
    """The motion of the car in each run."""


def simulate(car: SimulatedCar, plan: Plan, seed: int) -> Simulated:
    """Simulate a campaign.

    `car`: the simulated car; its bump height, lead and tail are not used.  `plan`: runs, sensors
    and weights.  `seed`: determines every draw and all noise.  Raises ValueError if the weights
    would tip the car over, or a bump names no mass state of the plan.  Raises InputError if a fault
    is declared for no channel of the plan, or two for the same one.
    """
    drawn = draw(plan.channels, plan.mass_states, car, seed)
    plants = {
        name: load_car(car.parameters, added, car.imperfections)
        for name, added in drawn.mass_states.items()
    }
    motions = _driven(plants, plan, np.random.default_rng([seed, 3]))
    return Simulated(recorded(car, plan, drawn, motions, seed), drawn, tuple(motions))


def recorded(
    car: SimulatedCar, plan: Plan, drawn: Truth, motions: Sequence[Moving], seed: int
) -> Session:
    """Record given motions, one per run of the plan, with the drawn sensors and clocks."""
    unloaded = load_car(car.parameters, MassState(BASELINE).added, car.imperfections)
    installation = install(unloaded, car)
    repeats: dict[tuple[str, Excitation], int] = {}
    runs = []
    for number, (bump, motion) in enumerate(zip(plan.bumps, motions, strict=True)):
        kind = (bump.mass_state, bump.excitation)
        repeats[kind] = repeats.get(kind, 0) + 1
        rng = np.random.default_rng([seed, 1, number])
        groups = _sampled(plan, car, drawn, installation, motion, rng)
        runs.append(_run(bump, repeats[kind], plan.bump_s, groups))
    source = {"source": "simulation"}
    return Session(plan.vehicle, plan.channels, plan.mass_states, tuple(runs), source)


def _driven(plants: Mapping[str, Plant], plan: Plan, rng: np.random.Generator) -> list[Motion]:
    """Return the motion of each run; time counts from the first sample at rest."""
    unknown = [bump.mass_state for bump in plan.bumps if bump.mass_state not in plants]
    if unknown:
        raise ValueError(f"there is no mass state {unknown[0]}")
    run_by_run = [plants[bump.mass_state] for bump in plan.bumps]
    stuck = plan.stuck * rng.uniform(-1.0, 1.0, (len(run_by_run), 4, 1))
    starts = [standing(plant, share) for plant, share in zip(run_by_run, stuck, strict=True)]
    roads = [Bump(b.excitation, b.height_m, plan.rest_s, plan.bump_s) for b in plan.bumps]
    end_s = plan.rest_s + plan.bump_s + plan.decay_s
    given: Sequence[Array | None] = starts or [None] * len(roads)
    cars = zip(run_by_run, roads, given, strict=True)
    return [drive(plant, road, end_s, start) for plant, road, start in cars]


def _sampled(
    plan: Plan,
    car: SimulatedCar,
    drawn: Truth,
    installation: Installation,
    motion: Moving,
    rng: np.random.Generator,
) -> tuple[SampleGroup, ...]:
    """Return the readings of the sensors in a run."""
    length_s = plan.rest_s + plan.bump_s + plan.decay_s
    off_s = plan.rest_s + plan.bump_s if plan.from_decay else -inf
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
        late_s = max(drawn.sensors[channel.name].delay_s for channel in channels)
        tick_s = tick_s[(tick_s > off_s + late_s) & (tick_s < length_s)]
        values = {}
        for channel in channels:
            sensor = drawn.sensors[channel.name]
            reading = _reading(channel, sensor, installation, fine_s, seen, tick_s)
            values[channel.name] = measured(channel, sensor, car.noise, reading, rng)
        t_ns = np.rint(tick_s * 1e9).astype(np.int64)
        result.append(SampleGroup(name, tick_s, t_ns, values, np.zeros(len(tick_s), np.uint8)))
    return tuple(result)


def _reading(
    channel: Channel,
    sensor: SensorTruth,
    installation: Installation,
    fine_s: Array,
    seen: Kinematics,
    tick_s: Array,
) -> Array:
    """Return the readings of a sensor without noise at its sample times."""
    reading = true_reading(channel, sensor, installation, seen)
    if sensor.low_pass_hz:
        reading = low_pass(reading, FINE_S, sensor.low_pass_hz, sensor.low_pass_order)
    return np.interp(tick_s - sensor.delay_s, fine_s, reading)


def _run(bump: PlannedBump, repeat: int, bump_s: float, groups: Sequence[SampleGroup]) -> Run:
    return Run(
        mass_state=bump.mass_state,
        excitation=bump.excitation,
        repeat=repeat,
        t0_ns=0,
        bump_s=bump_s,
        groups=tuple(groups),
        status=RunStatus.ACCEPTED,
    )
