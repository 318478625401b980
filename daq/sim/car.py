"""Defines the simulated car and its sensors, and draws the errors of a complete campaign.

A bench describes its sensors with the accuracy of a person's measurements: a position to a
centimetre, a delay from the data sheet, a weight from the scales.  The simulated bench differs from
this description by errors drawn from the uncertainties stated in bench.toml, so that an interval
computed from them can be tested.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..bench.config import Bench
from ..channels import ON_BODY, Channel, Quantity
from ..errors import InputError
from ..signal_names import message_of
from ..vehicle import FORD_GRANADA, AddedMass, BodyWeight, MassState, VehicleParameters
from .faults import SensorFault
from .imperfections import NONE, Imperfections


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
        match quantity:
            case Quantity.UNUSED:
                return 0.0
            case Quantity.BODY_ACCELERATION:
                return self.body_acceleration_m_s2
            case Quantity.HUB_ACCELERATION:
                return self.hub_acceleration_m_s2
            case Quantity.PITCH_RATE | Quantity.ROLL_RATE:
                return self.rate_rad_s
            case Quantity.PITCH_ACCELERATION | Quantity.ROLL_ACCELERATION:
                return self.angular_acceleration_rad_s2
        return self.displacement_m


NOISE = Spread(0.03, 0.15, math.radians(0.1), 0.02, 0.0002)
"""White noise of each sample, for an automotive IMU, rugged hub accelerometers, string pots."""
BIAS = Spread(0.05, 0.2, math.radians(0.2), 0.02, 0.005)
"""Constant error of each sensor; for a displacement, the error of its zero."""


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
    faults = _by_channel(car.faults, [channel.name for channel in channels])
    rng = np.random.default_rng([seed, 0])
    gains = np.random.default_rng([seed, 4])  # its own: stated gains leave the other draws alone
    messages = dict.fromkeys(message_of(channel.signal) for channel in channels)
    # One message is one device: a delay of one of its signals is a delay of all.
    lateness = {message: rng.standard_normal() for message in messages}
    clocks = {
        message: ClockTruth(rng.uniform(), car.clock_error * rng.standard_normal())
        for message in messages
    }
    sensors = {}
    for channel in channels:
        late = lateness[message_of(channel.signal)]
        slip = channel.position_sigma_m * rng.standard_normal(2)
        bias = car.bias.of(channel.quantity) * rng.standard_normal()
        cg = (-car.parameters.a, car.imperfections.cg_offset_m)
        x_m, y_m = cg if channel.at_cg else (channel.x_m, channel.y_m)
        on_body = channel.quantity in ON_BODY
        sensor = SensorTruth(
            x_m=x_m + slip[0] if on_body else math.nan,
            y_m=y_m + slip[1] if on_body else math.nan,
            # A sensor cannot be early: a draw below zero gives a sensor without delay.
            delay_s=max(0.0, channel.delay_s + channel.delay_sigma_s * late),
            bias=bias,
            low_pass_hz=channel.low_pass_hz,
            low_pass_order=channel.low_pass_order,
            gain=_true_gain(channel, gains),
        )
        fault = faults.get(channel.name)
        sensors[channel.name] = sensor if fault is None else spoilt(sensor, fault)
    loads = {state.name: _as_loaded(state.added, rng) for state in mass_states}
    return Truth(car.parameters, loads, sensors, clocks)


def _true_gain(channel: Channel, rng: np.random.Generator) -> float:
    """Return the ratio of the true to the stated scale of the sensor."""
    if not channel.scale_sigma:
        return 1.0
    return 1.0 + channel.scale_sigma * float(rng.standard_normal())


def spoilt(sensor: SensorTruth, fault: SensorFault) -> SensorTruth:
    """Return a sensor with its fault."""
    filtered = fault.low_pass_hz > 0.0
    return replace(
        sensor,
        delay_s=sensor.delay_s + fault.late_s,
        bias=sensor.bias + fault.offset,
        low_pass_hz=fault.low_pass_hz if filtered else sensor.low_pass_hz,
        low_pass_order=fault.low_pass_order if filtered else sensor.low_pass_order,
        gain=sensor.gain * fault.gain,
        limit=fault.limit,
    )


def _by_channel(faults: tuple[SensorFault, ...], channels: list[str]) -> dict[str, SensorFault]:
    result: dict[str, SensorFault] = {}
    for fault in faults:
        if fault.channel not in channels:
            what = f"no channel {fault.channel!r} for this fault"
            raise InputError("simulated car", what, f"channels are {', '.join(channels)}")
        if fault.channel in result:
            what = f"channel {fault.channel} has two faults"
            raise InputError("simulated car", what, "state them as one")
        result[fault.channel] = fault
    return result


def _as_loaded(added: AddedMass, rng: np.random.Generator) -> AddedMass:
    """Return the true weights for the weights as measured by scales and tape."""
    weighed = [
        replace(weight, mass_kg=weight.mass_kg + weight.sigma_kg * rng.standard_normal())
        for weight in added.weights
    ]
    placed = (
        replace(
            weight,
            x_m=weight.x_m + weight.position_sigma_m * rng.standard_normal(),
            y_m=weight.y_m + weight.position_sigma_m * rng.standard_normal(),
        )
        if isinstance(weight, BodyWeight)
        else weight
        for weight in weighed
    )
    return replace(added, weights=tuple(placed))
