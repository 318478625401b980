"""The last minute of every channel, as the recorder sends it: an envelope in a ring."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.control import Live

RING_S = 60.0


class Lanes:
    """Rolling history of live samples.

    Lowest and highest value of each bin of each channel; NaN where there is no sample, or where a
    message was lost.
    """

    def __init__(self) -> None:
        self._low: dict[str, NDArray[np.float64]] = {}
        self._high: dict[str, NDArray[np.float64]] = {}
        self.clear()

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels received so far."""
        return tuple(self._low)

    @property
    def end_ns(self) -> int:
        """Time stamp where the newest bin ends; 0 if there is none."""
        return round(self.end * self.bin_s * 1e9)

    def clear(self) -> None:
        """Delete everything, because another recording begins."""
        self.bin_s = 0.0
        self.end = 0
        """The bin after the newest."""
        self._begin = 0
        self._low.clear()
        self._high.clear()

    def add(self, live: Live) -> None:
        """Add live samples; bins older than the newest only fill gaps."""
        count = max((len(lane.low) for lane in live.lanes), default=0)
        if not count:
            return
        size = max(1, round(RING_S / live.bin_s))
        if live.bin_s != self.bin_s or abs(live.first_bin - self.end) > size:
            self._low, self._high = {}, {}
            self.bin_s, self.end = live.bin_s, live.first_bin
            self._begin = live.first_bin
        bins = np.arange(live.first_bin, live.first_bin + count)
        fresh = np.arange(self.end, max(self.end, bins[-1] + 1)) % size
        for ring in (*self._low.values(), *self._high.values()):
            ring[fresh] = np.nan
        for lane in live.lanes:
            for rings, received in ((self._low, lane.low), (self._high, lane.high)):
                ring = rings.setdefault(lane.channel, np.full(size, np.nan))
                values = np.array(received, dtype=np.float64)
                kept = bins > max(self.end, bins[-1] + 1) - 1 - size
                ring[bins[kept] % size] = values[kept]
        self.end = int(max(self.end, bins[-1] + 1))

    def window(
        self, channel: str, first_bin: int, count: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return lowest and highest values of `count` bins from `first_bin`; NaN if not known."""
        low, high = np.full(count, np.nan), np.full(count, np.nan)
        ring = self._low.get(channel)
        if ring is None:
            return low, high
        bins = np.arange(first_bin, first_bin + count)
        known = (bins < self.end) & (bins >= self.end - len(ring))
        low[known] = ring[bins[known] % len(ring)]
        high[known] = self._high[channel][bins[known] % len(ring)]
        return low, high
