"""Simulates sensors: from the motion of the car to reported values in the units of the DBC."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dbc.layout import SignalLayout
from dbc.units import to_si

from ..channels import Channel, Quantity
from ..errors import InputError
from .car import SensorTruth, SimulatedCar, Spread
from .elements import Array
from .engine import Plant
from .motion import Kinematics, Moving
from .plant import GRAVITY_M_S2, corner_motion, static_pose

_FINE_S = 1e-4
"""Time step of the motion at the input of a low-pass, s: wheel accelerations are then accurate to
1e-4 m/s2."""


@dataclass(frozen=True, slots=True)
class Installation:
    """The car on which the sensors are installed."""

    plant: Plant
    """The plant, with the positions of its corners."""
    a_m: float
    """Distance from the CG to the front axle, from which positions are counted, m."""
    design_pose: Array
    """The pose in which the IMU was levelled and the displacements were zeroed: the unloaded car at
    rest, shape (7, 1).  Any other loading therefore gives a constant offset."""
    cg_y_m: float = 0.0
    """Distance of the CG to the left of the middle, from which positions are counted, m."""


def install(unloaded: Plant, car: SimulatedCar) -> Installation:
    """Return the installation, with sensors levelled and zeroed on the unloaded car."""
    pose = static_pose(unloaded)
    return Installation(unloaded, car.parameters.a, pose, car.imperfections.cg_offset_m)


def _yaw_rate(tilt: Array) -> Array:
    """Return zero: a car that bounces on the spot does not turn."""
    return np.zeros(tilt.shape[1])


_SPARE: dict[str, tuple[Quantity, Callable[[Array], Array]]] = {
    # Nose down turns x towards the ground, so that gravity pulls the proof mass forward; left side
    # up turns y away from the ground.
    "IMU_Accel.acc_x": (Quantity.BODY_ACCELERATION, lambda tilt: -GRAVITY_M_S2 * tilt[1]),
    "IMU_Accel.acc_y": (Quantity.BODY_ACCELERATION, lambda tilt: GRAVITY_M_S2 * tilt[2]),
    "IMU_Rate.rate_z": (Quantity.PITCH_RATE, _yaw_rate),
}
"""Signals of the shipped IMU that the method does not use: the kind of sensor, for its errors, and
the reading from the pose relative to the design pose."""


def kind(channel: Channel) -> Quantity:
    """Return the quantity that a channel's sensor measures, also if the channel is not used."""
    if channel.quantity is Quantity.UNUSED and channel.signal in _SPARE:
        return _SPARE[channel.signal][0]
    return channel.quantity


def true_reading(
    channel: Channel, sensor: SensorTruth, car: Installation, motion: Kinematics
) -> Array:
    """Return the reading of a perfect sensor in the true position.

    Rotations are small, as in the plant: an accelerometer's share of gravity is 1 g on z, and
    the tilt angle times 1 g on x and y.

    `sensor`: true position of the sensor.  `motion`: n instants; `daq.vehicle.DOF` is the order of
    its rows.  Returns (n,) float64: in the channel's SI unit.  An unused channel that the simulator
    does not know reads 0.
    """
    moved = motion.pose - car.design_pose
    x_m, y_m = sensor.x_m + car.a_m, sensor.y_m - car.cg_y_m
    wheel = 3 + channel.corner.position if channel.corner is not None else 0
    match channel.quantity:
        case Quantity.BODY_ACCELERATION:
            value = _body_point(motion.acceleration, x_m, y_m) + GRAVITY_M_S2
        case Quantity.BODY_DISPLACEMENT:
            value = _body_point(moved, x_m, y_m)
        case Quantity.PITCH_RATE:
            value = motion.velocity[1]
        case Quantity.ROLL_RATE:
            value = motion.velocity[2]
        case Quantity.PITCH_ACCELERATION:
            value = motion.acceleration[1]
        case Quantity.ROLL_ACCELERATION:
            value = motion.acceleration[2]
        case Quantity.HUB_ACCELERATION:
            value = motion.acceleration[wheel] + GRAVITY_M_S2
        case Quantity.HUB_DISPLACEMENT:
            value = moved[wheel]
        case Quantity.SUSPENSION_TRAVEL:
            value = moved[wheel] - corner_motion(car.plant, moved)[wheel - 3]
        case Quantity.UNUSED:
            _, reading = _SPARE.get(channel.signal, (None, _yaw_rate))
            value = reading(moved)
    return np.asarray(value, dtype=np.float64)


def _body_point(motion: Array, x_m: float, y_m: float) -> Array:
    """Return the vertical motion of a point of the rigid body at (x, y) from the CG."""
    return np.asarray(motion[0] - x_m * motion[1] + y_m * motion[2])


def low_pass(values: Array, step_s: float, cutoff_hz: float, order: int) -> Array:
    """Pass a signal that begins at rest through an analogue Butterworth low-pass.

    The signal is assumed to be straight between the samples, and the filter's response to it is
    exact (first-order hold), so the error falls with the square of the step.

    `values`, (n,) float64: the signal; constant up to its first sample.  `step_s`: time between
    samples, s.  `cutoff_hz` and `order`: the filter; its gain at rest is 1.
    """
    from scipy.signal import butter, cont2discrete, lfilter  # slow to import, seldom needed

    analogue = butter(order, 2.0 * math.pi * cutoff_hz, analog=True)
    numerator, denominator, _ = cont2discrete(analogue, step_s, method="foh")
    change = lfilter(np.ravel(numerator), denominator, values - values[0])
    return np.asarray(values[0] + change, dtype=np.float64)


def low_passed(
    channel: Channel,
    sensor: SensorTruth,
    car: Installation,
    motion: Moving,
    span_s: tuple[float, float],
) -> tuple[Array, Array]:
    """Return the output of a sensor's low-pass for a motion.

    `channel`, `sensor`, `car`: as in `true_reading`.  `span_s`: the requested time span; it begins
    at rest, and so does the filter.  Returns times and values, (n,), close enough for linear
    interpolation; they include the delay of the filter but not the sensor's delay.
    """
    fine_s = np.arange(span_s[0], span_s[1] + _FINE_S, _FINE_S)
    reading = true_reading(channel, sensor, car, motion.at(fine_s))
    return fine_s, low_pass(reading, _FINE_S, sensor.low_pass_hz, sensor.low_pass_order)


def measured(
    channel: Channel, sensor: SensorTruth, noise: Spread, reading: Array, rng: np.random.Generator
) -> Array:
    """Return true readings with bias, white noise, saturation and gain of their sensor, SI, (n,).

    The noise is that of the digitising, after any low-pass; the arguments are those of
    `signal_values`.
    """
    noisy = reading + sensor.bias + noise.of(kind(channel)) * rng.standard_normal(len(reading))
    return np.asarray(sensor.gain * np.clip(noisy, -sensor.limit, sensor.limit))


def signal_values(
    channel: Channel,
    signal: SignalLayout,
    sensor: SensorTruth,
    noise: Spread,
    reading: Array,
    rng: np.random.Generator,
) -> Array:
    """Convert true readings to the values that the sensor puts into its frames.

    `channel`: sign, scale and tare: the recorder computes ``sign * scale * SI(signal) - tare``.
    `signal`: unit and range of the signal.  `sensor`: its bias and its other errors.  `noise`:
    standard deviation of the white noise.  `reading`, (n,) float64: from `true_reading` or
    `low_passed`.  Returns (n,) float64: in the DBC's unit, limited to what the signal's bits can
    express, as a sensor saturates.  Raises InputError if the signal's unit does not measure the
    channel's quantity.
    """
    value = measured(channel, sensor, noise, reading, rng) + channel.tare
    value = value / (channel.sign * channel.scale)
    if channel.quantity is not Quantity.UNUSED or channel.signal in _SPARE:
        si = to_si(signal.unit)
        if channel.unit not in ("", si.unit):
            what = f"is in {channel.unit}, but {channel.signal} is in {signal.unit}"
            advice = "name the right signal or quantity in bench.toml"
            raise InputError(f"channel {channel.name}", what, advice)
        value = (value - si.offset) / si.factor
    return np.asarray(np.clip(value, *signal.span), dtype=np.float64)
