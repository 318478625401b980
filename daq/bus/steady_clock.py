"""One axis of time for all that this host stamps: the wall clock's, but nobody can set it.

The wall clock may be set in mid-run, an hour on or back.  Stamps are told on an axis that began
with the wall clock and goes on with the monotonic one; that the clock was set is told by an event,
not by the measurements.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

STEP_NS = 1_000_000
"""Both clocks are slewed alike: when they part by more, the wall clock was set."""
LATE_NS = 5_000_000
"""A stamp may lie so far ahead: both clocks cannot be read in one instant."""
QUEUED_NS = 10_000_000_000
"""No frame waits longer in a buffer to be read; older offsets are forgotten."""


class HostAxis:
    """An axis that begins when it is made; one serves the whole process.

    Parameters
    ----------
    wall_ns, monotonic_ns : callable
        The host's clocks.
    """

    def __init__(
        self,
        wall_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._wall_ns, self._monotonic_ns = wall_ns, monotonic_ns
        self._lock = threading.Lock()
        self.begin()

    def begin(self, not_before_ns: int = 0) -> None:
        """Begin anew with the wall clock as it is now set.

        Parameters
        ----------
        not_before_ns : int
            The axis begins there if the wall clock is behind: on a machine without a battery it
            falls back at each start, and time must not run twice within a recording.
        """
        with self._lock:
            monotonic_ns = self._monotonic_ns()
            self._offset_ns = self._wall_ns() - monotonic_ns
            self._zero_ns = max(self._offset_ns, not_before_ns - monotonic_ns)
            self._before: tuple[tuple[int, int], ...] = ()

    def now_ns(self) -> int:
        """Return the time now, ns since 1970."""
        return self._monotonic_ns() + self._zero_ns

    def from_wall(self, wall_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return stamps of the wall clock, made a moment ago, on this axis.

        Parameters
        ----------
        wall_ns : (n,) int64
            Stamps; those from before and after the clock was set may be mixed.
        """
        monotonic_ns = self._monotonic_ns()
        offset_ns = self._wall_ns() - monotonic_ns
        with self._lock:
            if abs(offset_ns - self._offset_ns) > STEP_NS:
                self._before = (*self._before, (monotonic_ns, self._offset_ns))
                self._offset_ns = offset_ns
            if self._before and monotonic_ns - self._before[0][0] > QUEUED_NS:
                self._before = self._before[1:]
            offset_ns, zero_ns = self._offset_ns, self._zero_ns
            offsets = (offset_ns, *(before for _, before in self._before))
        if len(offsets) > 1:
            return _youngest(wall_ns, offsets, monotonic_ns) + zero_ns
        return wall_ns if offset_ns == zero_ns else wall_ns - (offset_ns - zero_ns)


def _youngest(
    wall_ns: NDArray[np.int64], offsets: tuple[int, ...], monotonic_ns: int
) -> NDArray[np.int64]:
    """Return monotonic times: each stamp by the offset that makes it youngest, yet not to come."""
    times = wall_ns[:, None] - np.array(offsets, np.int64)
    age = monotonic_ns - times
    age = np.where(age >= -LATE_NS, age, np.iinfo(np.int64).max)
    return np.take_along_axis(times, age.argmin(axis=1)[:, None], axis=1)[:, 0]


HOST_AXIS = HostAxis()
