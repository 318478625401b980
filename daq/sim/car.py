"""Defines the simulated car and its sensors, and draws the errors of a complete campaign.

A bench describes its sensors with the accuracy of a person's measurements: a position to a
centimetre, a delay from the data sheet, a weight from the scales.  The simulated bench differs from
this description by errors drawn from the uncertainties stated in bench.toml, so that an interval
computed from them can be tested.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..bench.config import Bench
from ..channels import ON_BODY, SI_UNITS, Channel, Quantity, message_of
from ..errors import InputError
from ..vehicle import (
    FORD_GRANADA,
    PARAMETER_NAMES,
    AddedMass,
    BodyWeight,
    MassState,
    VehicleParameters,
)
from .elements import NONE, Imperfections, means


@dataclass(frozen=True, slots=True)
class Spread:
    """Standard deviations of an error, by kind of sensor."""

    body_acceleration_m_s2: float
    """Accelerometers on the body."""
    hub_acceleration_m_s2: float
    """Accelerometers on the hubs."""
    rate_rad_s: float
    """Gyroscopes."""
    angular_acceleration_rad_s2: float
    """Angular accelerometers, if there are any."""
    displacement_m: float
    """Suspension travel and other displacements."""

    def of(self, quantity: Quantity) -> float:
        """Return the standard deviation for a sensor of `quantity`, SI; 0 for an unused one."""
        by_unit = {
            "rad/s": self.rate_rad_s,
            "rad/s2": self.angular_acceleration_rad_s2,
            "m": self.displacement_m,
            "m/s2": self.body_acceleration_m_s2,
        }
        if quantity is Quantity.HUB_ACCELERATION:
            return self.hub_acceleration_m_s2
        return by_unit.get(SI_UNITS.get(quantity, ""), 0.0)


NOISE = Spread(0.03, 0.15, math.radians(0.1), 0.02, 0.0002)
"""White noise of each sample, for an automotive IMU, rugged hub accelerometers, string pots."""
BIAS = Spread(0.05, 0.2, math.radians(0.2), 0.02, 0.005)
"""Constant error of each sensor; for a displacement, the error of its zero."""


@dataclass(frozen=True, slots=True)
class SensorFault:
    """Deviations of one sensor from its channel's description.

    The order is that of the chain: the motion is delayed, passes the low-pass, gets its offset and
    noise, saturates, and is multiplied by the gain.
    """

    channel: str
    """Name of the channel."""
    gain: float = 1.0
    """Factor on the value: 1.02 for a wrong calibration, -1 for a sensor mounted upside down, 1 /
    9.80665 for g where m/s2 are stated."""
    late_s: float = 0.0
    """Delay in addition to the channel's own delay, s."""
    offset: float = 0.0
    """Constant added, in the channel's SI unit."""
    low_pass_hz: float = 0.0
    """Cut-off frequency (-3 dB) of a Butterworth low-pass, Hz; 0 keeps that of the channel."""
    low_pass_order: int = 2
    """Order of that low-pass."""
    limit: float = math.inf
    """Magnitude, SI, gravity included, at which the sensor saturates in both directions."""


@dataclass(frozen=True, slots=True)
class SimulatedCar:
    """The true car, bump and bench; some values are standard deviations of a draw."""

    parameters: VehicleParameters = FORD_GRANADA
    """The unloaded car."""
    noise: Spread = NOISE
    """Noise of the sensors, in addition to the errors stated in bench.toml."""
    bias: Spread = BIAS
    """Constant errors of the sensors, in addition to those stated in bench.toml."""
    clock_error: float = 10e-6
    """Standard deviation of the relative rate error of each message's clock."""
    jitter_s: float = 50e-6
    """Mean delay of the release of a frame (exponential), s."""
    lead_s: float = 1.3
    """Rest before the bump, s."""
    tail_s: float = 2.8
    """Time from the beginning of the bump to the end of the run, s."""
    imperfections: Imperfections = NONE
    """Effects that the 15 parameters do not describe."""
    faults: tuple[SensorFault, ...] = ()
    """Faults of sensors, at most one entry per channel."""

    @property
    def run_s(self) -> float:
        """Duration of one run, s."""
        return self.lead_s + self.tail_s


@dataclass(frozen=True, slots=True)
class SensorTruth:
    """The true mounting and errors of a sensor."""

    x_m: float
    """True position, forward from the middle of the front axle, m; NaN if it has none."""
    y_m: float
    """True position, to the left, m; NaN if it has none."""
    delay_s: float
    """True delay, s: a frame released at t carries the value at t - delay_s."""
    bias: float
    """Constant error in the channel's SI unit, before gain, sign and tare."""
    low_pass_hz: float = 0.0
    """Cut-off frequency (-3 dB) of its Butterworth low-pass, Hz; 0 means none."""
    low_pass_order: int = 2
    """Order of that low-pass."""
    gain: float = 1.0
    """Ratio of the reading to the measured value, 1 for a healthy sensor."""
    limit: float = math.inf
    """Magnitude, SI, at which it saturates in both directions."""


@dataclass(frozen=True, slots=True)
class ClockTruth:
    """The sampling clock of one message: tick k is at ``phase_s + k cycle_s (1 + error)``."""

    phase: float
    """Time of tick 0 after the start of the campaign, in cycles, 0..1."""
    error: float
    """Relative error of its rate."""


@dataclass(frozen=True, slots=True)
class Truth:
    """All drawn values of one campaign, which are hidden from the identification."""

    parameters: VehicleParameters
    """The unloaded car."""
    mass_states: Mapping[str, AddedMass]
    """The true weights."""
    sensors: Mapping[str, SensorTruth]
    """True position, delay and errors, by channel."""
    clocks: Mapping[str, ClockTruth]
    """True clock of every message that carries a channel."""


def truth(bench: Bench, car: SimulatedCar, seed: int) -> Truth:
    """Draw the differences of a true bench from its description; raises as `draw`."""
    return draw(bench.channels, bench.mass_states, car, seed)


def draw(
    channels: Sequence[Channel], mass_states: Sequence[MassState], car: SimulatedCar, seed: int
) -> Truth:
    """Draw the differences of true sensors and weights from their description.

    `channels` and `mass_states`: the description; its sigmas are the spreads of the draw.  `car`:
    the car and the spreads that the description does not state.  `seed`: the same seed gives the
    same campaign.  Raises InputError if a fault is declared for no channel, or two for the same
    one.
    """
    faults = _faults_by_channel(channels, car.faults)
    rng = np.random.default_rng([seed, 0])
    gain_rng = np.random.default_rng([seed, 4])  # separate: a stated gain changes no other draw
    messages = dict.fromkeys(message_of(channel.signal) for channel in channels)
    # One message is one device: a delay of one of its signals is a delay of all.
    delay_errors = {message: rng.standard_normal() for message in messages}  # in sigmas
    clocks = {
        message: ClockTruth(rng.uniform(), car.clock_error * rng.standard_normal())
        for message in messages
    }
    sensors = {}
    for channel in channels:
        delay_error = delay_errors[message_of(channel.signal)]
        position_error_m = channel.position_sigma_m * rng.standard_normal(2)
        bias = car.bias.of(channel.quantity) * rng.standard_normal()
        cg = (-car.parameters.a, car.imperfections.cg_offset_m)
        x_m, y_m = cg if channel.at_cg else (channel.x_m, channel.y_m)
        on_body = channel.quantity in ON_BODY
        gain = 1.0
        if channel.scale_sigma:
            gain += channel.scale_sigma * float(gain_rng.standard_normal())
        sensor = SensorTruth(
            x_m=x_m + position_error_m[0] if on_body else math.nan,
            y_m=y_m + position_error_m[1] if on_body else math.nan,
            # A sensor cannot be early: a draw below zero gives a sensor without delay.
            delay_s=max(0.0, channel.delay_s + channel.delay_sigma_s * delay_error),
            bias=bias,
            low_pass_hz=channel.low_pass_hz,
            low_pass_order=channel.low_pass_order,
            gain=gain,
        )
        fault = faults.get(channel.name)
        sensors[channel.name] = sensor if fault is None else spoilt(sensor, fault)
    true_loads = {state.name: _true_load(state.added, rng) for state in mass_states}
    return Truth(car.parameters, true_loads, sensors, clocks)


def _faults_by_channel(
    channels: Sequence[Channel], faults: Sequence[SensorFault]
) -> dict[str, SensorFault]:
    """Return the fault of each faulty channel; raises as `draw`."""
    names = [channel.name for channel in channels]
    by_channel: dict[str, SensorFault] = {}
    for fault in faults:
        if fault.channel not in names:
            what = f"no channel {fault.channel!r} for this fault"
            raise InputError("simulated car", what, f"channels are {', '.join(names)}")
        if fault.channel in by_channel:
            what = f"channel {fault.channel} has two faults"
            raise InputError("simulated car", what, "state them as one")
        by_channel[fault.channel] = fault
    return by_channel


def _true_load(added: AddedMass, rng: np.random.Generator) -> AddedMass:
    """Draw the true weights from their stated uncertainties: all masses first, then places."""
    weights = [
        replace(weight, mass_kg=weight.mass_kg + weight.sigma_kg * rng.standard_normal())
        for weight in added.weights
    ]
    for i, weight in enumerate(weights):
        if isinstance(weight, BodyWeight):
            x_m, y_m = weight.position_sigma_m * rng.standard_normal(2)
            weights[i] = replace(weight, x_m=weight.x_m + x_m, y_m=weight.y_m + y_m)
    return replace(added, weights=tuple(weights))


def spoilt(sensor: SensorTruth, fault: SensorFault) -> SensorTruth:
    """Return a sensor with its fault.

    Delays and constant errors add, gains multiply; the fault's limit, and its low-pass if it has
    one, replace those of the sensor.
    """
    has_low_pass = fault.low_pass_hz > 0.0
    return replace(
        sensor,
        delay_s=sensor.delay_s + fault.late_s,
        bias=sensor.bias + fault.offset,
        low_pass_hz=fault.low_pass_hz if has_low_pass else sensor.low_pass_hz,
        low_pass_order=fault.low_pass_order if has_low_pass else sensor.low_pass_order,
        gain=sensor.gain * fault.gain,
        limit=fault.limit,
    )


def true_parameters(car: SimulatedCar) -> dict[str, float]:
    """Return the true parameters; for an axle with unequal corners, the mean of both.

    The 15 first; c_s is the secant of the damper's curve between minus and plus 0.1 m/s.  Then
    `k_af k_ar` anti-roll bars, `c_tf c_tr` tyre damping, `y_s` the CG off the middle, `F_cf F_cr`
    sliding friction of a corner.
    """
    p, i = car.parameters, car.imperfections
    values = asdict(p)
    for name, curve in zip(("c_sf", "c_sr"), i.dampers(p), strict=True):
        values[name] = curve.secant_ns_m
    for kind, factors in (
        ("m_u", i.wheel),
        ("k_s", i.suspension),
        ("k_t", i.tyre),
        ("c_s", i.damper),
    ):
        for axle, mean in zip("fr", means(factors), strict=True):
            values[f"{kind}{axle}"] *= mean
    friction_means = means(i.friction.sides)
    return values | {
        "k_af": i.bar_front_n_m,
        "k_ar": i.bar_rear_n_m,
        "c_tf": i.tyre_damping_front_ns_m,
        "c_tr": i.tyre_damping_rear_ns_m,
        "y_s": i.cg_offset_m,
        "F_cf": i.friction.front_n * friction_means[0],
        "F_cr": i.friction.rear_n * friction_means[1],
    }


def present_parameters(car: SimulatedCar) -> dict[str, float]:
    """Return the true parameters, without those beyond the 15 that the car does not have."""
    values = true_parameters(car)
    return {n: value for n, value in values.items() if n in PARAMETER_NAMES or value != 0.0}
