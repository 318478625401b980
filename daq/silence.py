"""Finds silences of sensors in a run; states how long one may be, at the bench and at the desk."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

STALE_S = 0.25
"""Longest allowed silence of a sensor, s: a quarter of a body's period."""
STALE_CYCLES = 10.0
"""Longest allowed silence of a slow message, in its cycles."""
WHEEL_MOTION_S = 0.2
"""Time after the bump by which 97 % of the wheels' motion is over, s."""
GAP_S = 0.02
"""Longest gap while the wheels move, s: a quarter of their period; a decay that starts so late
loses a fifth of the precision."""
GAP_CYCLES = 3.5
"""Longest gap in cycles of the message: two consecutive lost samples are not a gap, however slow it
is."""


class Silence(NamedTuple):
    """A time without a sample."""

    begin_s: float
    """Time of the sample before it, or begin of the run, s."""
    end_s: float
    """Time of the sample after it, or end of the run, s."""
    limit_s: float
    """Longest silence that is allowed at this rate, s."""

    @property
    def length_s(self) -> float:
        """Duration, s."""
        return self.end_s - self.begin_s

    @property
    def is_stale(self) -> bool:
        """True if it is too long."""
        return self.length_s > self.limit_s


def longest_silence(time_s: NDArray[np.floating], begin_s: float, end_s: float) -> Silence:
    """Return the longest silence between begin and end of a run.

    `time_s`: times of the usable samples of a sensor, s, (n,), in any order; may be empty.
    """
    time_s = np.sort(time_s, kind="stable")  # fast where they are in order, as most are
    cycle_s = float(np.median(np.diff(time_s))) if len(time_s) > 2 else 0.0
    edges = np.concatenate([[begin_s], np.clip(time_s, begin_s, end_s), [end_s]])
    worst = int(np.argmax(np.diff(edges)))
    limit_s = max(STALE_S, STALE_CYCLES * cycle_s)
    return Silence(float(edges[worst]), float(edges[worst + 1]), limit_s)


def longest_gap_s(period_s: float) -> float:
    """Return the longest gap that is allowed while the wheels move, s.

    `period_s`: time between samples, s.
    """
    return max(GAP_S, GAP_CYCLES * period_s)
