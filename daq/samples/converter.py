"""Detects effects of a sensor's converter: cut tops, values that do not change, coarse steps.

Bench check, alarms, verdict and identification all use these functions, so that they cannot
disagree about the same samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..channels import TIME_DERIVATIVE, Quantity

STEEP_STEPS = 4.5
"""Number of converter steps by which a signal must jump into a flat top and out of it: a parabola
that stays within one step for three samples leaves it by three steps, four with rounding."""
CHANCE = 1e-6
"""Probability below which equal samples are not equal by chance: a campaign has about 10,000
extremes."""
EXPECTED_CHANGES = 20.0
"""Expected number of changes of value, during a hold, from which a channel counts as stuck.  If one
sample in two changes, the probability that none of 20 expected changes occurs is below 1 to 500
million."""
RATE_SAMPLES = 20
"""Fewest samples from which the rate of changes of a channel is taken."""
FINE_STEP = {"m/s2": 0.05, "rad/s": 0.01, "rad/s2": 0.05}
"""Converter steps by unit, SI, below which the sensor's own noise changes every sample."""


def flat_tops(value: NDArray[np.float64]) -> tuple[tuple[int, int], ...]:
    """Return the flat tops of a record, each as its first sample and the one after its last.

    A flat top is at an extreme of the record, has a steep side at each end, and is longer than
    noise makes it by chance.

    `value`, (n,) float64: one channel of one run, evenly sampled, in any unit; finite.
    """
    change = np.flatnonzero(np.diff(value))
    first, stop = change[:-1] + 1, change[1:] + 1  # plateaus with a step on either side
    if not len(first):
        return ()
    low, high = value.min(), value.max()
    samples = stop - first
    at_end = (value[first] == low) | (value[first] == high)
    if not (at_end & (samples > 1)).any():  # true of most channels, which need no sorting
        return ()
    steps = np.diff(np.sort(value))
    jump = STEEP_STEPS * steps[steps > 0.0].min()
    into, out = np.abs(value[first] - value[first - 1]), np.abs(value[stop] - value[stop - 1])
    # Rate at which a value that was reached by a steep step is repeated where nothing is cut.
    inner = (into > jump) & ~at_end
    repeats = (np.sum(samples[inner] > 1) + 1) / (np.sum(inner) + 2)
    unlikely = samples * repeats ** (samples - 1.0) < CHANCE
    flat = at_end & (np.minimum(into, out) > jump) & unlikely
    return tuple(zip(first[flat].tolist(), stop[flat].tolist(), strict=True))


def share_changed(value: NDArray[np.float64]) -> float:
    """Return the share of samples that differ from the previous one; NaN for too few samples."""
    return float(np.mean(np.diff(value) != 0.0)) if len(value) >= RATE_SAMPLES else float("nan")


def is_stuck(held: int, changes: float = 1.0) -> bool:
    """Return whether a value was held for too many samples.

    `held`: number of consecutive equal samples.  `changes`: share of samples at which this channel
    changes when it is healthy, 0..1 (NaN: unknown); 1 for a sensor whose noise is above its steps.
    """
    return bool(held * changes >= EXPECTED_CHANGES)


def is_fine(quantity: Quantity, unit: str, step: float) -> bool:
    """Return whether a sensor's noise is above its steps, so that it never holds a value.

    `quantity` and `unit`: of the channel, SI.  Displacements do not have this noise: a
    potentiometer rests on one value.  `step`: of the converter, in `unit`; 0 for a floating-point
    signal.
    """
    return TIME_DERIVATIVE.get(quantity, 0) > 0 and step < FINE_STEP[unit]
