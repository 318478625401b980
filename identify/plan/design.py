"""A planned campaign: sensors, weights and runs, and the steps that could improve it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import SI_UNITS, Channel, Quantity
from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
    VehicleGeometry,
)
from dbc.frames import read_only
from dbc.words import InputError

from ..model.matrices import CORNERS, FULL_NAMES, SYMMETRIC
from ..model.response import Bump

TYPICAL_NOISE: Mapping[Quantity, float] = {
    Quantity.BODY_ACCELERATION: 0.03,
    Quantity.PITCH_RATE: float(np.radians(0.1)),
    Quantity.ROLL_RATE: float(np.radians(0.1)),
    # Of two body accelerations 1.4 m apart.
    Quantity.PITCH_ACCELERATION: 0.03,
    Quantity.ROLL_ACCELERATION: 0.03,
    Quantity.HUB_ACCELERATION: 0.15,
    Quantity.SUSPENSION_TRAVEL: 0.2e-3,
    Quantity.BODY_DISPLACEMENT: 0.2e-3,
    Quantity.HUB_DISPLACEMENT: 0.2e-3,
}
"""Noise of one sample, rms, SI, that a usual sensor of each quantity has on a usual car."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """A channel, with the noise and rate of its samples."""

    channel: Channel
    """Quantity and place of the sensor."""
    noise: float
    """Standard deviation of the white noise of one sample, SI."""
    rate_hz: float
    """Samples a second."""

    def __post_init__(self) -> None:
        where = f"channel {self.channel.name}"
        lowest, highest = 40.0, 5_000.0  # Hz: four times the wheel modes; more than any sensor
        if not lowest <= self.rate_hz <= highest:
            rate = f"{self.rate_hz:g} samples a second"
            raise InputError(where, rate, f"plan with {lowest:g} to {highest:g}")
        if not 0.0 < self.noise < np.inf:
            raise InputError(where, f"noise of {self.noise:g}", "give one above 0")


def full_vector(parameters: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the full parameters, (28,), of a vehicle of any structure from those by name.

    A name without a side sets both corners; parameters that are not named are zero.
    """
    values = [parameters.get(name, parameters.get(name[:-1], 0.0)) for name in FULL_NAMES]
    return np.array(values)


def sensor(channel: Channel, rate_hz: float) -> Sensor:
    """Return a sensor with the usual noise of its quantity (`TYPICAL_NOISE`)."""
    return Sensor(channel, TYPICAL_NOISE[channel.quantity], rate_hz)


@dataclass(frozen=True, slots=True)
class Runs:
    """Some runs that are alike."""

    mass_state: str
    """Name of the mass state."""
    excitation: Excitation
    """Kind of bump."""
    repeats: int = 1
    """Number of repeats."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A planned bench session.

    Raises InputError if there is no sensor, a channel or a mass state is named twice, a run is in
    an unknown mass state, or a height or time is not positive.
    """

    vehicle: NDArray[np.float64]
    """Expected parameters: those of the symmetric vehicle, (15,), in the order of
    `daq.vehicle.PARAMETER_NAMES`, or all of `identify.model.matrices.FULL_NAMES`, (28,); stored as
    the latter."""
    sensors: tuple[Sensor, ...]
    """Sensors of every run."""
    mass_states: tuple[MassState, ...]
    """Loading of the vehicle, with the weights."""
    runs: tuple[Runs, ...]
    """Runs to be recorded."""
    bump: Bump = field(default_factory=lambda: Bump(height_m=0.05))
    """Height and duration of the bump; its start does not matter."""
    decay_s: float = 2.5
    """Recorded duration of each free decay, from the end of the bump, s."""
    geometry: VehicleGeometry | None = None
    """The four lengths where they are measured beforehand; their values are those of `vehicle`."""
    structure: Structure = field(default_factory=Structure)
    """Structure of the vehicle: the parameters to be identified."""
    facts: tuple[Fact, ...] = ()
    """Readings of scales and tape measure; only their uncertainty counts."""

    def __post_init__(self) -> None:
        given = np.array(self.vehicle, dtype=float)
        full = SYMMETRIC @ given if given.shape == SYMMETRIC.shape[1:] else given
        object.__setattr__(self, "vehicle", read_only(full))
        if not self.sensors:
            raise InputError("plan", "no sensor that the model knows", "map sensors to quantities")
        for kind, names in (
            ("channel", [s.channel.name for s in self.sensors]),
            ("mass state", [s.name for s in self.mass_states]),
        ):
            repeated = [name for name in names if names.count(name) > 1]
            if repeated:
                raise InputError("plan", f"{kind} {repeated[0]} occurs twice", "name each once")
        undescribed = {r.mass_state for r in self.runs} - {s.name for s in self.mass_states}
        if undescribed:
            runs = f"runs in the mass state {min(undescribed)}, which is not described"
            raise InputError("plan", runs, "describe its weights")
        for words, value in (
            (f"a bump of {self.bump.height_m * 1e3:g} mm", self.bump.height_m),
            (f"a bump of {self.bump.duration_s:g} s", self.bump.duration_s),
            (f"a free decay of {self.decay_s:g} s", self.decay_s),
        ):
            if not 0.0 < value < np.inf:
                raise InputError("plan", words, "give a size above 0")


# Possible next steps, in the operator's words -----------------------------------------------------

HIGHEST_BUMP_M = 0.05
"""Above this a wheel may lift off the ground (docs/method.md, "Excitation")."""

_HIGHEST_RATE_HZ = 1000.0  # of samples that a step asks for
_HUB_KG, _FLOOR_KG = 5.0, 30.0  # weights on one hub, and on the floor near one wheel
_SCALES_KG, _TAPE_M = 1.0, 0.003  # standard uncertainties
_AXLES = (FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE)
_LENGTHS = (FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK)


@dataclass(frozen=True, slots=True)
class Candidate:
    """One possible step."""

    action: str
    """Instruction to the operator."""
    plan: Plan
    """The plan with this step done."""


def candidates(plan: Plan) -> tuple[Candidate, ...]:
    """Return all additions to a plan that are worth considering."""
    return (
        *_with_more_runs(plan), *_with_higher_bump(plan), *_with_faster_samples(plan),
        *_with_new_sensors(plan), *_with_weights(plan), *_with_measured_facts(plan),
    )  # fmt: skip


def _with_more_runs(plan: Plan) -> Iterator[Candidate]:
    """Yield plans with one more run of each kind in each mass state."""
    planned = {(runs.mass_state, runs.excitation) for runs in plan.runs}
    for state in plan.mass_states:
        for excitation in Excitation:
            is_planned = (state.name, excitation) in planned
            action = f"one {'more ' * is_planned}{excitation.words} run in mass state {state.name}"
            yield Candidate(action, replace(plan, runs=(*plan.runs, Runs(state.name, excitation))))


def _with_higher_bump(plan: Plan) -> Iterator[Candidate]:
    """Yield the plan with the highest bump, unless its own is as high."""
    if plan.bump.height_m < HIGHEST_BUMP_M:
        now_mm, then_mm = plan.bump.height_m * 1e3, HIGHEST_BUMP_M * 1e3
        action = f"a bump of {then_mm:.3g} mm instead of {now_mm:.3g} mm"
        yield Candidate(action, replace(plan, bump=replace(plan.bump, height_m=HIGHEST_BUMP_M)))


def _with_faster_samples(plan: Plan) -> Iterator[Candidate]:
    """Yield the plan with twice the rate of slow sensors, up to `_HIGHEST_RATE_HZ`, if any is."""
    slow = [s for s in plan.sensors if s.rate_hz < _HIGHEST_RATE_HZ]
    if slow:
        rates = [max(s.rate_hz, min(2.0 * s.rate_hz, _HIGHEST_RATE_HZ)) for s in plan.sensors]
        faster = tuple(replace(s, rate_hz=r) for s, r in zip(plan.sensors, rates, strict=True))
        least_hz = min(2.0 * min(s.rate_hz for s in slow), _HIGHEST_RATE_HZ)
        action = f"sample at {least_hz:.0f} Hz or more, if a sample is then no noisier"
        yield Candidate(action, replace(plan, sensors=faster))


def _with_new_sensors(plan: Plan) -> Iterator[Candidate]:
    """Yield plans with one more kind of sensor each, where the plan lacks it."""
    present = [s.channel for s in plan.sensors]
    rate_hz = max(s.rate_hz for s in plan.sensors)
    for quantity, sensor_words in (
        (Quantity.HUB_ACCELERATION, "an accelerometer on the hub"),
        (Quantity.SUSPENSION_TRAVEL, "a travel sensor on the suspension"),
    ):
        corners_with = {c.corner for c in present if c.quantity is quantity}
        missing = [corner for corner in Corner if corner not in corners_with]
        if missing:
            new_sensors = [_new_sensor(quantity, rate_hz, corner) for corner in missing]
            yield _with_sensors(plan, f"{sensor_words} at {', '.join(missing)}", new_sensors)
    places = {(c.x_m, c.y_m, c.at_cg) for c in present if c.quantity is Quantity.BODY_ACCELERATION}
    if len(places) < 3:
        new_sensors = []
        for corner in Corner:
            x, y = _above_wheel(plan, corner)
            name = f"new_{Quantity.BODY_ACCELERATION}_{corner}"
            channel = Channel(name, Quantity.BODY_ACCELERATION, "m/s2", x_m=x, y_m=y)
            new_sensors.append(sensor(channel, rate_hz))
        yield _with_sensors(plan, "accelerometers on the body above the four wheels", new_sensors)
    quantities = {c.quantity for c in present}
    for rate_quantity, acceleration, quantity_words in (
        (Quantity.PITCH_RATE, Quantity.PITCH_ACCELERATION, "pitch rate"),
        (Quantity.ROLL_RATE, Quantity.ROLL_ACCELERATION, "roll rate"),
    ):
        if not quantities & {rate_quantity, acceleration}:
            action = f"a gyro for the {quantity_words} of the body"
            yield _with_sensors(plan, action, [_new_sensor(rate_quantity, rate_hz)])


def _new_sensor(quantity: Quantity, rate_hz: float, corner: Corner | None = None) -> Sensor:
    """Return a sensor that the bench does not have; on the body without a corner."""
    name = f"new_{quantity}_{corner or 'body'}"
    return sensor(Channel(name, quantity, SI_UNITS[quantity], corner=corner), rate_hz)


def _above_wheel(plan: Plan, corner: Corner) -> tuple[float, float]:
    """Return a wheel's place, m from the front axle and from the middle, forward and left."""
    # In the order of `FULL_NAMES`; t_f and t_r are half a track.
    a, b, t_f, t_r = plan.vehicle[FULL_NAMES.index("a") :][:4].tolist()
    return (0.0, corner.side * t_f) if corner.front else (-a - b, corner.side * t_r)


def _with_sensors(plan: Plan, action: str, new_sensors: list[Sensor]) -> Candidate:
    """Return the step of adding sensors; their gain and place are known as the bench's worst."""
    sigmas = {
        name: max(getattr(s.channel, name) for s in plan.sensors)
        for name in ("gain_sigma", "position_sigma_m")
    }
    described = (replace(s, channel=replace(s.channel, **sigmas)) for s in new_sensors)
    return Candidate(action, replace(plan, sensors=(*plan.sensors, *described)))


def _with_weights(plan: Plan) -> Iterator[Candidate]:
    """Yield plans with weights; where there are some, with more of them."""
    hubs = tuple(HubWeight(_HUB_KG, corner) for corner in Corner)
    floor = tuple(BodyWeight(_FLOOR_KG, *_above_wheel(plan, corner)) for corner in Corner)
    loaded = next((s for s in plan.mass_states if s.added.weights or s.added.matrix.any()), None)
    for weights, kg, where in (
        (hubs, _HUB_KG, "on every hub"),
        (floor, _FLOOR_KG, "on the floor near each wheel"),
    ):
        if loaded is None:
            action = (
                f"{kg:.0f} kg {where} as mass state {ADDED}, with one run of each kind at least"
            )
            others = (s for s in plan.mass_states if s.name != ADDED)
            states = (*others, MassState(ADDED, AddedMass(weights)))
            planned = {r.excitation for r in plan.runs if r.mass_state == ADDED}
            missing = dict.fromkeys(r.excitation for r in plan.runs if r.excitation not in planned)
            runs = (*plan.runs, *(Runs(ADDED, excitation) for excitation in missing))
            yield Candidate(action, replace(plan, mass_states=states, runs=runs))
        elif any(r.mass_state == loaded.name for r in plan.runs):  # else a run comes first
            action = f"{kg:.0f} kg more {where} in mass state {loaded.name}"
            added = AddedMass((*loaded.added.weights, *weights), loaded.added.matrix)
            states = tuple(replace(s, added=added) if s is loaded else s for s in plan.mass_states)
            yield Candidate(action, replace(plan, mass_states=states))


def _with_measured_facts(plan: Plan) -> Iterator[Candidate]:
    """Yield plans with readings of scales or tape, of what does not follow from known facts."""
    known = {fact.quantity for fact in plan.facts}
    has_corner_loads = known >= set(CORNERS)
    has_axle_loads = has_corner_loads or known >= set(_AXLES)
    has_total_and_axle = known & {FactQuantity.TOTAL_MASS} and known & set(_AXLES)
    if not (has_axle_loads or has_total_and_axle):
        if FactQuantity.TOTAL_MASS not in known:
            total = (FactQuantity.TOTAL_MASS,)
            yield Candidate("weigh the vehicle to 1 kg", _with_facts(plan, total, _SCALES_KG))
        yield Candidate("weigh each axle to 1 kg", _with_facts(plan, _AXLES, _SCALES_KG))
    lengths = [q for q in _LENGTHS if q not in known]
    if lengths and plan.geometry is None:
        names = ", ".join(q.removesuffix("_m").replace("_", " ") for q in lengths)
        action = f"measure {names} by tape to {_TAPE_M * 1e3:g} mm"
        yield Candidate(action, _with_facts(plan, lengths, _TAPE_M))


def _with_facts(plan: Plan, quantities: Sequence[FactQuantity], sigma: float) -> Plan:
    """Return a plan with more facts; their values do not matter: only the uncertainty informs."""
    new_facts = (Fact(quantity, 0.0, sigma) for quantity in quantities)
    return replace(plan, facts=(*plan.facts, *new_facts))


# Whole campaigns to compare with a plan -----------------------------------------------------------


def campaigns(plan: Plan) -> tuple[Candidate, ...]:
    """Return campaigns of one run of each planned kind, with the plan's sensors and bumps of 50 mm.

    The first has scales instead of weights; the second a tape measure, too, unless the geometry is
    measured; the third all mass states, if any has weights.  Empty if the plan has no runs.
    """
    kinds = tuple(dict.fromkeys(runs.excitation for runs in plan.runs))
    loaded = [s for s in plan.mass_states if s.added.weights or s.added.matrix.any()]
    baseline = next((s for s in plan.mass_states if s not in loaded), MassState(BASELINE))
    if not kinds:
        return ()

    def once(*states: MassState) -> Plan:
        """Return the plan with these mass states alone, one run of each kind, the highest bump."""
        runs = tuple(Runs(state.name, kind) for state in states for kind in kinds)
        bump = replace(plan.bump, height_m=HIGHEST_BUMP_M)
        return replace(plan, mass_states=states, runs=runs, bump=bump)

    names = ", ".join(kind.words for kind in kinds)
    known = {fact.quantity for fact in plan.facts}
    unknown_loads = [q for q in (FactQuantity.TOTAL_MASS, *_AXLES) if q not in known]
    unknown_lengths = [q for q in _LENGTHS if q not in known]
    weighed = _with_facts(once(baseline), unknown_loads, _SCALES_KG)
    action = f"{names} once, no weights, axles weighed to 1 kg"
    alternatives = [Candidate(action, weighed)]
    if not plan.geometry:
        taped = _with_facts(weighed, unknown_lengths, _TAPE_M)
        alternatives.append(Candidate(f"{action}, wheelbase and tracks by tape", taped))
    if loaded:
        action = f"{names} once in each mass state, bumps of {HIGHEST_BUMP_M * 1e3:g} mm"
        alternatives.append(Candidate(action, once(baseline, *loaded)))
    return tuple(alternatives)
