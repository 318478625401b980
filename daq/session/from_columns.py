"""Builds a session from columns of a file: channels in SI on their clocks, cut into runs.

The bumps are found by the trigger of the recorder, or the map gives the times of the runs.
"""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dbc.codec import Quality
from dbc.units import known_si
from dbc.words import InputError, counted, printable

from ..bench.campaign import Step
from ..bench.channel_map import ChannelMap, Clock
from ..channels import Channel, Quantity
from ..runs import Event, Run, RunStatus, SampleGroup, allowed_silence_s
from ..samples import trigger
from ..samples.mapping import (
    Column,
    Columns,
    channel_values,
    group_names,
    si_unit,
    trigger_channels,
)
from ..sessions import Session
from .build import utc_text

_BLOCK_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Recording:
    """The channels of a map that a file holds."""

    start_ns: int
    """UTC of its time zero, ns since 1970; 0 if it is not known."""
    channels: tuple[Channel, ...]
    """Channels with their units."""
    groups: tuple[SampleGroup, ...]
    """All samples; `time_s` counts from the time zero."""


def recording(channel_map: ChannelMap, file: Columns) -> Recording:
    """Return the channels of a map that a file holds, in SI.

    Channels of one clock whose values stand in the same rows, but for a tenth of them, are one
    group of samples; a value that one of them lacks is NaN, and its row is marked.  Raises
    InputError if a unit does not fit, or a channel has no increasing times.
    """
    start_ns = 0  # zero of the first clock whose date is known
    channels = []
    # Of each group: clock, times and values by channel; all have an entry for each row.
    sampled: list[tuple[str, NDArray[np.float64], dict[str, NDArray[np.float64]]]] = []
    for stated in channel_map.channels:
        column = file.columns[stated.signal]
        si = si_unit(stated, column.unit, file.where)
        channel = stated.channel(si.unit)
        channels.append(channel)
        clock, time_s, zero_ns = _clock_of(channel, column, channel_map.clock(stated), file)
        if zero_ns := zero_ns or file.start_ns:
            start_ns = start_ns or zero_ns
            time_s = time_s + (zero_ns - start_ns) * 1e-9
        raw = np.asarray(column.values, np.float64)
        value = channel_values(channel, si.factor, si.offset, raw)
        for other_clock, _, values in sampled:
            if clock == other_clock and _in_the_same_rows(value, next(iter(values.values()))):
                values[channel.name] = value
                break
        else:
            sampled.append((clock, time_s, {channel.name: value}))
    clocks = [clock for clock, _, _ in sampled]
    groups = []
    for clock, row_s, values in sampled:
        has_value = np.isfinite(list(values.values()))  # (n_channels, n_rows)
        rows = has_value.any(axis=0) & np.isfinite(row_s)
        time_s = row_s[rows]
        name = f"{clock} {next(iter(values))}" if clocks.count(clock) > 1 else clock
        if np.any(not_later := np.diff(time_s) <= 0.0):
            last_s = time_s[:-1][not_later][0]
            what = f"the times of {printable(name, 100)} do not increase after {last_s:.6g} s"
            advice = "name another column of times, or cut the file there"
            raise InputError(file.where, what, advice)
        t_ns = start_ns + np.rint(time_s * 1e9).astype(np.int64)
        if len(time_s):
            is_whole = has_value[:, rows].all(axis=0)
            quality = np.where(is_whole, 0, Quality.MISSING).astype(np.uint8)
            in_rows = {channel: value[rows] for channel, value in values.items()}
            groups.append(SampleGroup(name, time_s, t_ns, in_rows, quality))
    name_in_file = group_names([group.name for group in groups])
    named_groups = tuple(replace(group, name=name_in_file[group.name]) for group in groups)
    return Recording(start_ns, tuple(channels), named_groups)


def _in_the_same_rows(value: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether at most a tenth of the rows with a value have one of only one column."""
    has_value, has_other = np.isfinite(value), np.isfinite(other)
    n_both = np.count_nonzero(has_value & has_other)
    return bool(n_both >= 0.9 * np.count_nonzero(has_value | has_other))


def _clock_of(
    channel: Channel, column: Column, clock: Clock, file: Columns
) -> tuple[str, NDArray[np.float64], int]:
    """Return name and times, s, (n,), of a channel's clock, and the UTC of its zero, ns, or 0."""
    n = len(column.values)
    if clock.column:
        stamps = file.columns[clock.column]
        time_s, zero_ns = _seconds(stamps, clock.unit, channel)
        name = stamps.name
    elif clock.rate_hz is not None:
        time_s, zero_ns, name = np.arange(n) / clock.rate_hz, 0, f"{clock.rate_hz:g} Hz"
    elif column.clock in file.times_s:
        time_s, zero_ns, name = file.times_s[column.clock], 0, column.clock
    else:
        what = f"{printable(column.name, 100)} has no times in {file.where}"
        advice = "state column or rate_hz in [time], or time_column or rate_hz of the channel"
        raise InputError(f"channel {channel.name}", what, advice)
    if len(time_s) != n:
        n_times = counted(len(time_s), "time")
        what = f"has {counted(n, 'value')}, and its clock {printable(name, 100)} {n_times}"
        raise InputError(f"channel {channel.name}", what, "name the column of its times")
    # Two tables of one rate have different clocks.
    return f"{column.clock} {name}" if clock.rate_hz else name, time_s, zero_ns


def _seconds(stamps: Column, stated: str, channel: Channel) -> tuple[NDArray[np.float64], int]:
    """Return times, s, (n,), and the UTC of their zero, ns, or 0 if they do not count from 1970.

    Times from 1970 are counted from the whole second in which they begin.  It is subtracted before
    they are rounded: in nanoseconds since 1970 a float64 steps by 256.  `stated`: their unit in the
    map; empty: as in the file.  Raises InputError if the unit is none of time, or they lie after
    2100.
    """
    unit = stated or stamps.unit or "s"
    si = known_si(unit)
    if si is None or si.unit != "s":
        what = f"its times {printable(stamps.name, 100)} are in {unit!r}"
        raise InputError(f"channel {channel.name}", what, "state the unit of time: s, ms, us or ns")
    values = stamps.values
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    first_stamp = finite[0] if len(finite) else 0
    year_2100_s = 4_102_444_800.0  # since 1970
    if len(finite) and float(np.abs(finite).max()) * si.factor >= year_2100_s:
        what = f"its times {printable(stamps.name, 100)} reach {finite.max():g} {unit}, after 2100"
        raise InputError(f"channel {channel.name}", what, "state their unit: s, ms, us or ns")
    if float(first_stamp) * si.factor < 1e8:  # s: no recording lasts three years
        return np.asarray(values * si.factor, np.float64), 0
    units_per_s = round(1.0 / si.factor)
    whole_s = int(first_stamp) // units_per_s
    after_whole = values - values.dtype.type(whole_s * units_per_s)  # in `unit`
    return np.asarray(after_whole, np.float64) * si.factor, whole_s * 1_000_000_000


def bumps_in(channel_map: ChannelMap, recorded: Recording) -> tuple[Event, ...]:
    """Return the bumps that the trigger of the recorder finds in a recording.

    Raises InputError if no channel can trigger.
    """
    triggers = {channel.name for channel in trigger_channels(recorded.channels)}
    if not triggers:
        what, advice = "has no channel that can trigger", "add a hub or a body acceleration"
        raise InputError("the channel map", what, f"{advice}, or give the times in [[run]]")
    traces = {
        name: (group.t_ns, value)
        for group in recorded.groups
        for name, value in group.values.items()
        if name in triggers and len(group.t_ns)
    }
    state, events = trigger.TriggerState(), list[Event]()
    # Blocks of one second: the trigger's work grows with the square of their length.
    first_ns = min((int(t_ns[0]) for t_ns, _ in traces.values()), default=0)
    stamps_ns = [t_ns - first_ns for t_ns, _ in traces.values()]
    seconds = {second for ns in stamps_ns for second in np.unique(ns // _BLOCK_NS).tolist()}
    for second in sorted(seconds):  # those that have samples
        span_ns = first_ns + second * _BLOCK_NS, first_ns + (second + 1) * _BLOCK_NS
        block = {}
        for name, (t_ns, value) in traces.items():
            rows = slice(*np.searchsorted(t_ns, span_ns))
            block[name] = t_ns[rows], value[rows]
        state, new_events = trigger.advance(channel_map.trigger, state, block)
        events += new_events
    return tuple(event for event in events if event.code == trigger.BUMP)


def bump_run(channel_map: ChannelMap, recorded: Recording, step: Step, bump: Event) -> Run:
    """Return the run around a bump, as long as the map's trigger states."""
    config = channel_map.trigger
    onset_s = (bump.t_ns - recorded.start_ns) * 1e-9
    begin_s, end_s = onset_s - config.pre_s, onset_s + config.post_s
    run = given_run(channel_map, recorded, step, begin_s, end_s)
    return replace(run, events=(replace(bump, text=step.label),))


def given_run(
    channel_map: ChannelMap, recorded: Recording, step: Step, start_s: float, stop_s: float
) -> Run:
    """Return the run in a window of a recording; it is rejected if a channel does not cover it."""
    groups, reasons = [], list[str]()
    used = {c.name for c in recorded.channels if c.quantity is not Quantity.UNUSED}
    for group in recorded.groups:
        rows = slice(*np.searchsorted(group.time_s, (start_s, stop_s)))
        time_s = group.time_s[rows] - start_s
        values = {name: value[rows] for name, value in group.values.items()}
        if len(time_s):
            columns = (time_s, group.t_ns[rows], values, group.quality[rows])
            groups.append(SampleGroup(group.name, *columns))
        times_s = {n: time_s[np.isfinite(value)] for n, value in values.items() if n in used}
        if times_s and _coverage_fault(time_s, stop_s - start_s):  # named once, not by channel
            times_s = {group.name: time_s}
        faults = {name: _coverage_fault(t_s, stop_s - start_s) for name, t_s in times_s.items()}
        reasons += [f"{name} {fault}" for name, fault in faults.items() if fault]
    missing = used - {name for group in recorded.groups for name in group.values}
    reasons += [f"{name} has no value" for name in sorted(missing)]
    return Run(
        mass_state=step.mass_state,
        excitation=step.excitation,
        repeat=step.repeat,
        t0_ns=recorded.start_ns + round(start_s * 1e9),
        bump_s=channel_map.campaign.bump_s,
        groups=tuple(groups),
        status=RunStatus.REJECTED if reasons else RunStatus.ACCEPTED,
        reasons=tuple(reasons),
    )


def _coverage_fault(time_s: NDArray[np.float64], length_s: float) -> str:
    """Return why samples do not cover a window from 0 to `length_s`; empty if they do.

    Fewer than two samples cover none.
    """
    if len(time_s) < 2:
        return f"has {counted(len(time_s), 'sample')}"
    edge_s = allowed_silence_s(float(np.median(np.diff(time_s))))
    if time_s[0] > edge_s or time_s[-1] < length_s - edge_s:
        return f"reaches only from {time_s[0]:.2f} to {time_s[-1]:.2f} s of {length_s:.2f} s"
    return ""


def session_from_columns(
    channel_map: ChannelMap,
    channels: Sequence[Channel],
    runs: Sequence[Run],
    provenance: Mapping[str, str],
) -> Session:
    """Return the session of runs that were cut from files.

    `channels`: with their units.  `provenance`: software and sources, without uuid, date and map.
    """
    digest = hashlib.sha256()
    for run in runs:
        for group in run.groups:
            digest.update(group.time_s.tobytes())
            for value in group.values.values():
                digest.update(value.tobytes())
    full_provenance = {
        # The same files give the same uuid, however often they are imported.
        "uuid": str(uuid.UUID(bytes=digest.digest()[:16])),
        "created": utc_text(runs[0].t0_ns if runs else 0),
        "channel_map": channel_map.text,
        **provenance,
    }
    vehicle, mass_states = channel_map.vehicle, channel_map.mass_states
    return Session(vehicle, tuple(channels), mass_states, tuple(runs), full_provenance)
