"""The last minute of every channel, and the choice of what is drawn of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from daq import Channel, Quantity
from daq.channels import AT_CORNER
from daq.control.messages import Live, Phase, Status

if TYPE_CHECKING:
    from daq.bench.config import Bench

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


SPAN_S = 6.0
_HELD = (Phase.TRIGGERED, Phase.DECAY, Phase.ACCEPTED, Phase.REJECTED)
_LEAST = {"m/s2": 0.5, "rad/s": 0.05, "rad/s2": 0.5, "m": 0.002}
_SHOWN = {"m": ("mm", 1e3)}
_SHORT = {
    Quantity.BODY_ACCELERATION: "body",
    Quantity.BODY_DISPLACEMENT: "body",
    Quantity.HUB_ACCELERATION: "wheel",
    Quantity.HUB_DISPLACEMENT: "wheel",
    Quantity.SUSPENSION_TRAVEL: "travel",
    Quantity.PITCH_RATE: "pitch",
    Quantity.ROLL_RATE: "roll",
    Quantity.PITCH_ACCELERATION: "pitch",
    Quantity.ROLL_ACCELERATION: "roll",
}


@dataclass(frozen=True, slots=True)
class LaneSpec:
    """One lane."""

    channel: str
    """Its name in the recording."""
    label: str
    """Short words on the left."""
    unit: str
    """Unit as shown."""
    factor: float
    """Factor from SI to the shown unit."""
    least: float
    """Smallest range, in the shown unit."""
    scale: str
    """Lanes with the same word share one scale: those of one quantity at the wheels."""


@dataclass(frozen=True, slots=True)
class Window:
    """Bins first_bin .. first_bin + count; `trigger` is the share of the width where the bump is.

    None if it is not in view.
    """

    first_bin: int
    count: int
    trigger: float | None


def lane_specs(bench: Bench | None, lanes: Lanes, page: int, room: int) -> list[LaneSpec]:
    """Return the lanes to draw: those of the body, then of each quantity at the wheels.

    `bench`: None while it is not known: then the channels are drawn as the recorder sends them.
    `page`: number of the first group to show, modulo their number; further groups follow if they
    fit completely.  `room`: largest number of lanes.
    """
    if bench is None:
        return [LaneSpec(name, name[:10], "", 1.0, 0.5, name) for name in lanes.channels[:room]]
    used = [c for c in bench.channels if c.quantity is not Quantity.UNUSED]
    groups: dict[str, list[Channel]] = {}
    for channel in sorted(used, key=lambda c: c.quantity in AT_CORNER):
        at_corner = channel.quantity in AT_CORNER
        groups.setdefault(channel.quantity if at_corner else "body", []).append(channel)
    pages = list(groups.values())
    shift = page % max(1, len(pages))
    chosen: list[Channel] = []
    for group in pages[shift:] + pages[:shift]:
        if not chosen or len(chosen) + len(group) <= room:
            chosen += group[:room]
    return [_spec(channel, chosen) for channel in chosen]


def _spec(channel: Channel, chosen: list[Channel]) -> LaneSpec:
    unit, factor = _SHOWN.get(channel.unit, (channel.unit, 1.0))
    words = _SHORT.get(channel.quantity, "")
    place = f"{words} {channel.corner}" if channel.corner else words
    same = [c for c in chosen if (c.quantity, c.corner) == (channel.quantity, channel.corner)]
    label = place if len(same) == 1 and place else channel.name
    least = _LEAST[channel.unit] * factor
    scale = str(channel.quantity) if channel.corner else channel.name
    return LaneSpec(channel.name, label[:10], unit, factor, least, scale)


def window(status: Status | None, lanes: Lanes, span_s: float = SPAN_S) -> Window:
    """Return the window to draw: the run around its bump if there is one, else the last seconds."""
    bin_s = lanes.bin_s or 0.02
    count = round(span_s / bin_s)
    if status is None or not status.bump_ns:
        return Window(lanes.end - count, count, None)
    bump = int(status.bump_ns * 1e-9 / bin_s)
    first = lanes.end - count
    if status.phase in _HELD:
        first = max(bump - round(1.0 / bin_s), lanes.end - count)
    share = (bump - first) / count
    return Window(first, count, share if 0.0 <= share < 1.0 else None)
