"""Makes sample groups: the channels of a message, or of a set of messages, on one sensor clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc import Codec
from dbc.layout import MessageLayout
from dbc.samples import Decoded, Quality, Samples

from ..bench.config import Bench
from ..bench.message_rules import SampleSet, SensorClock, sensor_clocks
from ..runs import SampleGroup
from .clock import SensorTimes, arrival_times, even_times, sensor_times, stamped_times
from .mapping import MappedChannel

# Finds the frames that belong to one sample, by the order of arrival or by counters ---------------

Bound = tuple[NDArray[np.intp], NDArray[np.int64]]


def bind(
    number: NDArray[np.int64],
    carrier_ns: NDArray[np.int64],
    rows: NDArray[np.intp],
    t_ns: NDArray[np.int64],
) -> Bound:
    """Find the sample numbers of the frames of a message from the carrier frames around them.

    A sensor sends all frames of a sample in one burst, so a frame belongs to the carrier before it
    or, for messages that are sent ahead of the carrier, to the carrier after it: to the one that is
    nearer in most cases.  If carriers are lost, the frames between the received carriers are
    assigned by their number or, if frames are lost as well, by their time.

    `number`, (n,) int64: sample number of each carrier frame, increasing.  `carrier_ns`, (n,)
    int64: their arrival, in order.  `rows`, (m,) int: names of the frames, returned with their
    numbers.  `t_ns`, (m,) int64: arrival of the frames, in order.  Returns the frames that belong
    to a known sample, one for each sample, (k,), and their sample numbers, increasing, (k,).
    """
    behind = np.searchsorted(carrier_ns, t_ns, "right") - 1
    ahead = np.searchsorted(carrier_ns, t_ns, "left")
    inside = (behind >= 0) & (ahead < len(carrier_ns))
    after = t_ns[inside] - carrier_ns[behind[inside]]
    before = carrier_ns[ahead[inside]] - t_ns[inside]
    if len(after) and np.median(before) < np.median(after):
        # The same search with reversed time.
        mirrored_rows, mirrored = _bind_behind(
            -number[::-1], -carrier_ns[::-1], rows[::-1], -t_ns[::-1]
        )
        return mirrored_rows[::-1], -mirrored[::-1]
    return _bind_behind(number, carrier_ns, rows, t_ns)


def _bind_behind(
    number: NDArray[np.int64],
    carrier_ns: NDArray[np.int64],
    rows: NDArray[np.intp],
    t_ns: NDArray[np.int64],
) -> Bound:
    place = np.searchsorted(carrier_ns, t_ns, "right") - 1
    rows, t_ns, place = rows[place >= 0], t_ns[place >= 0], place[place >= 0]
    sent = np.append(np.diff(number), 1)[place]  # samples until the next received carrier
    count = np.bincount(place, minlength=len(number))
    rank = np.arange(len(place)) - (np.cumsum(count) - count)[place]
    span = np.diff(carrier_ns)
    cycle_ns = float(np.sum(span)) / max(int(number[-1] - number[0]), 1) if len(span) else 1.0
    by_time = np.rint((t_ns - carrier_ns[place]) / max(cycle_ns, 1.0) - 0.25).astype(np.int64)
    offset = np.where(count[place] == sent, rank, np.clip(by_time, 0, sent - 1))
    found, first = np.unique(number[place] + offset, return_index=True)
    return rows[first], found


def bind_counted(
    number: NDArray[np.int64],
    carrier_value: NDArray[np.float64],
    carrier_ns: NDArray[np.int64],
    rows: NDArray[np.intp],
    own_counter: Samples,
    modulus: int,
) -> Bound:
    """Find the sample numbers of a message that also has the carrier's counter.

    `number`, `carrier_value`, `carrier_ns`, (n,) array: sample number, counter and arrival of the
    carrier frames, in order.  `rows`, (m,) int: frames of the message with a readable counter.
    `own_counter`: their counter.  `modulus`: its range.
    """
    t_ns = own_counter.t_ns[rows]
    near = np.clip(np.searchsorted(carrier_ns, t_ns), 1, max(len(carrier_ns) - 1, 1))
    if len(carrier_ns) > 1:
        near -= t_ns - carrier_ns[near - 1] < carrier_ns[near] - t_ns
    else:
        near[:] = 0
    apart = (own_counter.value[rows] - carrier_value[near]).astype(np.int64)
    apart = (apart + modulus // 2) % modulus - modulus // 2
    numbered = number[near] + apart
    kept = (numbered >= number[0]) & (numbered <= number[-1])
    found, first = np.unique(numbered[kept], return_index=True)
    return rows[kept][first], found


# The groups ---------------------------------------------------------------------------------------

_LONGEST_NAME = 64
"""Largest length of a group's name in a session file (`daq.session`), bytes."""


@dataclass(frozen=True, slots=True)
class Timekeeping:
    """The sources of the samples' times on a bench."""

    messages: Mapping[str, MessageLayout]
    """Messages of the bench's codec, by name."""
    clocks: Mapping[str, SensorClock]
    """Time stamp signals, by message."""
    sets: Sequence[SampleSet]
    """Sets of messages that carry a sample together."""


def sample_groups(
    mapped: Sequence[MappedChannel], decoded: Decoded, keeping: Timekeeping, t0_ns: int
) -> tuple[SampleGroup, ...]:
    """Group the channels by sample set or message.

    Each multiplexed channel has its own group, because it comes less often.

    `t0_ns`: origin of the times.  No group is empty.
    """
    names = group_names([m.channel.signal if m.is_multiplexed else m.message.name for m in mapped])
    set_of = {message: each for each in keeping.sets for message in each.messages}
    members: dict[str, list[MappedChannel]] = {}
    sets: dict[str, SampleSet] = {}
    for m in mapped:
        if m.channel.signal not in decoded.samples:
            continue
        if m.is_multiplexed:
            name = names[m.channel.signal]
        elif m.message.name in set_of and _has_carrier(set_of[m.message.name], decoded):
            name = set_of[m.message.name].name
            sets[name] = set_of[m.message.name]
        else:
            name = names[m.message.name]
        members.setdefault(name, []).append(m)
    groups = (
        _set_group(sets[name], channels, decoded, keeping, t0_ns)
        if name in sets
        else _message_group(name, channels, decoded, keeping, t0_ns)
        for name, channels in members.items()
    )
    return tuple(group for group in groups if len(group.time_s))


def group_names(names: Sequence[str]) -> dict[str, str]:
    """Return a valid name in a session file for each name: without dots, not too long."""
    found: dict[str, str] = {}
    for name in dict.fromkeys(names):
        plain = name.replace(".", "_")
        short, number = plain[:_LONGEST_NAME], 2
        while short in found.values():
            short, number = f"{plain[: _LONGEST_NAME - 4]}_{number}", number + 1
        found[name] = short
    return found


def _has_carrier(sample_set: SampleSet, decoded: Decoded) -> bool:
    carrier = decoded.samples.get(".".join(sample_set.carrier))
    return carrier is not None and bool(np.any(carrier.usable))


def _message_group(
    name: str, channels: Sequence[MappedChannel], decoded: Decoded, keeping: Timekeeping, t0_ns: int
) -> SampleGroup:
    first = channels[0]
    t_ns = decoded[first.channel.signal].t_ns
    times = None if first.is_multiplexed else _own_times(first.message, decoded, keeping, t0_ns)
    if times is None:
        rows, quality = np.arange(len(t_ns)), np.zeros(len(t_ns), np.uint8)
        by_arrival = arrival_times if first.is_multiplexed else even_times
        time_s = by_arrival(t_ns, t0_ns).time_s
    else:
        rows, time_s, quality = _between(*times)
    for m in channels:
        quality = quality | decoded[m.channel.signal].quality[rows]
    values = {m.channel.name: m.values(decoded[m.channel.signal])[rows] for m in channels}
    return SampleGroup(name, time_s, t_ns[rows], values, quality)


def _own_times(
    message: MessageLayout, decoded: Decoded, keeping: Timekeeping, t0_ns: int
) -> tuple[NDArray[np.intp], SensorTimes] | None:
    """Return the frames with a readable clock, and their times, if the message has a clock."""
    clock, counter = keeping.clocks.get(message.name), message.counter
    if clock is not None:
        samples = decoded[clock.signal]
        good = _good(samples)
        stamp_s = samples.value[good] * clock.factor
        return good, stamped_times(stamp_s, clock.wrap * clock.factor, samples.t_ns[good], t0_ns)
    if counter is not None and message.cycle_s is not None:
        samples = decoded[f"{message.name}.{counter.signal}"]
        good = _good(samples)
        value = samples.value[good].astype(np.int64)
        return good, sensor_times(
            value, counter.modulus, samples.t_ns[good], message.cycle_s, t0_ns
        )
    return None


def _good(samples: Samples) -> NDArray[np.intp]:
    return np.flatnonzero(samples.usable)


def _between(
    good: NDArray[np.intp], times: SensorTimes
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.uint8]]:
    """Return the frames that are samples, the times of these, and those that come after a gap.

    A frame with a wrong checksum has no clock: its time is interpolated between its neighbours, and
    at the edge of a run it is left out.  A repeated frame is not a sample.
    """
    if not len(good):
        return good, np.zeros(0), np.zeros(0, np.uint8)
    if good[-1] - good[0] == len(good) - 1 and np.all(times.step == 1):  # the usual case
        return good, times.time_s, np.zeros(len(good), np.uint8)
    fresh = times.step > 0
    sure, time_s, step = good[fresh], times.time_s[fresh], times.step[fresh]
    is_sample = np.ones(sure[-1] + 1 - sure[0], bool)
    repeated = good[~fresh]
    is_sample[repeated[(repeated > sure[0]) & (repeated < sure[-1])] - sure[0]] = False
    rows = np.flatnonzero(is_sample) + sure[0]
    place = np.searchsorted(rows, sure)
    quality = np.zeros(len(rows), np.uint8)
    quality[place[1:][step[1:] > np.diff(place)]] = Quality.COUNTER_GAP
    return rows, np.interp(rows, sure, time_s), quality


def _set_group(
    sample_set: SampleSet,
    channels: Sequence[MappedChannel],
    decoded: Decoded,
    keeping: Timekeeping,
    t0_ns: int,
) -> SampleGroup:
    """Align the messages of a set: row k is sample k, whichever of its frames came."""
    carrier, signal = sample_set.carrier
    times = _own_times(keeping.messages[carrier], decoded, keeping, t0_ns)
    assert times is not None  # ensured by message_rules.check_sets
    good, clock = times
    good, time_s = good[clock.step > 0], clock.time_s[clock.step > 0]
    number = np.cumsum(clock.step)[clock.step > 0]
    bound = decoded[f"{carrier}.{signal}"]
    carrier_ns = bound.t_ns[good]
    found: dict[str, tuple[NDArray[np.intp], NDArray[np.int64]]] = {}
    for message in dict.fromkeys(m.message for m in channels):
        first = next(m for m in channels if m.message is message)
        t_ns = decoded[first.channel.signal].t_ns
        if message.name == carrier:
            found[message.name] = good, number
        elif "." not in sample_set.bound_by and message.counter is not None:
            own = decoded[f"{message.name}.{signal}"]
            rows = _good(own)
            found[message.name] = bind_counted(
                number, bound.value[good], carrier_ns, rows, own, message.counter.modulus
            )
        else:
            found[message.name] = bind(number, carrier_ns, np.arange(len(t_ns)), t_ns)
    numbers = np.unique(np.concatenate([each for _, each in found.values()]))
    arrived = np.full(len(numbers), np.iinfo(np.int64).max)
    quality = np.zeros(len(numbers), np.uint8)
    quality[1:][np.diff(numbers) > 1] = Quality.COUNTER_GAP
    values = {m.channel.name: np.full(len(numbers), np.nan) for m in channels}
    for message_name, (rows, own_number) in found.items():
        place = np.searchsorted(numbers, own_number)
        absent = np.ones(len(numbers), np.bool_)
        absent[place] = False
        quality[absent] |= np.uint8(Quality.MISSING)
        for m in channels:
            if m.message.name == message_name:
                samples = decoded[m.channel.signal]
                values[m.channel.name][place] = m.values(samples)[rows]
                quality[place] |= samples.quality[rows]
                arrived[place] = np.minimum(arrived[place], samples.t_ns[rows])
    return SampleGroup(
        sample_set.name, np.interp(numbers, number, time_s), arrived, values, quality
    )


def timekeeping(bench: Bench, codec: Codec) -> Timekeeping:
    """Return the sources of the samples' times on a bench."""
    return Timekeeping(codec.by_name, sensor_clocks(codec, bench.message_rules), bench.sample_sets)
