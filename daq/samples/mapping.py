"""Maps signals to channels of the bench, in SI, and groups them by sensor clock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc import Codec
from dbc.codec import Decoded, MessageLayout, Quality, Samples, SignalLayout
from dbc.units import SiUnit, known_si
from dbc.words import InputError

from ..bench.campaign import Method
from ..bench.config import Bench
from ..bench.sensors import SampleSet, SensorClock, sensor_clocks
from ..channels import LARGEST, SI_UNITS, Channel, Quantity, signal_of
from ..runs import SampleGroup
from .clock import SensorTimes, arrival_times, even_times, sensor_times, stamped_times

# Defines the form in which samples of several channels are passed on ------------------------------

Trace = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Time stamps, ns, and values, SI, of one channel, each of shape (n,)."""
SampleBlock = Mapping[str, Trace]
"""The traces of some channels, by channel name."""


# The mapping --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class MappedChannel:
    """A channel and the conversion of its signal."""

    channel: Channel
    """The channel, with the unit filled in."""
    message: MessageLayout
    factor: float
    offset: float
    """Offset of the SI value, which is factor * signal + offset, before sign, scale and tare."""

    @property
    def signal(self) -> SignalLayout:
        """The signal that carries the channel."""
        return self.message.signal(signal_of(self.channel.signal))

    @property
    def is_multiplexed(self) -> bool:
        """True if only some frames of the message hold the signal."""
        return self.signal.selector is not None

    @property
    def step(self) -> float:
        """Step of the converter in the channel's unit; 0 for a floating-point signal."""
        factor = 0.0 if self.signal.is_float else self.signal.factor
        return abs(self.factor * self.channel.scale * factor)

    def values(self, samples: Samples) -> NDArray[np.float64]:
        """Return the channel's values (`daq.channels.Channel`), (n,); NaN where unusable.

        A value that no sensor shows is unusable, unless the channel is only recorded.
        """
        value = channel_values(self.channel, self.factor, self.offset, samples.value)
        if samples.quality.any():
            value[~samples.usable] = np.nan
        if self.channel.quantity is not Quantity.UNUSED:
            value[np.abs(value) > LARGEST] = np.nan
        return value


def mapped_block(mapped: Iterable[MappedChannel], decoded: Decoded) -> SampleBlock:
    """Return the samples of the channels whose signals were received."""
    return {
        m.channel.name: (samples.t_ns, m.values(samples))
        for m in mapped
        if (samples := decoded.samples.get(m.channel.signal)) is not None
    }


def channel_values(
    channel: Channel, factor: float, offset: float, value: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the values of a channel: ``factor * value + offset`` in SI, with sign, scale, tare."""
    return (factor * value + offset) * (channel.sign * channel.scale) - channel.tare


def map_channels(
    channels: Sequence[Channel], messages: Sequence[MessageLayout], dbc_name: str
) -> tuple[MappedChannel, ...]:
    """Return each channel with its signal, whose unit must fit the quantity.

    Raises InputError if a signal is not in the DBC, or its unit is unknown or of another quantity.
    """
    known = {f"{m.name}.{s.name}": (m, s) for m in messages for s in m.signals}
    mapped = []
    for channel in channels:
        if channel.signal not in known:
            where, problem = f"signal of channel {channel.name}", f"{dbc_name} has no signal"
            advice = "write signal as Message.signal of the DBC or sensor.signal of a [[sensor]]"
            raise InputError(where, f"{problem} {channel.signal!r}", advice)
        message, signal = known[channel.signal]
        si = si_unit(channel, signal.unit, dbc_name)
        unit_channel = replace(channel, unit=si.unit)
        mapped.append(MappedChannel(unit_channel, message, si.factor, si.offset))
    return tuple(mapped)


def si_unit(channel: Channel, stated: str, source: str) -> SiUnit:
    """Return the conversion of a channel's signal to SI.

    `stated`: unit of the signal in `source`, a DBC or a file.  A channel that is only recorded
    keeps an unknown unit.  Raises InputError if the unit does not fit the quantity.
    """
    unit = channel.signal_unit or stated
    si = known_si(unit)
    expected = SI_UNITS.get(channel.quantity, "")
    if not expected:
        return si or SiUnit(1.0, 0.0, unit)
    if si is not None and si.unit == expected:
        return si
    where = "its [[channel]]" if channel.signal_unit else source
    problem = f"{channel.signal} has unit {unit!r} in {where}"
    advice = "correct signal, signal_unit or quantity in its [[channel]]"
    if si is None:
        problem, advice = f"{problem}, which is not known", "state signal_unit in its [[channel]]"
    needed = f"{channel.quantity} needs {expected} or a multiple"
    raise InputError(f"channel {channel.name}", f"{problem}; {needed}", advice)


def trigger_channels(
    channels: tuple[Channel, ...], method: Method = Method.ROLL_OVER
) -> tuple[Channel, ...]:
    """Return the channels that trigger: the hub accelerations or, without these, those of the body.

    A push moves the body and hardly the wheels: then those of the body have priority.
    """
    hubs = tuple(c for c in channels if c.quantity is Quantity.HUB_ACCELERATION)
    body = tuple(c for c in channels if c.quantity is Quantity.BODY_ACCELERATION)
    return (body or hubs) if method is Method.PUSH else (hubs or body)


def mapped_channels(bench: Bench, codec: Codec) -> tuple[MappedChannel, ...]:
    """Return the bench's channels, mapped to the signals of its DBC.

    Raises InputError, with the file, if a channel contradicts the DBC.
    """
    try:
        return map_channels(bench.channels, codec.messages, bench.dbc_name)
    except InputError as error:
        raise InputError(bench.where, f"{error.where}: {error.what}", error.advice) from error


def bench_mapping(bench: Bench, codec: Codec) -> tuple[tuple[MappedChannel, ...], frozenset[str]]:
    """Return the bench's channels, and the names of those that trigger.

    Raises InputError if a channel contradicts the DBC, or no channel can trigger.
    """
    # All channels are mapped, not only triggers: errors are found before the first bump.
    mapped = mapped_channels(bench, codec)
    triggers = frozenset(c.name for c in trigger_channels(bench.channels, bench.campaign.method))
    if not triggers:
        problem, advice = "has no channel that can trigger", "add a hub or a body acceleration"
        raise InputError("bench.toml", problem, advice)
    return mapped, triggers


# Columns of numbers in files that are not bus logs, as their readers return them ------------------


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column of a file."""

    name: str
    """Full name in the file, with folders, groups and structs before it, separated by slashes."""
    unit: str
    """Unit as stated in the file; empty if none is stated."""
    clock: str
    """Name of the clock that gives its times: a table, a group, a message."""
    values: NDArray[Any]
    """Numbers, shape (n,): floating point with NaN for missing ones, or integers."""


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Some columns of a file."""

    where: str
    """Name of the file, for messages."""
    start_ns: int
    """UTC of the file's time zero, ns since 1970; 0 if it states none."""
    columns: Mapping[str, Column]
    """Columns, by the requested name."""
    times_s: Mapping[str, NDArray[np.float64]]
    """Times of the clocks that have times in the file, s since its time zero."""
    unread: tuple[str, ...] = ()
    """Cells that could not be read, each kind with its number and first line."""


# Finds the frames that belong to one sample, by the order of arrival or by counters ---------------

Bound = tuple[NDArray[np.intp], NDArray[np.int64]]
"""Frames of a message that belong to a known sample, one for each, and the numbers of these
samples, increasing; both of shape (k,)."""


def bind(
    number: NDArray[np.int64], carrier_ns: NDArray[np.int64], t_ns: NDArray[np.int64]
) -> Bound:
    """Return the frames of a message with their sample numbers, by the carrier frames around them.

    A sensor sends all frames of a sample in one burst, so a frame belongs to the carrier before it
    or, for messages that are sent ahead of the carrier, to the carrier after it: to the one that is
    nearer in most cases.  If carriers are lost, the frames between the received carriers are
    assigned by their number or, if frames are lost as well, by their time.

    `number`, (n,) int64: sample number of each carrier frame, increasing.  `carrier_ns`, (n,)
    int64: their arrival, in order.  `t_ns`, (m,) int64: arrival of the message's frames.
    """
    carrier_before = np.searchsorted(carrier_ns, t_ns, "right") - 1
    carrier_after = np.searchsorted(carrier_ns, t_ns, "left")
    has_both = (carrier_before >= 0) & (carrier_after < len(carrier_ns))
    since_ns = t_ns[has_both] - carrier_ns[carrier_before[has_both]]
    until_ns = carrier_ns[carrier_after[has_both]] - t_ns[has_both]
    if len(since_ns) and np.median(until_ns) < np.median(since_ns):
        # The same search with reversed time.
        rows, numbers = _bind_behind(-number[::-1], -carrier_ns[::-1], -t_ns[::-1])
        return len(t_ns) - 1 - rows[::-1], -numbers[::-1]
    return _bind_behind(number, carrier_ns, t_ns)


def _bind_behind(
    number: NDArray[np.int64], carrier_ns: NDArray[np.int64], t_ns: NDArray[np.int64]
) -> Bound:
    """Return frames with their sample numbers, as `bind`, from the carrier before each.

    The frames between two received carriers are counted if none is missing, else placed by time.
    """
    carrier = np.searchsorted(carrier_ns, t_ns, "right") - 1  # row of the carrier before each
    rows = np.flatnonzero(carrier >= 0)
    t_ns, carrier = t_ns[rows], carrier[rows]
    samples_to_next = np.append(np.diff(number), 1)[carrier]  # up to the next received carrier
    frames_of_carrier = np.bincount(carrier, minlength=len(number))
    rank = np.arange(len(carrier)) - (np.cumsum(frames_of_carrier) - frames_of_carrier)[carrier]
    n_samples = max(int(number[-1] - number[0]), 1)
    cycle_ns = max(float(carrier_ns[-1] - carrier_ns[0]) / n_samples, 1.0)
    # A frame follows the carrier of its own sample by about a quarter of a cycle.
    samples_by_time = np.rint((t_ns - carrier_ns[carrier]) / cycle_ns - 0.25).astype(np.int64)
    is_complete = frames_of_carrier[carrier] == samples_to_next
    samples_by_time = np.clip(samples_by_time, 0, samples_to_next - 1)
    samples_after = np.where(is_complete, rank, samples_by_time)
    numbers, first_of_number = np.unique(number[carrier] + samples_after, return_index=True)
    return rows[first_of_number], numbers


def bind_counted(
    number: NDArray[np.int64],
    carrier_value: NDArray[np.float64],
    carrier_ns: NDArray[np.int64],
    counter: Samples,
    modulus: int,
) -> Bound:
    """Return the frames of a message that also has the carrier's counter, with sample numbers.

    Each number is that of the carrier nearest in time, plus the shortest way between both counters.

    `number`, `carrier_value`, `carrier_ns`, (n,) array: sample number, counter and arrival of the
    carrier frames, in order.  `counter`: of all frames of the message; frames whose counter cannot
    be read are left out.  `modulus`: its range.
    """
    rows = np.flatnonzero(counter.usable)
    t_ns = counter.t_ns[rows]
    last_carrier = len(carrier_ns) - 1
    carrier_after = np.clip(np.searchsorted(carrier_ns, t_ns), min(1, last_carrier), last_carrier)
    carrier_before = np.maximum(carrier_after - 1, 0)
    is_nearer = t_ns - carrier_ns[carrier_before] < carrier_ns[carrier_after] - t_ns
    nearest = np.where(is_nearer, carrier_before, carrier_after)  # in time: row of that carrier
    counter_ahead = (counter.value[rows] - carrier_value[nearest]).astype(np.int64)
    numbers = number[nearest] + (counter_ahead + modulus // 2) % modulus - modulus // 2
    is_recorded = (numbers >= number[0]) & (numbers <= number[-1])
    numbers, first_of_number = np.unique(numbers[is_recorded], return_index=True)
    return rows[is_recorded][first_of_number], numbers


# The groups ---------------------------------------------------------------------------------------

_LONGEST_NAME = 64
"""Largest length of a group's name in a session file, bytes."""


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
    """Return the samples of the channels in groups: one for each sample set or message.

    Each multiplexed channel has its own group, because it comes less often.  `t0_ns`: origin of the
    times.  No group is empty.
    """
    sources = [m.channel.signal if m.is_multiplexed else m.message.name for m in mapped]
    name_in_file = group_names(sources)
    set_of_message = {  # by message; only sets whose carrier was received
        message: sample_set
        for sample_set in keeping.sets
        if (carrier := decoded.samples.get(".".join(sample_set.carrier))) and carrier.usable.any()
        for message in sample_set.messages
    }
    channels_of_group: dict[str, list[MappedChannel]] = {}
    set_of_group: dict[str, SampleSet] = {}
    for m, source in zip(mapped, sources, strict=True):
        if m.channel.signal in decoded.samples:
            name, sample_set = name_in_file[source], set_of_message.get(m.message.name)
            if sample_set is not None and not m.is_multiplexed:
                name = sample_set.name
                set_of_group[name] = sample_set
            channels_of_group.setdefault(name, []).append(m)
    groups = (
        _set_group(set_of_group[name], channels, decoded, keeping, t0_ns)
        if name in set_of_group
        else _message_group(name, channels, decoded, keeping, t0_ns)
        for name, channels in channels_of_group.items()
    )
    return tuple(group for group in groups if len(group.time_s))


def group_names(names: Sequence[str]) -> dict[str, str]:
    """Return a name that a session file can hold for each name: no dot or slash, not too long."""
    short_names: dict[str, str] = {}
    for name in dict.fromkeys(names):
        plain = name.replace(".", "_").replace("/", "_").encode(errors="replace")
        short, number = plain[:_LONGEST_NAME].decode(errors="ignore"), 2
        while short in short_names.values():
            begin = plain[: _LONGEST_NAME - 4].decode(errors="ignore")
            short, number = f"{begin}_{number}", number + 1
        short_names[name] = short
    return short_names


def _message_group(
    name: str, channels: Sequence[MappedChannel], decoded: Decoded, keeping: Timekeeping, t0_ns: int
) -> SampleGroup:
    """Return the samples of channels of one message, or those of a multiplexed channel.

    Their times are those of the message's clock.  Without one they follow from the arrivals, which
    are evenly spaced unless the channel is multiplexed.
    """
    message, is_multiplexed = channels[0].message, channels[0].is_multiplexed
    t_ns = decoded[channels[0].channel.signal].t_ns
    timed = None if is_multiplexed else _clock_times(message, decoded, keeping, t0_ns)
    if timed is not None:
        rows, time_s, quality = _all_samples(*timed)
    else:
        rows, quality = np.arange(len(t_ns)), np.zeros(len(t_ns), np.uint8)
        times = arrival_times(t_ns, t0_ns) if is_multiplexed else even_times(t_ns, t0_ns)
        time_s = times.time_s
    for m in channels:
        quality = quality | decoded[m.channel.signal].quality[rows]
    values = {m.channel.name: m.values(decoded[m.channel.signal])[rows] for m in channels}
    return SampleGroup(name, time_s, t_ns[rows], values, quality)


def _clock_times(
    message: MessageLayout, decoded: Decoded, keeping: Timekeeping, t0_ns: int
) -> tuple[NDArray[np.intp], SensorTimes] | None:
    """Return rows and times of the frames with a readable clock; None if the message has none."""
    clock, counter = keeping.clocks.get(message.name), message.counter
    if clock is not None:
        samples = decoded[clock.signal]
        clock_rows = np.flatnonzero(samples.usable)
        stamp_s, t_ns = samples.value[clock_rows] * clock.factor, samples.t_ns[clock_rows]
        return clock_rows, stamped_times(stamp_s, clock.wrap * clock.factor, t_ns, t0_ns)
    if counter is not None and message.cycle_s is not None:
        samples = decoded[f"{message.name}.{counter.signal}"]
        clock_rows = np.flatnonzero(samples.usable)
        value, t_ns = samples.value[clock_rows].astype(np.int64), samples.t_ns[clock_rows]
        return clock_rows, sensor_times(value, counter.modulus, t_ns, message.cycle_s, t0_ns)
    return None


def _all_samples(
    clock_rows: NDArray[np.intp], times: SensorTimes
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.uint8]]:
    """Return rows, times, s, and quality of the frames that are samples; each of shape (k,).

    `clock_rows`: rows of the frames with a readable clock.  `times`: of these frames.

    A frame with a wrong checksum has no clock: its time is interpolated between its neighbours, and
    at the edge of a run it is left out.  A repeated frame is not a sample.
    """
    if not len(clock_rows):
        return clock_rows, np.zeros(0), np.zeros(0, np.uint8)
    is_new = times.step > 0
    timed_rows, time_s, step = clock_rows[is_new], times.time_s[is_new], times.step[is_new]
    rows = np.setdiff1d(np.arange(timed_rows[0], timed_rows[-1] + 1), clock_rows[~is_new])
    timed_position = np.searchsorted(rows, timed_rows)
    quality = np.zeros(len(rows), np.uint8)
    # Where the clock counts more samples than rows since the last timed row, frames are missing.
    quality[timed_position[1:][step[1:] > np.diff(timed_position)]] = Quality.COUNTER_GAP
    return rows, np.interp(rows, timed_rows, time_s), quality


def _set_group(
    sample_set: SampleSet,
    channels: Sequence[MappedChannel],
    decoded: Decoded,
    keeping: Timekeeping,
    t0_ns: int,
) -> SampleGroup:
    """Return the samples that the messages of a set carry together, one row for each sample.

    Samples are numbered by the clock of the carrier message; NaN stands for missing frames.
    """
    carrier, counter_signal = sample_set.carrier
    times = _clock_times(keeping.messages[carrier], decoded, keeping, t0_ns)
    assert times is not None  # ensured by bench.sensors.check_sets
    clock_rows, clock = times
    is_new = clock.step > 0
    carrier_rows, carrier_number = clock_rows[is_new], np.cumsum(clock.step)[is_new]
    carriers = decoded[f"{carrier}.{counter_signal}"]
    carrier_ns, carrier_value = carriers.t_ns[carrier_rows], carriers.value[carrier_rows]
    bound: dict[str, Bound] = {}
    for name, m in {m.message.name: m for m in channels}.items():  # a channel of each message
        if name == carrier:
            bound[name] = carrier_rows, carrier_number
        elif "." not in sample_set.bound_by and m.message.counter is not None:
            counter, modulus = decoded[f"{name}.{counter_signal}"], m.message.counter.modulus
            bound[name] = bind_counted(carrier_number, carrier_value, carrier_ns, counter, modulus)
        else:
            bound[name] = bind(carrier_number, carrier_ns, decoded[m.channel.signal].t_ns)
    sample_number = np.unique(np.concatenate([numbers for _, numbers in bound.values()]))
    time_s = np.interp(sample_number, carrier_number, clock.time_s[is_new])
    return _aligned_group(sample_set.name, channels, decoded, bound, sample_number, time_s)


def _aligned_group(
    name: str,
    channels: Sequence[MappedChannel],
    decoded: Decoded,
    bound: Mapping[str, Bound],
    sample_number: NDArray[np.int64],
    time_s: NDArray[np.float64],
) -> SampleGroup:
    """Return the channels of a set as columns of one row for each sample number, at its time.

    `bound`: by message.  `sample_number`, (n,): all numbers in it, increasing.
    """
    n = len(sample_number)
    first_arrival_ns = np.full(n, np.iinfo(np.int64).max)
    quality = np.zeros(n, np.uint8)
    quality[1:][np.diff(sample_number) > 1] = Quality.COUNTER_GAP
    values = {m.channel.name: np.full(n, np.nan) for m in channels}
    for m in channels:
        rows, numbers = bound[m.message.name]
        position, samples = np.searchsorted(sample_number, numbers), decoded[m.channel.signal]
        quality[~np.isin(sample_number, numbers)] |= np.uint8(Quality.MISSING)
        values[m.channel.name][position] = m.values(samples)[rows]
        quality[position] |= samples.quality[rows]
        first_arrival_ns[position] = np.minimum(first_arrival_ns[position], samples.t_ns[rows])
    return SampleGroup(name, time_s, first_arrival_ns, values, quality)


def timekeeping(bench: Bench, codec: Codec) -> Timekeeping:
    """Return the sources of the samples' times on a bench."""
    return Timekeeping(codec.by_name, sensor_clocks(codec, bench.message_rules), bench.sample_sets)
