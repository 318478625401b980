"""The classes of the planner: sensors, runs, and a bench session that is planned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from daq.channels import SI_UNITS, Channel, Quantity
from daq.runs import Excitation
from daq.vehicle import Fact, MassState, Structure, VehicleGeometry
from dbc.errors import InputError
from dbc.frames import read_only

from ..model.matrices import FULL_NAMES, SYMMETRIC
from ..model.response import Bump
from .expected_elements import ExpectedElements

TYPICAL_NOISE: Mapping[Quantity, float] = MappingProxyType(
    {
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
)
"""Noise of one sample, rms, SI, that a usual sensor of each quantity has on a usual car."""

_RATES_HZ = (40.0, 5_000.0)  # four times the wheel modes; more than any sensor of a car


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
        lowest, highest = _RATES_HZ
        if not lowest <= self.rate_hz <= highest:
            what = f"{self.rate_hz:g} samples a second"
            raise InputError(where, what, f"plan with {lowest:g} to {highest:g}")
        if not 0.0 < self.noise < np.inf:
            raise InputError(where, f"noise of {self.noise:g}", "give one above 0")


def full_vector(parameters: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the parameters of a vehicle of any structure, (28,), by their names.

    A name without a side sets both corners; parameters that are not named are zero.
    """
    values = [parameters.get(name, parameters.get(name[:-1], 0.0)) for name in FULL_NAMES]
    return np.array(values)


def sensor(channel: Channel, rate_hz: float) -> Sensor:
    """Return a sensor with the usual noise of its quantity (`TYPICAL_NOISE`)."""
    return Sensor(channel, TYPICAL_NOISE[channel.quantity], rate_hz)


def sensors_of(channels: Iterable[Channel], rate_hz: float) -> tuple[Sensor, ...]:
    """Return the sensors of all used channels, with the usual noise, all at one rate."""
    return tuple(sensor(c, rate_hz) for c in channels if c.quantity in SI_UNITS)


@dataclass(frozen=True, slots=True)
class Runs:
    """Some runs that are alike."""

    mass_state: str
    """Name of the mass state."""
    excitation: Excitation
    """Kind of bump."""
    repeats: int = 1
    """Number of repeats."""
    height_m: float | None = None
    """Height of their bump, m; None: that of the plan."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A planned bench session.

    Raises InputError if there is no sensor, a channel or a mass state is named twice, a run is in
    an unknown mass state, or a height or time is not positive.
    """

    vehicle: NDArray[np.float64]
    """Expected parameters: those of the symmetric vehicle in the order of
    `daq.vehicle.PARAMETER_NAMES`, or all of `identify.model.matrices.FULL_NAMES`; stored as the
    latter."""
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
    elements: ExpectedElements | None = None
    """Friction, damper curves and further elements of a real car; None for a linear one.  They then
    determine, instead of `structure`, which of the bars, tyre damping and CG offset are unknown."""

    def __post_init__(self) -> None:
        given = np.array(self.vehicle, dtype=float)
        full = SYMMETRIC @ given if given.shape == SYMMETRIC.shape[1:] else given
        if full.shape != (len(FULL_NAMES),):
            raise ValueError(f"a vehicle has 15 or {len(FULL_NAMES)} parameters, not {given.shape}")
        object.__setattr__(self, "vehicle", read_only(full))
        if not self.sensors:
            raise InputError("plan", "no sensor that the model knows", "map sensors to quantities")
        for kind, names in (
            ("channel", [s.channel.name for s in self.sensors]),
            ("mass state", [s.name for s in self.mass_states]),
        ):
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise InputError("plan", f"{kind} {twice[0]} occurs twice", "name each once")
        strange = {r.mass_state for r in self.runs} - {s.name for s in self.mass_states}
        if strange:
            what = f"runs in the mass state {min(strange)}, which is not described"
            raise InputError("plan", what, "describe its weights")
        for what, value in (
            *((f"a bump of {h * 1e3:g} mm", h) for h in map(self.height_m, self.runs)),
            (f"a bump of {self.bump.height_m * 1e3:g} mm", self.bump.height_m),
            (f"a bump of {self.bump.duration_s:g} s", self.bump.duration_s),
            (f"a free decay of {self.decay_s:g} s", self.decay_s),
        ):
            if not 0.0 < value < np.inf:
                raise InputError("plan", what, "give a size above 0")

    def height_m(self, runs: Runs) -> float:
        """Return the height of the bump of some runs, m."""
        return self.bump.height_m if runs.height_m is None else runs.height_m
