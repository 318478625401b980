"""Defines the simulated car and its sensors: their drawn errors, and what the sensors report.

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

from dbc.codec import SignalLayout

from ..channels import ON_BODY, SI_UNITS, Channel, Quantity, message_of
from ..samples.mapping import si_unit
from ..vehicle import FORD_GRANADA, AddedMass, BodyWeight, MassState, VehicleParameters
from .motion import GRAVITY_M_S2, Array, Kinematics, Moving, Plant, load_car


@dataclass(frozen=True, slots=True)
class Spread:
    """Standard deviations of an error, by kind of sensor."""

    body_acceleration_m_s2: float
    hub_acceleration_m_s2: float
    rate_rad_s: float
    angular_acceleration_rad_s2: float
    displacement_m: float

    def of(self, quantity: Quantity, unit: str) -> float:
        """Return the standard deviation for a sensor of `quantity` in an SI unit; 0 for others."""
        if quantity is Quantity.HUB_ACCELERATION:
            return self.hub_acceleration_m_s2
        by_unit = {
            "rad/s": self.rate_rad_s,
            "rad/s2": self.angular_acceleration_rad_s2,
            "m": self.displacement_m,
            "m/s2": self.body_acceleration_m_s2,
        }
        return by_unit.get(unit, 0.0)


NOISE = Spread(0.03, 0.15, math.radians(0.1), 0.02, 0.0002)
"""White noise of each sample, for an automotive IMU, rugged hub accelerometers, string pots."""
BIAS = Spread(0.05, 0.2, math.radians(0.2), 0.02, 0.005)
"""Constant error of each sensor; for a displacement, the error of its zero."""


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

    mass_states: Mapping[str, AddedMass]
    """True weights, by mass state."""
    sensors: Mapping[str, SensorTruth]
    """True position, delay and errors, by channel."""
    clocks: Mapping[str, ClockTruth]
    """True clock of every message that carries a channel."""


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

    @property
    def run_s(self) -> float:
        """Duration of one run, s."""
        return self.lead_s + self.tail_s

    def plant(self, added: AddedMass) -> Plant:
        """Return the car with weights."""
        return load_car(self.parameters, added)

    def draw(
        self, channels: Sequence[Channel], mass_states: Sequence[MassState], seed: int
    ) -> Truth:
        """Return true sensors, clocks and weights, which differ from their description by a draw.

        `channels` and `mass_states`: the description; its sigmas are the spreads of the draw.
        `seed`: the same seed gives the same campaign.
        """
        rng = np.random.default_rng([seed, 0])
        gain_rng = np.random.default_rng([seed, 4])  # separate: a stated gain changes no other draw
        messages = dict.fromkeys(message_of(channel.signal) for channel in channels)
        # One message is one device: a delay of one of its signals is a delay of all.
        delay_in_sigmas = {message: rng.standard_normal() for message in messages}
        clocks = {
            message: ClockTruth(rng.uniform(), self.clock_error * rng.standard_normal())
            for message in messages
        }
        cg = (-self.parameters.a, self.plant(AddedMass()).cg_left_m)
        sensors = {}
        for channel in channels:
            delay_error_s = channel.delay_sigma_s * delay_in_sigmas[message_of(channel.signal)]
            position_error_m = channel.position_sigma_m * rng.standard_normal(2)
            unit = SI_UNITS.get(channel.quantity, "")
            bias = self.bias.of(channel.quantity, unit) * rng.standard_normal()
            x_m, y_m = cg if channel.at_cg else (channel.x_m, channel.y_m)
            has_position = channel.quantity in ON_BODY
            gain = 1.0
            if channel.scale_sigma:
                gain += channel.scale_sigma * float(gain_rng.standard_normal())
            sensors[channel.name] = SensorTruth(
                x_m=x_m + position_error_m[0] if has_position else math.nan,
                y_m=y_m + position_error_m[1] if has_position else math.nan,
                # A sensor cannot be early: a draw below zero gives a sensor without delay.
                delay_s=max(0.0, channel.delay_s + delay_error_s),
                bias=bias,
                low_pass_hz=channel.low_pass_hz,
                low_pass_order=channel.low_pass_order,
                gain=gain,
            )
        loads = {state.name: _drawn_load(state.added, rng) for state in mass_states}
        return Truth(loads, sensors, clocks)


def _drawn_load(stated: AddedMass, rng: np.random.Generator) -> AddedMass:
    """Return weights whose masses and places differ from the stated ones by drawn errors."""
    weights = [
        replace(weight, mass_kg=weight.mass_kg + weight.sigma_kg * rng.standard_normal())
        for weight in stated.weights
    ]
    for i, weight in enumerate(weights):
        if isinstance(weight, BodyWeight):
            dx_m, dy_m = weight.position_sigma_m * rng.standard_normal(2)
            weights[i] = replace(weight, x_m=weight.x_m + dx_m, y_m=weight.y_m + dy_m)
    return replace(stated, weights=tuple(weights))


_FINE_S = 1e-4
"""Time step at the input of a low-pass, s: wheel accelerations are accurate to 1e-4 m/s2."""


def true_reading(
    channel: Channel, sensor: SensorTruth, unloaded: Plant, motion: Kinematics
) -> Array:
    """Return the reading of a perfect sensor in the true position.

    Rotations are small, as in the plant: a vertical accelerometer reads 1 g at rest.

    `sensor`: true position of the sensor.  `unloaded`: the car on which displacements were zeroed
    at rest; any other loading gives them a constant offset.  `motion`: n instants;
    `daq.vehicle.DOF` is the order of its rows.  Returns (n,) float64: in the channel's SI unit; an
    unused channel reads 0.
    """
    moved = motion.pose - unloaded.rest
    # From the CG, not from the middle of the front axle.
    x_m, y_m = sensor.x_m + float(unloaded.x_m[0, 0]), sensor.y_m - unloaded.cg_left_m
    wheel = 3 + (channel.corner.position if channel.corner is not None else 0)
    reading_of = {
        Quantity.BODY_ACCELERATION: _body_point(motion.acceleration, x_m, y_m) + GRAVITY_M_S2,
        Quantity.BODY_DISPLACEMENT: _body_point(moved, x_m, y_m),
        Quantity.PITCH_RATE: motion.velocity[1],
        Quantity.ROLL_RATE: motion.velocity[2],
        Quantity.PITCH_ACCELERATION: motion.acceleration[1],
        Quantity.ROLL_ACCELERATION: motion.acceleration[2],
        Quantity.HUB_ACCELERATION: motion.acceleration[wheel] + GRAVITY_M_S2,
        Quantity.HUB_DISPLACEMENT: moved[wheel],
        Quantity.SUSPENSION_TRAVEL: moved[wheel] - unloaded.at_corners(moved)[wheel - 3],
        Quantity.UNUSED: np.zeros(moved.shape[1]),
    }
    return np.asarray(reading_of[channel.quantity], dtype=np.float64)


def _body_point(motion: Array, x_m: float, y_m: float) -> Array:
    """Return the vertical motion of a point of the rigid body at (x, y) from the CG."""
    return np.asarray(motion[0] - x_m * motion[1] + y_m * motion[2])


def low_pass(values: Array, step_s: float, cutoff_hz: float, order: int) -> Array:
    """Return a signal that begins at rest after an analogue Butterworth low-pass.

    The signal is assumed to be straight between the samples, and the filter's response to it is
    exact (first-order hold), so the error falls with the square of the step.

    `values`, (n,) float64: the signal; constant up to its first sample.  `step_s`: time between
    samples, s.  `cutoff_hz` and `order`: the filter; its gain at rest is 1.
    """
    from scipy.signal import butter, cont2discrete, lfilter  # slow to import, seldom needed

    analogue = butter(order, 2.0 * math.pi * cutoff_hz, analog=True)
    numerator, denominator, _ = cont2discrete(analogue, step_s, method="foh")
    from_rest = lfilter(np.ravel(numerator), denominator, values - values[0])
    return np.asarray(values[0] + from_rest, dtype=np.float64)


def low_passed(
    channel: Channel,
    sensor: SensorTruth,
    unloaded: Plant,
    motion: Moving,
    span_s: tuple[float, float],
) -> tuple[Array, Array]:
    """Return the output of a sensor's low-pass for a motion.

    `channel`, `sensor`, `unloaded`: as in `true_reading`.  `span_s`: the requested time span; it
    begins at rest, and so does the filter.  Returns times and values, (n,), close enough for linear
    interpolation; they include the delay of the filter but not the sensor's delay.
    """
    fine_s = np.arange(span_s[0], span_s[1] + _FINE_S, _FINE_S)
    reading = true_reading(channel, sensor, unloaded, motion.at(fine_s))
    return fine_s, low_pass(reading, _FINE_S, sensor.low_pass_hz, sensor.low_pass_order)


def measured(
    channel: Channel, sensor: SensorTruth, noise: Spread, reading: Array, rng: np.random.Generator
) -> Array:
    """Return true readings with bias, white noise, saturation and gain of their sensor, SI, (n,).

    The noise is that of the digitising, after any low-pass.
    """
    sigma = noise.of(channel.quantity, channel.unit or SI_UNITS.get(channel.quantity, ""))
    noisy = reading + sensor.bias + sigma * rng.standard_normal(len(reading))
    return np.asarray(sensor.gain * np.clip(noisy, -sensor.limit, sensor.limit))


def signal_values(
    channel: Channel,
    signal: SignalLayout,
    sensor: SensorTruth,
    noise: Spread,
    reading: Array,
    rng: np.random.Generator,
) -> Array:
    """Return the values, (n,), that a sensor puts into its frames for true readings, (n,) SI.

    They undo what the recorder computes from sign, scale, tare and unit, and saturate at what the
    signal's bits can express.  Raises InputError if the signal's unit does not fit the quantity.
    """
    si = si_unit(channel, signal.unit, "the database")
    value = measured(replace(channel, unit=si.unit), sensor, noise, reading, rng) + channel.tare
    value = (value / (channel.sign * channel.scale) - si.offset) / si.factor
    return np.asarray(np.clip(value, *signal.span), dtype=np.float64)
