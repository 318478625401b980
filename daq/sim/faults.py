"""Faults of sensors, declared for the simulated bench and unknown to bench.toml."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .plant import Array


@dataclass(frozen=True, slots=True)
class SensorFault:
    """How one sensor departs from what its channel says.

    The order is that of the chain: the motion is seen late, passes the low-pass, gets its offset
    and noise, saturates, and is multiplied by the gain.
    """

    channel: str
    """Name of the channel."""
    gain: float = 1.0
    """Factor on the value: 1.02 for a wrong calibration, -1 for a sensor mounted upside down, 1 /
    9.80665 for g where m/s2 are stated."""
    late_s: float = 0.0
    """Lateness beyond the channel's own delay, s."""
    offset: float = 0.0
    """Constant added, in the channel's SI unit."""
    low_pass_hz: float = 0.0
    """Cut-off (-3 dB) of a Butterworth low-pass; 0 leaves what the channel states."""
    low_pass_order: int = 2
    """Its order."""
    limit: float = math.inf
    """The sensor saturates at plus and minus this, SI, gravity included."""


def low_pass(values: Array, step_s: float, cutoff_hz: float, order: int) -> Array:
    """Pass a signal that begins at rest through an analogue Butterworth low-pass.

    Between the samples the signal is taken as straight, and the filter's answer to that is exact
    (first-order hold), so the error falls with the square of the step.

    `values`, (n,) float64: the signal; constant up to its first sample.  `step_s`: time between
    samples, s.  `cutoff_hz` and `order`: the filter; its gain at rest is 1.
    """
    from scipy.signal import butter, cont2discrete, lfilter  # slow to load, seldom needed

    analogue = butter(order, 2.0 * math.pi * cutoff_hz, analog=True)
    numerator, denominator, _ = cont2discrete(analogue, step_s, method="foh")
    moved = lfilter(np.ravel(numerator), denominator, values - values[0])
    return np.asarray(values[0] + moved, dtype=np.float64)
