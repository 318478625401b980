"""Counts the frames that did not become samples, as a pure fold over decoded blocks.

Frames with a wrong checksum have no reliable counter: they are counted as `crc_bad`, and because
the next good counter then skips them, they are subtracted from the missing frames.  A repeated
counter means a repeated frame, not a loss.  A counter that jumps further than the time allows means
that the sensor restarted: the losses are then not known and not counted (`restarts` counts these
cases).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from operator import add, attrgetter
from types import MappingProxyType

import numpy as np

from dbc.layout import MessageLayout
from dbc.samples import DecodeCounts, Decoded

from ..runs import Losses
from .counter import counter_steps

NOTHING = DecodeCounts(0, 0, 0, 0, 0)
_COUNT_NAMES = tuple(each.name for each in fields(DecodeCounts))
_COUNTS = attrgetter(*_COUNT_NAMES)
_LOSSES = attrgetter(*(each.name for each in fields(Losses)))


@dataclass(frozen=True, slots=True)
class CounterHealth:
    """History of one message's counter."""

    last: int
    """Last reliable counter value."""
    t_ns: int
    """Arrival time of that frame, ns."""
    late_s: float = 0.0
    """Delay of that frame, s (`daq.samples.counter`)."""
    unreadable: int = 0
    """Number of frames with a wrong checksum since then."""
    received: int = 0
    """Number of frames with a good counter."""
    missing: int = 0
    """Number of frames that were sent and did not arrive."""
    restarts: int = 0
    """Number of restarts of the sensor."""


@dataclass(frozen=True, slots=True)
class HealthState:
    """State of the fold; the default is the initial state."""

    counters: Mapping[str, CounterHealth] = field(default_factory=lambda: MappingProxyType({}))
    """Counters of the received messages that have one."""
    counts: DecodeCounts = NOTHING
    """Total numbers of frames that could not be decoded."""

    @property
    def losses(self) -> Losses:
        """Totals so far, without losses before decoding."""
        missing = sum(counter.missing for counter in self.counters.values())
        counts = zip(_COUNT_NAMES, _COUNTS(self.counts), strict=True)
        return Losses(counter_gaps=missing, **dict(counts))


def advance(messages: Sequence[MessageLayout], state: HealthState, decoded: Decoded) -> HealthState:
    """Return the state after one decoded block.

    `messages`: the codec's messages.  `state`: result of the previous call; `HealthState()` at
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
    assert message.counter is not None  # ensured by the caller
    samples = decoded[f"{message.name}.{message.counter.signal}"]
    good = samples.usable
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
