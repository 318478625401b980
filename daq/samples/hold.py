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


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """Longest hold of one value by one channel in one run."""

    time_s: NDArray[np.float64]
    value: NDArray[np.float64]
    """`time_s`, `value`: samples of the channel, (n,)."""
    rest_s: float
    start_s: float
    """`rest_s`, `start_s`: end of the rest before the bump and start of the decay, s."""
    first: int
    last: int
    """`first`, `last`: its first and last sample."""
    held_s: float
    """Its length, s; 0 if none begins in the first half second of the decay or reaches into it."""

    @property
    def rest_rate(self) -> float:
        """Share of samples at rest that differ from the one before; NaN if there are too few."""
        return share_changed(self.value[self.time_s < self.rest_s])

    @property
    def decay_rate(self) -> float:
        """The same share in the decay."""
        return share_changed(self.value[self.time_s >= self.start_s])

    @property
    def constant(self) -> bool:
        """True if the channel has one value in the whole run."""
        return not (self.value != self.value[0]).any()

    def is_frozen(self, changes: float) -> bool:
        """Return whether the hold is too long to be chance.

        `changes`: share of samples at which the channel changes when it is healthy, 0..1; NaN if it
        is unknown.
        """
        return self.held_s >= FROZEN_S and is_stuck(self.last - self.first + 1, changes)


def longest_hold(
    time_s: NDArray[np.float64], value: NDArray[np.float64], rest_s: float, start_s: float
) -> Hold:
    """Return the longest hold of a channel in a run.

    `time_s`, `value`: its samples, (n,) float64, n at least 1.  `rest_s`, `start_s`: end of the
    rest before the bump and start of the decay, on the axis of `time_s`.
    """
    last = np.flatnonzero(np.diff(value, append=np.nan) != 0.0)
    first = np.concatenate([[0], last[:-1] + 1])
    within = (time_s[last] > start_s) & (time_s[first] < start_s + _MOVING_S)
    length_s = np.where(within, time_s[last] - time_s[first], 0.0)
    k = int(length_s.argmax())
    return Hold(time_s, value, rest_s, start_s, int(first[k]), int(last[k]), float(length_s[k]))
