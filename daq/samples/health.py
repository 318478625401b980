"""Health of the sensors: a pure fold over decoded blocks that counts what did not become a sample.

Frames whose checksum fails have no counter that can be trusted: they are counted as `crc_bad`, and
since the next good counter then skips them, they are taken off the frames that are missing.  A
repeated counter is a repeated frame and no loss.  A counter that jumps further than the time
allows is a sensor that restarted: what was lost there is not known and not counted (`restarts`
says that it happened).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from operator import add, attrgetter
from types import MappingProxyType

import numpy as np

from dbc.layout import MessageLayout
from dbc.samples import UNUSABLE, DecodeCounts, Decoded

from ..runs import Losses
from .counter import counter_steps

NOTHING = DecodeCounts(0, 0, 0, 0, 0)
_COUNT_NAMES = tuple(each.name for each in fields(DecodeCounts))
_COUNTS = attrgetter(*_COUNT_NAMES)
_LOSSES = attrgetter(*(each.name for each in fields(Losses)))


@dataclass(frozen=True, slots=True)
class CounterHealth:
    """One message's counter so far."""

    last: int
    """Last counter value that can be trusted."""
    t_ns: int
    """Time of its arrival."""
    late_s: float = 0.0
    """How late it was (`daq.samples.counter`)."""
    unreadable: int = 0
    """Frames with a bad checksum since then."""
    received: int = 0
    """Frames with a good counter."""
    missing: int = 0
    """Frames that were sent and never came."""
    restarts: int = 0
    """New starts of the sensor."""


@dataclass(frozen=True, slots=True)
class HealthState:
    """State of the fold; the default is the state before any data."""

    counters: Mapping[str, CounterHealth] = field(default_factory=lambda: MappingProxyType({}))
    """Messages with a counter that were seen."""
    counts: DecodeCounts = NOTHING
    """Frames that could not be decoded, in all."""

    @property
    def losses(self) -> Losses:
        """Totals so far; what was lost before decoding is the reader's to add."""
        missing = sum(counter.missing for counter in self.counters.values())
        counts = zip(_COUNT_NAMES, _COUNTS(self.counts), strict=True)
        return Losses(counter_gaps=missing, **dict(counts))


def advance(messages: Sequence[MessageLayout], state: HealthState, decoded: Decoded) -> HealthState:
    """Take in one decoded block.

    `messages`: the codec's messages.  `state`: what the previous call returned; `HealthState()` at
    first.  `decoded`: the block, frames in order of arrival.
    """
    counters = dict(state.counters)
    for message in messages:
        name = f"{message.name}.{message.counter.signal}" if message.counter else ""
        if name in decoded.samples and len(decoded.samples[name].t_ns):
            counters[message.name] = _count(message, counters.get(message.name), decoded)
    total = map(add, _COUNTS(state.counts), _COUNTS(decoded.counts))
    return HealthState(MappingProxyType(counters), DecodeCounts(*total))


def _count(message: MessageLayout, before: CounterHealth | None, decoded: Decoded) -> CounterHealth:
    assert message.counter is not None  # held by the caller
    samples = decoded[f"{message.name}.{message.counter.signal}"]
    good = (samples.quality & UNUSABLE) == 0
    unreadable = len(good) - int(np.count_nonzero(good))
    if unreadable == len(good):
        return (
            replace(before, unreadable=before.unreadable + unreadable)
            if before
            else (CounterHealth(-1, 0))
        )
    value = samples.value[good].astype(np.int64)
    t_ns = samples.t_ns[good]
    if before is None or before.last < 0:
        health = CounterHealth(int(value[0]), int(t_ns[0]))
        unreadable -= int(np.argmax(good))
    else:
        health = before
        value = np.concatenate([[before.last], value])
        t_ns = np.concatenate([[before.t_ns], t_ns])
    steps = counter_steps(value, message.counter.modulus, t_ns, message.cycle_s, health.late_s)
    trailing = int(np.argmax(good[::-1]))
    passed = health.unreadable + unreadable - trailing
    return CounterHealth(
        last=int(value[-1]),
        t_ns=int(t_ns[-1]),
        late_s=steps.late_s,
        unreadable=trailing,
        received=health.received + int(np.count_nonzero(good)),
        missing=health.missing + max(steps.missing - passed, 0),
        restarts=health.restarts + int(np.count_nonzero(steps.restarted)),
    )


def losses_added(first: Losses, second: Losses) -> Losses:
    """Return the sum of losses counted at different hops."""
    return Losses(*map(add, _LOSSES(first), _LOSSES(second)))
