"""Watches each message: arrival, length, checksum; and frames that no DBC describes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from dbc import Codec
from dbc.finding import Finding
from dbc.frames import FrameBatch, FrameFlag
from dbc.layout import MessageLayout
from dbc.samples import Decoded, Quality
from dbc.words import counted

from ..samples.health import HealthState
from .inputs import Count, Key, fault

STALE_PERIODS = 5.0
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
_KNOWN_IDS = 256
"""Largest number of unknown identifiers that are counted separately."""
_RECENT_S = 2.0
_STRANGERS_ONLY_S = 0.8
_EXTENDED_BIT, _BUS_SHIFT, _LENGTH_SHIFT = 29, 32, 40


@dataclass(frozen=True, slots=True)
class MessageWatch:
    """History of one message of the DBC."""

    seen_s: float
    """Monotonic time of the cycle with the last frame, s."""
    period_s: float | None
    """Period stated in the DBC, or learned, s; None for a message without a regular period."""
    learn_s: float
    """Monotonic time since which the period is being learned, s."""
    learn_frames: int
    """Frames since `learn_s`."""
    buses: Mapping[int, float]
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
        return max(STALE_PERIODS * self.period_s, _LEAST_TIMEOUT_S)


@dataclass(frozen=True, slots=True)
class Stranger:
    """An identifier that is not in the DBC: frames in all and in the last cycle; its last cycle."""

    frames: int
    rate_hz: float
    seen_s: float


@dataclass(frozen=True, slots=True)
class MessagesWatch:
    """History of all traffic by identifier; the default is the initial state."""

    began_s: float | None = None
    """Monotonic time of the first cycle with frames, s."""
    turn_s: float = 0.0
    """Monotonic time of the last cycle, s."""
    known: Mapping[str, MessageWatch] = field(default_factory=lambda: MappingProxyType({}))
    """Messages of the DBC that were received."""
    strangers: Mapping[tuple[int, int, bool], Stranger] = field(
        default_factory=lambda: MappingProxyType({})
    )
    """Identifiers that are not in the DBC, by bus, identifier and width."""
    missing: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Frames missing according to the counter, as of the last cycle."""


def advance_messages(
    watch: MessagesWatch,
    codec: Codec,
    batch: FrameBatch,
    decoded: Decoded | None,
    health: HealthState,
    now_s: float,
) -> tuple[MessagesWatch, dict[Key, Count]]:
    """Process a block; return the state after it and the counts of this cycle."""
    counts: dict[Key, Count] = {}
    known, strangers = dict(watch.known), dict(watch.strangers)
    turn_s = max(now_s - watch.turn_s, 1e-3) if watch.turn_s else 1.0
    for bus, can_id, is_extended, length, frames in _distinct(batch):
        layout = codec.find(can_id, is_extended, bus)
        if layout is None:
            key = (bus, can_id, is_extended)
            before = strangers.get(key)
            if before is None and len(strangers) >= _KNOWN_IDS:
                continue
            if before is None or before.seen_s < now_s:
                so_far = before.frames if before else 0
                strangers[key] = Stranger(so_far + frames, frames / turn_s, now_s)
            else:  # the same identifier with another length
                strangers[key] = replace(
                    before,
                    frames=before.frames + frames,
                    rate_hz=before.rate_hz + frames / turn_s,
                )
            continue
        known[layout.name] = _seen(known.get(layout.name), layout, bus, frames, now_s)
        if length != layout.length:
            earlier = counts.get(("wrong_length", layout.name), Count(0)).number
            lengths = f"{counted(length, 'byte')}; the DBC says {layout.length}"
            counts["wrong_length", layout.name] = Count(earlier + frames, lengths)
    for key, stranger in watch.strangers.items():
        if now_s - stranger.seen_s > _FORGET_S and strangers[key] is stranger:
            del strangers[key]
    if decoded is not None:
        counts.update(_bad_checksums(codec.messages, decoded))
    missing = {name: counter.missing for name, counter in health.counters.items()}
    for name, number in missing.items():
        if (gap := number - watch.missing.get(name, 0)) > 0:
            counts["counter_gap", name] = Count(gap)
    began_s = watch.began_s if watch.began_s is not None or not len(batch) else now_s
    after = MessagesWatch(
        began_s,
        now_s,
        MappingProxyType(known),
        MappingProxyType(strangers),
        MappingProxyType(missing),
    )
    return after, counts


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


def _seen(
    before: MessageWatch | None, layout: MessageLayout, bus: int, frames: int, now_s: float
) -> MessageWatch:
    if before is None:
        return MessageWatch(now_s, layout.cycle_s, now_s, 0, MappingProxyType({bus: now_s}))
    buses = MappingProxyType({**before.buses, bus: now_s})
    if before.period_s is not None:
        return MessageWatch(now_s, before.period_s, before.learn_s, before.learn_frames, buses)
    learn_s, learn_frames = before.learn_s, before.learn_frames + frames
    span_s = now_s - learn_s
    period_s = None
    if now_s - before.seen_s > max(_REGULAR_PERIODS * span_s / learn_frames, _REGULAR_S):
        learn_s, learn_frames = now_s, 0
    elif learn_frames >= _LEARN_FRAMES and span_s >= _LEARN_S:
        period_s = span_s / learn_frames
    return MessageWatch(now_s, period_s, learn_s, learn_frames, buses)


def _bad_checksums(messages: Sequence[MessageLayout], decoded: Decoded) -> dict[Key, Count]:
    if not decoded.counts.crc_bad:
        return {}
    counts: dict[Key, Count] = {}
    for message in messages:
        samples = decoded.samples.get(f"{message.name}.{message.crc}") if message.crc else None
        if samples is not None:
            bad = int(np.count_nonzero(samples.quality & np.uint8(Quality.CRC_BAD)))
            if bad:
                counts["crc_bad", message.name] = Count(bad)
    return counts


def message_symptoms(
    watch: MessagesWatch,
    codec: Codec,
    expected: Sequence[str],
    names: Sequence[str],
    healthy: Sequence[bool],
    now_s: float,
) -> list[Finding]:
    """Return the faulty states of the traffic.

    `expected`: messages that carry channels of the bench.  `names`: names of the buses.  `healthy`:
    True for each bus that is connected and delivers frames; on other buses every message is silent.
    `now_s`: monotonic time, s.
    """
    recent = {
        key: each for key, each in watch.strangers.items() if now_s - each.seen_s <= _RECENT_S
    }
    found = _stranger_symptoms(recent, codec, names)
    if watch.began_s is None:
        return found
    waited_s = now_s - watch.began_s
    if recent and not watch.known and waited_s >= _STRANGERS_ONLY_S:
        first = ", ".join(_id_text(key) for key in list(recent)[:_SHOWN_IDS])
        text = f"no frame of a message of the DBC in {waited_s:.1f} s, but {first}"
        return [fault("none_of_dbc", "", text), *found]
    for name, each in watch.known.items():
        found += _known_symptoms(name, each, name in expected, names, healthy, now_s)
    if any(healthy):
        for name in expected:
            cycle_s = codec.message(name).cycle_s or _UNKNOWN_PERIOD_S / STALE_PERIODS
            if name not in watch.known and waited_s > max(STALE_PERIODS * cycle_s, 1.0):
                text = f"no frame since the recorder started to listen ({waited_s:.0f} s)"
                found.append(fault("stale", name, text))
    return found


def _known_symptoms(
    name: str,
    each: MessageWatch,
    is_expected: bool,
    names: Sequence[str],
    healthy: Sequence[bool],
    now_s: float,
) -> list[Finding]:
    found: list[Finding] = []
    away_s, timeout_s = now_s - each.seen_s, each.timeout_s
    is_well = each.home < len(healthy) and healthy[each.home]
    ended = away_s > _FORGET_S and not is_expected
    if timeout_s is not None and away_s > timeout_s and is_well and not ended:
        assert each.period_s is not None  # ensured by its timeout
        text = f"no frame for {away_s:.1f} s; one is due every {1e3 * each.period_s:.3g} ms"
        found.append(fault("stale", name, text))
    on = [bus for bus, seen_s in each.buses.items() if now_s - seen_s <= _RECENT_S]
    if len(on) > 1:
        where = " and ".join(names[bus] if bus < len(names) else str(bus) for bus in sorted(on))
        found.append(fault("mixed_id", name, f"comes from {where} at the same time"))
    return found


def _stranger_symptoms(
    recent: Mapping[tuple[int, int, bool], Stranger], codec: Codec, names: Sequence[str]
) -> list[Finding]:
    found: list[Finding] = []
    for key in recent:
        twin = codec.find(key[1], not key[2], key[0])
        if twin is not None and len(found) < _SHOWN_IDS:
            bits = (29, 11) if key[2] else (11, 29)
            text = f"{key[1]:#x} comes with {bits[0]} bits; the DBC has it with {bits[1]}"
            found.append(fault("mixed_id", twin.name, text))
    for bus in sorted({key[0] for key in recent}):
        on_bus = sorted(
            ((key, each) for key, each in recent.items() if key[0] == bus),
            key=lambda item: -item[1].frames,
        )
        shown = ", ".join(f"{_id_text(k)} ({e.rate_hz:.0f} Hz)" for k, e in on_bus[:_SHOWN_IDS])
        more = f" and {len(on_bus) - _SHOWN_IDS} more" if len(on_bus) > _SHOWN_IDS else ""
        name = names[bus] if bus < len(names) else str(bus)
        what = counted(len(on_bus), "identifier is", "identifiers are")
        text = f"{what} not in the DBC: {shown}{more}"
        found.append(fault("unknown_id", name, text))
    return found


def _id_text(key: tuple[int, int, bool]) -> str:
    return f"{key[1]:#x}" + ("x" if key[2] else "")


def alive(watch: MessagesWatch, expected: Sequence[str], now_s: float) -> int:
    """Return the number of expected messages that are received."""
    return sum(
        name in watch.known
        and now_s - watch.known[name].seen_s <= (watch.known[name].timeout_s or _UNKNOWN_PERIOD_S)
        for name in expected
    )
