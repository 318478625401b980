"""Finds the longest time for which a channel held one value while the vehicle moved.

The verdict on a run and the identification use the same rule, so that the desk does not leave out
a run that the bench has accepted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .converter import is_stuck, share_changed

FROZEN_S = 0.2
"""Time, s, after which a constant channel counts as frozen: two periods of the wheels, too long for
a saturated top."""
_MOVING_S = 0.5  # after this time, a coarse sensor may stay at one step of its converter


@dataclass(frozen=True, slots=True)
class Hold:
    """Longest hold of one value by one channel in one run, and the usual rate of its changes."""

    held_s: float
    """Length of the longest hold that begins in the first half second of the decay, s."""
    held: int
    """Its number of samples."""
    rest_rate: float
    decay_rate: float
    """`rest_rate`, `decay_rate`: share of samples that differ from the one before, at rest before
    the bump and in the decay; NaN where there are too few samples."""
    constant: bool
    """True if it has one value in the whole run."""

    def is_frozen(self, changes: float) -> bool:
        """Return whether the hold is too long to be chance.

        `changes`: share of samples at which the channel changes when it is healthy, 0..1; NaN if it
        is unknown.
        """
        return self.held_s >= FROZEN_S and is_stuck(self.held, changes)


def longest_hold(
    time_s: NDArray[np.float64], value: NDArray[np.float64], rest_s: float, start_s: float
) -> Hold:
    """Return the longest hold of a channel in a run.

    `time_s`, `value`: its samples, (n,) float64, n at least 1.  `rest_s`, `start_s`: end of the
    rest before the bump and start of the decay, on the axis of `time_s`.
    """
    change = np.flatnonzero(np.diff(value) != 0.0)
    first = np.concatenate([[0], change + 1])
    last = np.concatenate([change, [len(value) - 1]])
    within = (time_s[last] > start_s) & (time_s[first] < start_s + _MOVING_S)
    length = np.where(within, time_s[last] - time_s[first], 0.0)
    k = int(length.argmax())
    return Hold(
        float(length[k]),
        int(last[k] - first[k] + 1),
        share_changed(value[time_s < rest_s]),
        share_changed(value[time_s >= start_s]),
        len(change) == 0,
    )
