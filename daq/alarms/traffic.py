"""Watches each message: arrival, length, checksum; and frames that no DBC describes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dbc import Codec
from dbc.finding import Finding
from dbc.frames import FrameBatch, FrameFlag
from dbc.layout import MessageLayout
from dbc.samples import Decoded, Quality
from dbc.words import counted

from ..samples.converter import HealthState
from .texts import Counts, fault

_STALE_PERIODS = 5.0
_LEAST_TIMEOUT_S = 0.5
"""Least timeout of a message, s: cycles are 0.1 or 0.3 s apart, so a shorter silence may only be a
late block."""
_UNKNOWN_PERIOD_S = 2.0
_LEARN_FRAMES, _LEARN_S = 20, 2.0
_REGULAR_PERIODS, _REGULAR_S = 3.0, 0.45
"""Number of mean periods, and time, s, without a message after which it is taken as irregular.
Silence shorter than the time between two cycles cannot be seen: 0.3 s, and more on a busy
machine."""
_FORGET_S = 60.0
"""Silence, s, after which a message that no channel needs counts as ended, not failed."""
_SHOWN_IDS = 6
_MOST_IDS = 256
"""Largest number of unknown identifiers that are counted separately."""
_RECENT_S = 2.0
_UNKNOWN_ONLY_S = 0.8
_EXTENDED_BIT, _BUS_SHIFT, _LENGTH_SHIFT = 29, 32, 40
FrameId = tuple[int, int, bool]
"""Bus, identifier, and whether it has 29 bits."""


@dataclass(slots=True)
class _Message:
    """History of one message of the DBC."""

    period_s: float | None
    """Period stated in the DBC, or learned, s; None for a message without a regular period."""
    learn_s: float
    """Monotonic time since which the period is being learned, s."""
    seen_s: float
    """Monotonic time of the cycle with the last frame, s."""
    learn_frames: int
    """Frames since `learn_s`."""
    buses: dict[int, float]
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
        if self.period_s is not None:
            return
        self.learn_frames += frames
        span_s = now_s - self.learn_s
        if silent_s > max(_REGULAR_PERIODS * span_s / self.learn_frames, _REGULAR_S):
            self.learn_s, self.learn_frames = now_s, 0
        elif self.learn_frames >= _LEARN_FRAMES and span_s >= _LEARN_S:
            self.period_s = span_s / self.learn_frames


@dataclass(slots=True)
class _Unknown:
    """An identifier that is not in the DBC: frames in all, rate and time of its last cycle."""

    frames: int
    rate_hz: float
    seen_s: float


class Traffic:
    """The history of all traffic by identifier.

    `missing`: frames that are missing already by their counters, by message.
    """

    def __init__(self, missing: Mapping[str, int] = MappingProxyType({})) -> None:
        self._began_s: float | None = None
        self._cycle_s = 0.0
        self._known: dict[str, _Message] = {}
        self._unknown: dict[FrameId, _Unknown] = {}
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
        span_s = max(now_s - self._cycle_s, 1e-3) if self._cycle_s else 1.0
        for bus, can_id, is_extended, length, frames in _distinct(batch):
            layout = codec.find(can_id, is_extended, bus)
            if layout is None:
                self._add_unknown((bus, can_id, is_extended), frames, frames / span_s, now_s)
                continue
            if layout.name in self._known:
                self._known[layout.name].seen(bus, frames, now_s)
            else:
                self._known[layout.name] = _Message(layout.cycle_s, now_s, now_s, 0, {bus: now_s})
            if length != layout.length:
                earlier, _ = counts.get(("wrong_length", layout.name), (0, ""))
                lengths = f"{counted(length, 'byte')}; the DBC says {layout.length}"
                counts["wrong_length", layout.name] = earlier + frames, lengths
        for key in [k for k, each in self._unknown.items() if now_s - each.seen_s > _FORGET_S]:
            del self._unknown[key]
        if decoded is not None and decoded.counts.crc_bad:
            _count_bad_checksums(codec.messages, decoded, counts)
        for name, counter in health.counters.items():
            if (gap := counter.missing - self.missing.get(name, 0)) > 0:
                counts["counter_gap", name] = gap, ""
            self.missing[name] = counter.missing
        if self._began_s is None and len(batch):
            self._began_s = now_s
        self._cycle_s = now_s

    def _add_unknown(self, key: FrameId, frames: int, rate_hz: float, now_s: float) -> None:
        before = self._unknown.get(key)
        if before is None:
            if len(self._unknown) < _MOST_IDS:
                self._unknown[key] = _Unknown(frames, rate_hz, now_s)
            return
        same = before.seen_s == now_s  # the same identifier with another length
        before.frames += frames
        before.rate_hz, before.seen_s = rate_hz + same * before.rate_hz, now_s

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
        recent = {k: each for k, each in self._unknown.items() if now_s - each.seen_s <= _RECENT_S}
        waited_s = now_s - self._began_s if self._began_s is not None else 0.0
        only_unknown = bool(recent) and not self._known and waited_s >= _UNKNOWN_ONLY_S
        if only_unknown:
            first = ", ".join(_id_text(key) for key in list(recent)[:_SHOWN_IDS])
            text = f"no frame of a message of the DBC in {waited_s:.1f} s, but {first}"
            yield fault("none_of_dbc", "", text)
        yield from _unknown_symptoms(recent, codec, names)
        if only_unknown:
            return
        for name, each in self._known.items():
            away_s, timeout_s, home = now_s - each.seen_s, each.timeout_s, each.home
            is_late = timeout_s is not None and away_s > timeout_s
            ended = away_s > _FORGET_S and name not in expected
            if is_late and not ended and home < len(delivers) and delivers[home]:
                due = f"one is due every {1e3 * (each.period_s or 0.0):.3g} ms"
                yield fault("stale", name, f"no frame for {away_s:.1f} s; {due}")
            on = sorted(bus for bus, seen_s in each.buses.items() if now_s - seen_s <= _RECENT_S)
            if len(on) > 1:
                where = " and ".join(_bus_name(names, bus) for bus in on)
                yield fault("mixed_id", name, f"comes from {where} at the same time")
        for name in expected if any(delivers) else ():
            cycle_s = codec.message(name).cycle_s or _UNKNOWN_PERIOD_S / _STALE_PERIODS
            if name not in self._known and waited_s > max(_STALE_PERIODS * cycle_s, 1.0):
                text = f"no frame since the recorder started to listen ({waited_s:.0f} s)"
                yield fault("stale", name, text)

    def home_of(self, message: str) -> int | None:
        """Return the number of the bus from which a message came last; None before the first."""
        return self._known[message].home if message in self._known else None

    def alive(self, expected: Sequence[str], now_s: float) -> int:
        """Return the number of expected messages that are received."""
        known = [self._known[name] for name in expected if name in self._known]
        return sum(now_s - m.seen_s <= (m.timeout_s or _UNKNOWN_PERIOD_S) for m in known)


def _distinct(batch: FrameBatch) -> list[tuple[int, int, bool, int, int]]:
    """Return bus, identifier, width, length and number of each kind of data frame."""
    special = np.uint16(FrameFlag.ERROR | FrameFlag.REMOTE)
    key = batch.can_id.astype(np.int64)
    key |= batch.bus.astype(np.int64) << _BUS_SHIFT
    key |= batch.length.astype(np.int64) << _LENGTH_SHIFT
    if np.count_nonzero(batch.flags):
        key |= (batch.flags & np.uint16(FrameFlag.EXTENDED)).astype(np.int64) << _EXTENDED_BIT
        key = key[(batch.flags & special) == 0]
    keys, numbers = np.unique(key, return_counts=True)
    return [
        (
            each >> _BUS_SHIFT & 0xFF,
            each & ((1 << _EXTENDED_BIT) - 1),
            bool(each >> _EXTENDED_BIT & 1),
            each >> _LENGTH_SHIFT,
            number,
        )
        for each, number in zip(keys.tolist(), numbers.tolist(), strict=True)
    ]


def _count_bad_checksums(
    messages: Sequence[MessageLayout], decoded: Decoded, counts: Counts
) -> None:
    for message in messages:
        samples = decoded.samples.get(f"{message.name}.{message.crc}") if message.crc else None
        if samples is not None:
            bad = int(np.count_nonzero(samples.quality & np.uint8(Quality.CRC_BAD)))
            if bad:
                counts["crc_bad", message.name] = bad, ""


def _unknown_symptoms(
    recent: dict[FrameId, _Unknown], codec: Codec, names: Sequence[str]
) -> Iterator[Finding]:
    twins = ((key, codec.find(key[1], not key[2], key[0])) for key in recent)
    for key, twin in [(key, twin) for key, twin in twins if twin is not None][:_SHOWN_IDS]:
        bits, stated = (29, 11) if key[2] else (11, 29)
        text = f"{key[1]:#x} comes with {bits} bits; the DBC has it with {stated}"
        yield fault("mixed_id", twin.name, text)
    for bus in sorted({key[0] for key in recent}):
        on_bus = sorted(
            ((key, each) for key, each in recent.items() if key[0] == bus),
            key=lambda item: -item[1].frames,
        )
        shown = ", ".join(f"{_id_text(k)} ({e.rate_hz:.0f} Hz)" for k, e in on_bus[:_SHOWN_IDS])
        more = f" and {len(on_bus) - _SHOWN_IDS} more" if len(on_bus) > _SHOWN_IDS else ""
        what = counted(len(on_bus), "identifier is", "identifiers are")
        text = f"{what} not in the DBC: {shown}{more}"
        yield fault("unknown_id", _bus_name(names, bus), text)


def _bus_name(names: Sequence[str], bus: int) -> str:
    return names[bus] if bus < len(names) else str(bus)


def _id_text(key: FrameId) -> str:
    return f"{key[1]:#x}" + ("x" if key[2] else "")
