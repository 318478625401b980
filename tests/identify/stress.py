"""The stress list: campaigns with one thing wrong each, for the gates of trust.

The motion is that of `tests.simulated.engine`, which is built of forces and shares nothing with
`identify.model.matrices`; it is sampled at the sensors directly, without frames, with white noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from daq.bench.config import load_bench
from daq.channels import Channel, message_of
from daq.runs import ADDED, BASELINE, Excitation, Run, SampleGroup
from daq.sessions import ArrayRun, Session, session_from_arrays
from daq.sim.car import (
    NOISE,
    SensorTruth,
    Spread,
    low_passed,
    measured,
    true_reading,
)
from daq.sim.motion import GRAVITY_M_S2, Bump, Moving, Plant
from daq.sim.motion import load_car as load_linear_car
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, Vehicle
from dbc.words import Finding, Severity
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate, generic_vehicles
from identify.pipeline import grey_box

from ..simulated.elements import NONE, Friction, Imperfections, SensorFault, load_car, spoilt

Array = NDArray[np.float64]
Key = tuple[str, Excitation, int]
"""Mass state, excitation and repeat of a run."""

REST_S = 1.0
BUMP_S = 0.2
RUN_S = 4.0
"""From the first sample to the last: rest, bump and 2.8 s of free decay."""
REPEATS = 2
ODD_RUN = (BASELINE, Excitation.BOUNCE, 2)
"""The run that is unlike its repeat where a stress has one."""
SECOND_BUMP_S = 0.8
"""How long after the first a second bump begins."""
THREE = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
BODY = ("body_acc_z", "roll_rate", "pitch_rate")
HUBS = ("hub_acc_fl", "hub_acc_fr", "hub_acc_rl", "hub_acc_rr")
TRAVELS = ("travel_fl", "travel_fr", "travel_rl", "travel_rr")

_BENCH = load_bench(None)


def sure(added: AddedMass) -> AddedMass:
    """Return added mass whose weights are known to a gram and a tenth of a millimetre."""
    return AddedMass(
        tuple(
            replace(w, sigma_kg=1e-3, position_sigma_m=1e-4)
            if isinstance(w, BodyWeight)
            else replace(w, sigma_kg=1e-3)
            for w in added.weights
        )
    )


ADDED_MASS = {state.name: sure(state.added) for state in _BENCH.mass_states}
"""Added mass of each mass state of the shipped bench."""
_PHASES = {
    "IMU_Accel": 0.0,
    "IMU_Rate": 0.0,
    "HUB_Front": 0.37,
    "HUB_Rear": 0.61,
    "SUSP_Front": 0.18,
    "SUSP_Rear": 0.83,
}
"""When the device behind each message samples, in sampling periods."""


@dataclass(frozen=True, slots=True)
class Stress:
    """One row of the stress list."""

    wrong: str
    """The fault, for people."""
    imperfections: Imperfections = NONE
    """Of the car, in every run."""
    faults: tuple[SensorFault, ...] = ()
    """Of the sensors."""
    bump_m: float = 0.05
    """Height of the bump."""
    stated_bump_s: float = BUMP_S
    """How long the session says that it lasts; in truth `BUMP_S`."""
    excitations: tuple[Excitation, ...] = THREE
    """Excitations of the runs."""
    odd_car: Imperfections | None = None
    """Imperfections of the car in `ODD_RUN` instead."""
    second_bump: float = 0.0
    """Height of a second bump in `ODD_RUN`, as a share of the first."""


def _late(channels: tuple[str, ...], late_s: float) -> tuple[SensorFault, ...]:
    return tuple(SensorFault(name, late_s=late_s) for name in channels)


def _slow(channels: tuple[str, ...], low_pass_hz: float) -> tuple[SensorFault, ...]:
    return tuple(SensorFault(name, low_pass_hz=low_pass_hz) for name in channels)


STRESSES: Mapping[str, Stress] = {
    "linear": Stress("nothing: the control"),
    "friction": Stress(
        "50 N of friction in each corner", Imperfections(friction=Friction(50.0, 50.0))
    ),
    "friction_mild": Stress(
        "10 N of friction in each corner", Imperfections(friction=Friction(10.0, 10.0))
    ),
    "damper": Stress(
        "dampers of 1000 N s/m in compression and 2000 in rebound",
        Imperfections(compression=1000.0 / 1500.0, rebound=2000.0 / 1500.0),
    ),
    "damper_mild": Stress(
        "dampers of 1350 N s/m in compression and 1650 in rebound",
        Imperfections(compression=0.9, rebound=1.1),
    ),
    "bars": Stress(
        "anti-roll bars of 10 and 5 kN/m", Imperfections(bar_front_n_m=10e3, bar_rear_n_m=5e3)
    ),
    "tyre_damping": Stress(
        "150 N s/m in each tyre",
        Imperfections(tyre_damping_front_ns_m=150.0, tyre_damping_rear_ns_m=150.0),
    ),
    "sides": Stress(
        "dampers 10 % stronger left, 10 % weaker right", Imperfections(damper=(1.1, 0.9, 1.1, 0.9))
    ),
    "cg_offset": Stress("the CG lies 30 mm to the left", Imperfections(cg_offset_m=0.03)),
    "hubs_late_1ms": Stress("hub channels 1 ms late", faults=_late(HUBS, 0.001)),
    "hubs_late_5ms": Stress("hub channels 5 ms late", faults=_late(HUBS, 0.005)),
    "body_low_pass": Stress("20 Hz low-pass on the body's sensors", faults=_slow(BODY, 20.0)),
    "low_pass": Stress("20 Hz low-pass on all sensors", faults=_slow(BODY + HUBS + TRAVELS, 20.0)),
    "offset": Stress("0.05 m/s2 on the IMU", faults=(SensorFault("body_acc_z", offset=0.05),)),
    "gain": Stress("one hub reads 2 % too much", faults=(SensorFault("hub_acc_fl", gain=1.02),)),
    "polarity": Stress("one hub upside down", faults=(SensorFault("hub_acc_rr", gain=-1.0),)),
    "unit": Stress(
        "one hub in g instead of m/s2", faults=(SensorFault("hub_acc_fr", gain=1 / GRAVITY_M_S2),)
    ),
    "saturation": Stress(
        "one hub ends at 2 g", faults=(SensorFault("hub_acc_fl", limit=2.0 * GRAVITY_M_S2),)
    ),
    # The wheels come down 1 ms after the end of the bump (measured), within any guard time.
    "lift_off": Stress("a bump of 90 mm lifts the rear wheels", bump_m=0.09),
    "lift_off_high": Stress(
        "a bump of 130 mm lifts all wheels, until 23 ms after its end", bump_m=0.13
    ),
    "early": Stress("the bump lasts 5 ms longer than stated", stated_bump_s=BUMP_S - 0.005),
    "early_20ms": Stress("the bump lasts 20 ms longer than stated", stated_bump_s=BUMP_S - 0.02),
    "second_bump": Stress("a second bump in one run", second_bump=0.4),
    "hot_damper": Stress(
        "dampers 15 % weaker in one run", odd_car=Imperfections(damper=(0.85, 0.85, 0.85, 0.85))
    ),
    "no_roll": Stress("no roll run", excitations=(Excitation.BOUNCE, Excitation.PITCH)),
}
"""Name to what is wrong."""


def stress_channels(travels: bool = False) -> tuple[Channel, ...]:
    """Return the sensors: an IMU and four hub accelerometers, with suspension travels if wanted.

    Their places are known to 0.1 mm, their delays to be zero.
    """
    wanted = BODY + HUBS + (TRAVELS if travels else ())
    return tuple(
        replace(channel, position_sigma_m=1e-4, gain_sigma=0.0, delay_s=0.0, delay_sigma_s=0.0)
        for channel in _BENCH.channels
        if channel.name in wanted
    )


def stress_session(
    name: str,
    seed: int,
    rate_hz: float = 200.0,
    travels: bool = False,
    vehicle: Vehicle | None = None,
    noise: Spread = NOISE,
    extra: tuple[Excitation, ...] = (),
    repeats: int = REPEATS,
) -> Session:
    """Return a campaign with one thing wrong.

    Baseline and the weights of the shipped bench, some runs of each excitation, each device with
    its own sampling instants.

    Parameters
    ----------
    name : str
        Of `STRESSES`.
    seed : int
        Of the noise.
    rate_hz : float
        Samples a second of every channel.
    travels : bool
        Whether suspension travels are measured too.
    vehicle : Vehicle, optional
        Structure and facts that the identification knows.
    noise : Spread
        White noise of the sensors.
    extra : tuple of Excitation
        Driven beside those of the stress: the warp that the campaign lacks.
    repeats : int
        Runs of each excitation in each mass state.
    """
    stress = STRESSES[name]
    channels = stress_channels(travels)
    rng = np.random.default_rng(seed)
    runs: list[ArrayRun] = []
    for state in (BASELINE, ADDED):
        for excitation in stress.excitations + extra:
            for repeat in range(1, repeats + 1):
                key = (state, excitation, repeat)
                record = {c.name: samples(stress, c, key, rate_hz, noise, rng) for c in channels}
                runs.append((state, excitation.value, record))
    return session_from_arrays(
        runs,
        channels,
        ADDED_MASS[ADDED],
        Vehicle("Ford Granada") if vehicle is None else vehicle,
        bump_s=stress.stated_bump_s,
    )


def samples(
    stress: Stress, channel: Channel, run: Key, rate_hz: float, noise: Spread, rng: Generator
) -> tuple[Array, Array]:
    """Return the sampling instants of a channel in a run, s, and what it says there, SI."""
    state, excitation, _ = run
    clean = _clean_odd if run == ODD_RUN else _clean
    t_s, reading = clean(stress, channel, state, excitation, rate_hz)
    return t_s, measured(channel, _sensor(channel, stress), noise, reading, rng)


def true_value(name: str, parameter: str) -> float:
    """Return a parameter of the stressed car, by its name in `daq.vehicle.parameter_names`.

    Where the model is simpler than the car it is the mean: of left and right, of compression and
    rebound.
    """
    car = STRESSES[name].imperfections
    beyond = {
        "k_af": car.bar_front_n_m,
        "k_ar": car.bar_rear_n_m,
        "c_tf": car.tyre_damping_front_ns_m,
        "c_tr": car.tyre_damping_rear_ns_m,
        "y_s": car.cg_offset_m,
    }
    factors = {"m_u": car.wheel, "k_s": car.suspension, "k_t": car.tyre, "c_s": car.damper}
    if parameter in beyond:
        return beyond[parameter]
    kind, place = parameter[:3], parameter[3:].upper()
    if kind not in factors:
        return float(getattr(FORD_GRANADA, parameter))
    corners = [corner for corner in Corner if corner.value.startswith(place)]
    mean = sum(factors[kind][corner.position] for corner in corners) / len(corners)
    if kind == "c_s":
        mean *= (car.compression + car.rebound) / 2.0
    return float(getattr(FORD_GRANADA, parameter[:4])) * mean


def _sensor(channel: Channel, stress: Stress) -> SensorTruth:
    sensor = SensorTruth(channel.x_m, channel.y_m, delay_s=0.0, bias=0.0)
    faults = [fault for fault in stress.faults if fault.channel == channel.name]
    return spoilt(sensor, faults[0]) if faults else sensor


@cache
def _plant(car: Imperfections, state: str, bump_m: float = 0.0) -> Plant:
    """Return a car in a mass state; the linear one where nothing else acts and no wheel lifts."""
    if car == NONE and bump_m <= 0.05:
        return load_linear_car(FORD_GRANADA, ADDED_MASS[state])
    return load_car(FORD_GRANADA, ADDED_MASS[state], car)


@cache
def _motion(car: Imperfections, bump_m: float, state: str, excitation: Excitation) -> Moving:
    """Return how a car moves over a kind of bump in a mass state."""
    bump = Bump(excitation, bump_m, REST_S, BUMP_S)
    return _plant(car, state, bump_m).drive(bump, RUN_S)


@cache
def _clean(
    stress: Stress, channel: Channel, state: str, excitation: Excitation, rate_hz: float
) -> tuple[Array, Array]:
    """Return a channel's sampling instants and its readings before bias, noise and gain."""
    tick = np.arange(round(RUN_S * rate_hz), dtype=np.float64)
    t_s = (tick + _PHASES[message_of(channel.signal)]) / rate_hz
    return t_s, _reading(stress, channel, state, excitation, t_s)


@cache
def _clean_odd(
    stress: Stress, channel: Channel, state: str, excitation: Excitation, rate_hz: float
) -> tuple[Array, Array]:
    """Return the same of the run that is unlike its repeat."""
    car = stress.imperfections if stress.odd_car is None else stress.odd_car
    other = replace(stress, imperfections=car)
    t_s, reading = _clean(other, channel, state, excitation, rate_hz)
    if stress.second_bump:
        # No tyre leaves the ground and the car is linear, so that two bumps add up.
        again = _reading(other, channel, state, excitation, t_s - SECOND_BUMP_S)
        reading = reading + stress.second_bump * (again - again[0])
    return t_s, reading


def _reading(
    stress: Stress, channel: Channel, state: str, excitation: Excitation, t_s: Array
) -> Array:
    car = stress.imperfections
    unloaded = _plant(car, BASELINE)
    motion = _motion(car, stress.bump_m, state, excitation)
    sensor = _sensor(channel, stress)
    seen_s = t_s - sensor.delay_s
    if sensor.low_pass_hz:
        span_s = (float(seen_s[0]), float(seen_s[-1]))
        return np.interp(seen_s, *low_passed(channel, sensor, unloaded, motion, span_s))
    return true_reading(channel, sensor, unloaded, motion.at(seen_s))


# Fits of them, and how to spoil one ---------------------------------------------------------------

TWICE = {"second_bump", "hot_damper", "gain"}
"""Where one run is unlike its repeat, and a gain of 2 % on one hub."""


@cache
def campaign(name: str, seed: int) -> Session:
    return stress_session(name, seed)


@cache
def estimated(name: str, seed: int) -> Estimation:
    return fitted(campaign(name, seed))


@cache
def short_campaign(name: str, seed: int) -> Session:
    """Return the campaign with one run of each kind, where that shows what is wrong."""
    return campaign(name, seed) if name in TWICE else stress_session(name, seed, repeats=1)


@cache
def shortly_estimated(name: str, seed: int) -> Estimation:
    return fitted(short_campaign(name, seed))


def fitted(session: Session) -> Estimation:
    records = usable(session).records
    return estimate(grey_box(session, records), records, generic_vehicles())


def with_group(
    session: Session, label: str, channel: str, change: Callable[[SampleGroup], SampleGroup]
) -> Session:
    """Change the sample group that holds a channel, in the runs whose label begins so."""
    return with_runs(
        session,
        lambda run: (
            replace(run, groups=tuple(change(g) if channel in g.values else g for g in run.groups))
            if run.label.startswith(label)
            else run
        ),
    )


def with_runs(session: Session, change: Callable[[Run], Run]) -> Session:
    return replace(session, runs=tuple(change(run) for run in session.runs))


def by_gate(findings: Iterable[Finding]) -> dict[str, Finding]:
    """Return the findings by gate; no gate says two things in these tests."""
    gates: dict[str, Finding] = {}
    for finding in findings:
        assert finding.code not in gates
        assert "\n" not in finding.text
        gates[finding.code] = finding
    return gates


def doubtful(findings: Iterable[Finding]) -> list[str]:
    return [finding.code for finding in findings if finding.severity is not Severity.NOTE]
