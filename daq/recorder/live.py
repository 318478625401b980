"""Keeps the newest samples as an envelope: lowest and highest value of each channel and time bin.

Terminals draw it.  The bins are a ring of data time; the recorder publishes each complete bin once,
and sends all of them to a client that asks for the history.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..control.messages import Lane, Live
from ..samples.mapping import SampleBlock

BIN_S = 0.02
"""Width of a bin, s."""
KEPT_S = 60.0
"""Length of the ring, s."""
LATE_S = 0.1
"""Time, s, after its end at which a bin counts as complete: buses do not deliver at the same
time."""
MOST_SENT_S = 10.0
"""Longest time, s, that is published at once, after a gap in time."""
_BIN_NS = round(BIN_S * 1e9)
_BINS = round(KEPT_S / BIN_S)


class LiveRing:
    """The last minute of some channels, as an envelope."""

    def __init__(self, channels: Sequence[str]) -> None:
        self._row = {name: row for row, name in enumerate(channels)}
        self._low = np.full((len(channels), _BINS), np.nan)
        self._high = self._low.copy()
        self._first = 0  # the ring holds nothing before this bin
        self._sent = 0  # bins before this one were published
        self._end = 0  # bins before this one are or were in the ring

    def add(self, block: SampleBlock) -> None:
        """Add a block of samples in order of arrival; values that are not finite are left out."""
        times = [t_ns for t_ns, _ in block.values() if len(t_ns)]
        if not times:
            return
        end = max(int(t_ns[-1]) for t_ns in times) // _BIN_NS + 1
        if self._end == 0 or abs(end - self._end) > _BINS:  # the first data, or a clock was set
            self._first = self._sent = self._end = min(int(t_ns[0]) for t_ns in times) // _BIN_NS
        if end > self._end:
            new = np.arange(max(self._end, end - _BINS), end) % _BINS
            self._low[:, new] = self._high[:, new] = np.nan
            self._end, self._first = end, max(self._first, end - _BINS)
        for name, (t_ns, value) in block.items():
            number = t_ns // _BIN_NS
            good = np.isfinite(value) & (number >= self._first) & (number < self._end)
            place, value = number[good] % _BINS, value[good]
            # A bin may begin in one block and end in the next, or occur twice if stamps go back.
            np.fmin.at(self._low[self._row[name]], place, value)
            np.fmax.at(self._high[self._row[name]], place, value)

    def fresh(self) -> Live | None:
        """Return the complete bins that were not published yet."""
        complete = self._end - math.ceil(LATE_S / BIN_S)
        if complete <= self._sent:
            return None
        first = max(self._sent, complete - round(MOST_SENT_S / BIN_S), self._first)
        self._sent = complete
        return self._live(first, complete)

    def history(self, seconds: float) -> Live:
        """Return the complete bins of the last seconds."""
        complete = max(self._end - math.ceil(LATE_S / BIN_S), self._first)
        return self._live(max(complete - round(seconds / BIN_S), self._first), complete)

    def _live(self, first: int, stop: int) -> Live:
        columns = np.arange(first, stop) % _BINS
        low, high = self._low[:, columns], self._high[:, columns]
        lanes = (Lane(name, _plain(low[row]), _plain(high[row])) for name, row in self._row.items())
        return Live(first, BIN_S, tuple(lanes))


def _plain(values: NDArray[np.float64]) -> tuple[float | None, ...]:
    """Return numbers that JSON can represent, rounded to four digits: a terminal shows fewer."""
    return tuple([None if v != v else float(f"{v:.4g}") for v in values.tolist()])
