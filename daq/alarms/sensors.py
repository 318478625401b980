"""Watches each channel: not a number, out of range, at the end of its range, or frozen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from dbc.finding import Finding
from dbc.samples import UNUSABLE, Decoded, Quality, Samples
from dbc.words import counted

from ..channels import LARGEST, Quantity
from ..samples.converter import is_fine, is_stuck
from ..samples.mapping import MappedChannel
from .texts import Counts, fault

_STUCK_S = 0.8
"""Time without any change, s, after which a channel of fine resolution counts as frozen."""
_STUCK_MOVING_CYCLES = 3  # in which other channels moved, and the frozen one not
_MOVING_STEPS = 20.0
"""Change of another channel within one cycle, in steps of the judged channel, that counts as
motion."""


class _Channel:
    """Range and resolution of a channel, and its current run of equal samples.

    The range is that of its bits, or that of the DBC if it is narrower: a 16-bit sensor that
    measures up to 4 g stops there.
    """

    def __init__(self, mapped: MappedChannel) -> None:
        signal, channel = mapped.signal, mapped.channel
        self.low, self.high = signal.span
        least, most = signal.minimum, signal.maximum
        if least is not None and most is not None and least < most:
            self.low, self.high = max(self.low, least), min(self.high, most)
        self.text = f"{self.low:g} to {self.high:g} {signal.unit}".rstrip()
        if signal.length == 1:  # a switch is always at one end
            self.low, self.high = -math.inf, math.inf
        self.gain = abs(mapped.factor * channel.scale)
        self.largest = LARGEST / self.gain if self.gain else math.inf
        """Largest magnitude that any sensor shows, in the signal's unit."""
        self.step = mapped.step
        self.is_fine = is_fine(channel.quantity, channel.unit, mapped.step)
        self.name, self.signal, self.quantity = channel.name, channel.signal, channel.quantity
        self.value = math.nan
        """The signal's value in all samples of the run, which has `samples` of them."""
        self.samples = self.moving = 0
        """`moving`: number of cycles within the run in which other channels moved."""
        self.since_ns = self.until_ns = 0

    def usable(self, samples: Samples, counts: Counts) -> Samples:
        """Count faulty samples, and return the usable ones."""
        quality, value = samples.quality, samples.value
        usable = (quality & np.uint8(UNUSABLE)) == 0
        shown = np.isfinite(value) & (np.abs(value) <= self.largest)
        outside = usable & ((quality & np.uint8(Quality.OUT_OF_RANGE)) != 0)
        no_value = (quality & np.uint8(Quality.SENTINEL)) != 0
        counts["no_value", self.name] = int(np.count_nonzero(no_value)), ""
        counts["not_a_number", self.name] = int(np.count_nonzero(usable & ~shown)), ""
        counts["out_of_range", self.name] = int(np.count_nonzero(outside)), self.text
        good = np.flatnonzero(usable & shown)
        return Samples(samples.channel, samples.t_ns[good], value[good], quality[good])

    def hold(self, samples: Samples, low: float, high: float, others_move: bool) -> None:
        """Continue the run of equal samples, or begin another one, given their extremes."""
        n, self.until_ns = len(samples.t_ns), int(samples.t_ns[-1])
        is_still = low == high
        if is_still and low == self.value and self.samples:
            self.samples, self.moving = self.samples + n, self.moving + others_move
            return
        self.value, self.samples = float(samples.value[-1]), n if is_still else 1
        self.since_ns = int(samples.t_ns[0]) if is_still else self.until_ns
        self.moving = int(is_still and others_move)


class Sensors:
    """The history of all channels."""

    def __init__(self) -> None:
        self._mapped: Sequence[MappedChannel] = ()
        self._channels: tuple[_Channel, ...] = ()
        self.overloaded: tuple[str, ...] = ()
        """Channels that reached the end of their range since the last acknowledgement."""

    def advance(
        self, mapped: Sequence[MappedChannel], decoded: Decoded | None, counts: Counts
    ) -> None:
        """Process a block; add to the counts."""
        if self._mapped is not mapped:
            used = [m for m in mapped if m.channel.quantity is not Quantity.UNUSED]
            self._mapped, self._channels = mapped, tuple(_Channel(m) for m in used)
        blocks: list[tuple[_Channel, Samples, float, float]] = []  # with lowest and highest value
        for channel in self._channels:
            samples = decoded.samples.get(channel.signal) if decoded else None
            if samples is None or not len(samples.t_ns):
                continue
            low, high = float(samples.value.min()), float(samples.value.max())
            is_shown = max(-low, high) <= channel.largest  # False if one is not a number
            if not is_shown or samples.quality.any():
                samples = channel.usable(samples, counts)
                if not len(samples.t_ns):
                    channel.samples = 0
                    continue
                low, high = float(samples.value.min()), float(samples.value.max())
            # Many unsigned signals are zero at rest.
            if (low <= channel.low and low != 0) or (high >= channel.high and high != 0):
                value = samples.value
                at_end = ((value <= channel.low) | (value >= channel.high)) & (value != 0)
                counts["saturated", channel.name] = int(np.count_nonzero(at_end)), channel.text
                self.overloaded = tuple(dict.fromkeys((*self.overloaded, channel.name)))
            blocks.append((channel, samples, low, high))
        for channel, samples, low, high in blocks:
            others_move = any(
                (other_high - other_low) * other.gain > _MOVING_STEPS * channel.step > 0
                for other, _, other_low, other_high in blocks
                if other is not channel and other.quantity is channel.quantity
            )
            channel.hold(samples, low, high, others_move)

    def symptoms(self) -> Iterator[Finding]:
        """Yield the symptoms of frozen channels."""
        for each in self._channels:
            if not is_stuck(each.samples):
                continue
            still_s = (each.until_ns - each.since_ns) * 1e-9
            samples = counted(each.samples, "sample is", "samples in a row are")
            text = f"{samples} {each.value:.6g}"
            if each.moving >= _STUCK_MOVING_CYCLES:
                yield fault("stuck", each.name, f"{text} while others move")
            elif each.is_fine and still_s >= _STUCK_S:
                yield fault("stuck", each.name, f"{text}: not even noise for {still_s:.1f} s")
