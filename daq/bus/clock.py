"""Times of this host: the two clocks of one cycle, and UTC that no set clock can move.

The wall clock may be set in mid-run by an hour, forward or back.  Stamps of this host are on a
time axis that began with the wall clock and advances with the monotonic one; an event reports that
the wall clock was set, and the measurements do not show it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Now:
    """The host's two clocks, read together at the start of a cycle of the recorder."""

    wall_ns: int
    """UTC, ns since 1970; this clock may be set at any moment."""
    monotonic_s: float
    """Monotonic time, s, from an arbitrary origin; waiting and silence are measured with it."""


def read_clocks() -> Now:
    """Return the time of both clocks of this host."""
    return Now(time.time_ns(), time.monotonic())


STEP_NS = 1_000_000
"""Change of the difference of the clocks, ns, from which the wall clock counts as set; slewing
changes both clocks equally."""
LATE_NS = 5_000_000
"""Largest lead of a stamp over the present time, ns: the two clocks cannot be read at the same
instant."""
QUEUED_NS = 10_000_000_000
"""Age, ns, at which an older offset is forgotten: no frame waits longer in a buffer."""


class SteadyClock:
    """A clock that starts at its construction; the whole process uses one."""

    def __init__(
        self,
        wall_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._wall_ns, self._monotonic_ns = wall_ns, monotonic_ns
        self._lock = threading.Lock()
        self.begin()

    def begin(self, not_before_ns: int = 0) -> None:
        """Start again from the wall clock as it is set now.

        `not_before_ns`: earliest start.  Without a battery the wall clock falls back at each boot,
        and a time must not occur twice within a recording.
        """
        with self._lock:
            monotonic_ns = self._monotonic_ns()
            self._offset_ns = self._wall_ns() - monotonic_ns
            self._zero_ns = max(self._offset_ns, not_before_ns - monotonic_ns)
            self._before: tuple[tuple[int, int], ...] = ()  # end, monotonic, and earlier offset

    def now_ns(self) -> int:
        """Return the time now, ns since 1970."""
        return self._monotonic_ns() + self._zero_ns

    def from_wall(self, wall_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Convert stamps of the wall clock, (n,) int64, made within the last `QUEUED_NS`.

        Stamps from before and after the wall clock was set may be mixed.
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
            return _monotonic_stamps(wall_ns, offsets, monotonic_ns) + zero_ns
        return wall_ns if offset_ns == zero_ns else wall_ns - (offset_ns - zero_ns)


def _monotonic_stamps(
    wall_ns: NDArray[np.int64], offsets: tuple[int, ...], now_ns: int
) -> NDArray[np.int64]:
    """Return stamps of the wall clock, (n,), as monotonic times: the latest not after `now_ns`."""
    candidates_ns = wall_ns[:, None] - np.array(offsets, np.int64)  # (n, offsets)
    age_ns = now_ns - candidates_ns
    age_ns = np.where(age_ns >= -LATE_NS, age_ns, np.iinfo(np.int64).max)
    return np.take_along_axis(candidates_ns, age_ns.argmin(axis=1)[:, None], axis=1)[:, 0]


STEADY_CLOCK = SteadyClock()
