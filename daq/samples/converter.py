"""Traces of a sensor's converter: tops cut at its range, values that stay, steps above the noise.

Bench check, alarms, verdict and identification all judge by these functions, so that they cannot
disagree about the same samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..channels import TIME_DERIVATIVE, Quantity

STEEP_STEPS = 4.5
"""Converter steps by which a signal must jump into a flat top and out of it: a parabola that
stays within one step for three samples leaves it by three steps, four with rounding."""
CHANCE = 1e-6
"""Odds below which equal samples are not equal by chance: a campaign has some 10,000 extremes."""
EXPECTED_CHANGES = 20.0
"""Changes of value that a hold should have seen before its channel counts as stuck: where one
sample in two changes, to see none of 20 has odds of 1 to 500 million or less."""
RATE_SAMPLES = 20
"""Fewest samples that show how often a channel changes its value."""
FINE_STEP = {"m/s2": 0.05, "rad/s": 0.01, "rad/s2": 0.05}
"""Converter steps, SI by unit, below which the sensor's own noise changes every sample."""


def flat_tops(value: NDArray[np.float64]) -> tuple[tuple[int, int], ...]:
    """Return the flat tops of a record, each as its first sample and the one behind its last.

    A flat top stands at an extreme of the record, has a steep side on either end, and is longer
    than noise makes it by chance.

    `value`, (n,) float64: one channel of one run, evenly sampled, in any unit; finite.
    """
    change = np.flatnonzero(np.diff(value))
    first, stop = change[:-1] + 1, change[1:] + 1  # plateaus with a step on either side
    if not len(first):
        return ()
    low, high = value.min(), value.max()
    samples = stop - first
    at_end = (value[first] == low) | (value[first] == high)
    if not (at_end & (samples > 1)).any():  # as of most channels, which need not be sorted
        return ()
    steps = np.diff(np.sort(value))
    jump = STEEP_STEPS * steps[steps > 0.0].min()
    into, out = np.abs(value[first] - value[first - 1]), np.abs(value[stop] - value[stop - 1])
    # How often a value that was reached by a steep step is repeated where nothing is cut.
    inner = (into > jump) & ~at_end
    repeats = (np.sum(samples[inner] > 1) + 1) / (np.sum(inner) + 2)
    unlikely = samples * repeats ** (samples - 1.0) < CHANCE
    flat = at_end & (np.minimum(into, out) > jump) & unlikely
    return tuple(zip(first[flat].tolist(), stop[flat].tolist(), strict=True))


def share_changed(value: NDArray[np.float64]) -> float:
    """Return the share of samples that differ from the one before; NaN for too few samples."""
    return float(np.mean(np.diff(value) != 0.0)) if len(value) >= RATE_SAMPLES else float("nan")


def is_stuck(held: int, changes: float = 1.0) -> bool:
    """Return whether a value was held for too many samples.

    `held`: equal samples in a row.  `changes`: share of the samples at which this channel changes
    when it is sound, 0..1 (NaN: unknown); 1 for a sensor whose noise is above its steps.
    """
    return bool(held * changes >= EXPECTED_CHANGES)


def is_fine(quantity: Quantity, unit: str, step: float) -> bool:
    """Return whether a sensor's noise is above its steps, so that it never holds a value.

    `quantity` and `unit`: of the channel, SI.  Displacements have no such noise: a potentiometer
    rests on one value.  `step`: of the converter, in `unit`; 0 for a signal of floating point.
    """
    return TIME_DERIVATIVE.get(quantity, 0) > 0 and step < FINE_STEP.get(unit, 0.0)
