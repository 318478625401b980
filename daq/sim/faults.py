"""Defines faults of sensors, for the simulated bench, unknown to bench.toml."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .plant import Array


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
    moved = lfilter(np.ravel(numerator), denominator, values - values[0])
    return np.asarray(values[0] + moved, dtype=np.float64)
