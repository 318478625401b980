"""Watches each message: arrival, length, checksum; and frames that no DBC describes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from dbc import Codec
from dbc.finding import Finding
from dbc.frames import FrameBatch, FrameFlag
from dbc.samples import Decoded, Quality
from dbc.words import counted

from ..samples.converter import HealthState
from .texts import Counts, fault

_STALE_PERIODS = 5.0  # longest silence of a message that is not a fault, in periods
_LEAST_TIMEOUT_S = 0.5
"""Least timeout of a message, s: cycles are 0.1 or 0.3 s apart, so a shorter silence may only be a
late block."""
_UNKNOWN_TIMEOUT_S = 2.0  # of a message of which no period is known
_LEARN_FRAMES, _LEARN_S = 20, 2.0  # least from which a period is learned
_REGULAR_PERIODS, _REGULAR_S = 3.0, 0.45
"""Number of mean periods, and time, s, without a message after which it is taken as irregular.
Silence shorter than the time between two cycles cannot be seen: 0.3 s, and more on a busy
machine."""
_FORGET_S = 60.0
"""Silence, s, after which a message that no channel needs counts as ended, not failed."""
_SHOWN_IDS = 6  # unknown identifiers that an alarm names
_RECENT_S = 2.0  # since the last frame: up to then an identifier is present on a bus
_UNKNOWN_ONLY_S = 0.8  # after this time, frames that are all unknown raise an alarm
_FIRST_TIMEOUT_S = 1.0  # least time for the first frame of a message
_EXTENDED_BIT, _BUS_SHIFT, _LENGTH_SHIFT = 29, 32, 40  # above the identifier


@dataclass(slots=True)
class _Message:
    """History of one message of the DBC."""

    period_s: float | None
    """Period stated in the DBC, or learned, s; None for a message without a regular period."""
    learn_s: float
    """Monotonic time since which the period is being learned, s."""
    seen_s: float
    """Monotonic time of the cycle with the last frame, s."""
    learn_frames: int = 0
    """Frames since `learn_s`."""
    buses: dict[int, float] = field(default_factory=dict)
    """Monotonic time at which it was last received, s, by number of the bus."""

    @property
    def home(self) -> int:
        """Number of the bus from which it came last."""
        return max(self.buses, key=lambda bus: self.buses[bus])

    @property
    def timeout_s(self) -> float | None:
        """Longest silence that is not a fault, s; None without a period."""
        if self.period_s is None:
            return None
        return max(_STALE_PERIODS * self.period_s, _LEAST_TIMEOUT_S)

    def seen(self, bus: int, frames: int, now_s: float) -> None:
        """Take in the frames of a cycle, and learn the period if the DBC states none."""
        silent_s, self.seen_s, self.buses[bus] = now_s - self.seen_s, now_s, now_s
        span_s = now_s - self.learn_s
        if self.period_s is not None or not span_s:  # known, or this is the first cycle
            return
        self.learn_frames += frames
        if silent_s > max(_REGULAR_PERIODS * span_s / self.learn_frames, _REGULAR_S):
            self.learn_s, self.learn_frames = now_s, 0
        elif self.learn_frames >= _LEARN_FRAMES and span_s >= _LEARN_S:
            self.period_s = span_s / self.learn_frames


class Traffic:
    """The history of all traffic by identifier.

    `missing`: frames that are missing already by their counters, by message.
    """

    def __init__(self, missing: Mapping[str, int] = MappingProxyType({})) -> None:
        self._began_s: float | None = None
        self._known: dict[str, _Message] = {}
        self._unknown: dict[str, float] = {}  # monotonic time of the last frame, by identifier
        self.missing = dict(missing)

    def advance(
        self,
        codec: Codec,
        batch: FrameBatch,
        decoded: Decoded | None,
        health: HealthState,
        now_s: float,
        counts: Counts,
    ) -> None:
        """Process a block; add to the counts."""
        for bus, can_id, is_extended, length, frames in _distinct(batch):
            layout = codec.find(can_id, is_extended, bus)
            if layout is None:
                self._unknown[f"{can_id:#x}" + "x" * is_extended] = now_s
                continue
            known = self._known.setdefault(layout.name, _Message(layout.cycle_s, now_s, now_s))
            known.seen(bus, frames, now_s)
            if length != layout.length:
                earlier, _ = counts.get(("wrong_length", layout.name), (0, ""))
                lengths = f"{counted(length, 'byte')}; the DBC says {layout.length}"
                counts["wrong_length", layout.name] = earlier + frames, lengths
        self._unknown = {k: s for k, s in self._unknown.items() if now_s - s <= _RECENT_S}
        if decoded is not None and decoded.counts.crc_bad:
            for message in codec.messages:
                samples = decoded.samples.get(f"{message.name}.{message.crc}")
                if message.crc and samples is not None:
                    bad = np.count_nonzero(samples.quality & np.uint8(Quality.CRC_BAD))
                    counts["crc_bad", message.name] = int(bad), ""
        for name, counter in health.counters.items():
            counts["counter_gap", name] = counter.missing - self.missing.get(name, 0), ""
            self.missing[name] = counter.missing
        if self._began_s is None and len(batch):
            self._began_s = now_s

    def symptoms(
        self,
        codec: Codec,
        expected: Sequence[str],
        names: Sequence[str],
        delivers: Sequence[bool],
        now_s: float,
    ) -> Iterator[Finding]:
        """Yield the faulty states of the traffic.

        `expected`: messages that carry channels of the bench.  `names`: names of the buses.
        `delivers`: True for each bus with good frames now; the silence of another one is that of
        all its messages, and the alarm is on the bus.  `now_s`: monotonic time, s.
        """
        waited_s = now_s - self._began_s if self._began_s is not None else 0.0
        if self._unknown and not self._known and waited_s >= _UNKNOWN_ONLY_S:
            identifiers = ", ".join(list(self._unknown)[:_SHOWN_IDS])
            text = f"no frame of a message of the DBC in {waited_s:.1f} s, but {identifiers}"
            yield fault("none_of_dbc", "", text)
            return
        for name, message in self._known.items():
            silent_s, timeout_s, home = now_s - message.seen_s, message.timeout_s, message.home
            is_late = timeout_s is not None and silent_s > timeout_s
            ended = silent_s > _FORGET_S and name not in expected
            if is_late and not ended and home < len(delivers) and delivers[home]:
                due = f"one is due every {1e3 * (message.period_s or 0.0):.3g} ms"
                yield fault("stale", name, f"no frame for {silent_s:.1f} s; {due}")
            buses = sorted(bus for bus, s in message.buses.items() if now_s - s <= _RECENT_S)
            if len(buses) > 1:
                where = " and ".join(names[bus] if bus < len(names) else str(bus) for bus in buses)
                yield fault("mixed_id", name, f"comes from {where} at the same time")
        for name in expected if any(delivers) else ():
            cycle_s = codec.message(name).cycle_s
            timeout_s = _STALE_PERIODS * cycle_s if cycle_s else _UNKNOWN_TIMEOUT_S
            if name not in self._known and waited_s > max(timeout_s, _FIRST_TIMEOUT_S):
                text = f"no frame since the recorder started to listen ({waited_s:.0f} s)"
                yield fault("stale", name, text)

    def home_of(self, message: str) -> int | None:
        """Return the number of the bus from which a message came last; None before the first."""
        return self._known[message].home if message in self._known else None

    def alive(self, expected: Sequence[str], now_s: float) -> int:
        """Return the number of expected messages that are received."""
        known = [self._known[name] for name in expected if name in self._known]
        return sum(now_s - m.seen_s <= (m.timeout_s or _UNKNOWN_TIMEOUT_S) for m in known)


def _distinct(batch: FrameBatch) -> list[tuple[int, int, bool, int, int]]:
    """Return the kinds of data frames: bus, identifier, is extended, length, number of frames."""
    special = np.uint16(FrameFlag.ERROR | FrameFlag.REMOTE)
    key = batch.can_id.astype(np.int64)
    key |= batch.bus.astype(np.int64) << _BUS_SHIFT
    key |= batch.length.astype(np.int64) << _LENGTH_SHIFT
    if np.count_nonzero(batch.flags):
        is_extended = batch.flags & np.uint16(FrameFlag.EXTENDED) != 0
        key |= is_extended.astype(np.int64) << _EXTENDED_BIT
        key = key[(batch.flags & special) == 0]
    kinds, numbers = np.unique(key, return_counts=True)
    return [
        (
            kind >> _BUS_SHIFT & 0xFF,
            kind & ((1 << _EXTENDED_BIT) - 1),
            bool(kind >> _EXTENDED_BIT & 1),
            kind >> _LENGTH_SHIFT,
            number,
        )
        for kind, number in zip(kinds.tolist(), numbers.tolist(), strict=True)
    ]
