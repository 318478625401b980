"""From the journal to a session: runs are cut, decoded, mapped to SI, and their losses counted.

Pure: the same journal always gives the same session.
"""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc import Codec, parse_codec
from dbc.frames import FrameBatch
from dbc.layout import MessageLayout
from dbc.samples import UNUSABLE, Decoded

from . import health, trigger
from .campaign import Step
from .clock import SensorTimes, arrival_times, sensor_times
from .config import Bench, parse_bench
from .journal_contents import HopCounts, JournalContents
from .mapping import MappedChannel, map_channels
from .runs import Event, Losses, Run, RunStatus, SampleGroup, Session

_EDGE_S = 0.05
"""A run whose first or last sample lies further inside its window than this is not whole."""


def session_from_journal(contents: JournalContents) -> Session:
    """Build the session that a journal holds.

    Raises
    ------
    InputError
        If the bench.toml or DBC in the journal cannot be used any more.
    """
    bench = parse_bench(contents.bench_text, "bench.toml in the journal", Path(), contents.dbc_text)
    codec = parse_codec(contents.dbc_text, bench.dbc_name)
    digest = hashlib.sha256(contents.frames.data.tobytes() + contents.frames.t_ns.tobytes())
    created = datetime.fromtimestamp(contents.head.wall_ns * 1e-9, UTC)
    provenance = {
        # The same recording has the same name, however often its session is built.
        "uuid": str(uuid.UUID(bytes=digest.digest()[:16])),
        "created": created.isoformat(timespec="seconds"),
        "software": contents.head.software,
        "frames_sha256": digest.hexdigest(),
        "journal_losses": contents.lost.text if contents.lost.any else "none",
        "dbc": contents.dbc_text,
        "bench_toml": contents.bench_text,
    }
    return build_session(bench, codec, contents.frames, contents.events, contents.hops, provenance)


def build_session(
    bench: Bench,
    codec: Codec,
    frames: FrameBatch,
    events: Sequence[Event],
    hops: HopCounts,
    provenance: dict[str, str],
) -> Session:
    """Cut the runs out of a recording.

    A run reaches from `pre_s` before to `post_s` after a `bump` event.  Known delays of the
    channels are not taken off the times: that is the identification's business, which also knows
    how uncertain they are.

    Parameters
    ----------
    bench : Bench
        Channels, campaign and trigger times.
    codec : Codec
        The bench's DBC.
    frames : FrameBatch
        All frames in order of arrival.
    events : sequence of Event
        As the recorder stored them.
    hops : HopCounts
        Losses between wire and journal.
    provenance : mapping of str to str
        Taken over.
    """
    mapped = map_channels(bench.channels, codec.messages, bench.dbc_name)
    steps = {step.label: step for step in bench.campaign.steps}
    runs = [
        _run(bench, codec, mapped, steps[event.text], event, frames, events, hops)
        for event in events
        if event.code == trigger.BUMP and event.text in steps
    ]
    return Session(
        vehicle=bench.vehicle,
        channels=tuple(m.channel for m in mapped),
        mass_states=bench.mass_states,
        runs=tuple(runs),
        provenance=provenance,
    )


def _run(
    bench: Bench,
    codec: Codec,
    mapped: Sequence[MappedChannel],
    step: Step,
    bump: Event,
    frames: FrameBatch,
    events: Sequence[Event],
    hops: HopCounts,
) -> Run:
    start_ns = bump.t_ns - round(bench.trigger.pre_s * 1e9)
    stop_ns = bump.t_ns + round(bench.trigger.post_s * 1e9)
    own = frames.select((frames.t_ns >= start_ns) & (frames.t_ns < stop_ns))
    decoded = codec.decode(own)
    groups, reasons = [], []
    for message in codec.messages:
        channels = [m for m in mapped if m.message.name == message.name]
        if not channels:
            continue
        group = _group(message, channels, decoded, start_ns)
        if group is None:
            reasons.append(f"no frame of {message.name} ({message.can_id:#x}) was received")
            continue
        groups.append(group)
        length_s = (stop_ns - start_ns) * 1e-9
        if group.time_s[0] > _EDGE_S or group.time_s[-1] < length_s - _EDGE_S:
            span = f"{group.time_s[0]:.2f} to {group.time_s[-1]:.2f} s"
            reasons.append(f"{message.name} was received only from {span} of {length_s:.2f} s")
    return Run(
        mass_state=step.mass_state,
        excitation=step.excitation,
        repeat=step.repeat,
        t0_ns=start_ns,
        bump_s=bench.bump_s,
        groups=tuple(groups),
        status=RunStatus.REJECTED if reasons else RunStatus.ACCEPTED,
        reasons=tuple(reasons),
        losses=_losses(codec, decoded, hops, start_ns, stop_ns),
        events=tuple(e for e in events if start_ns <= e.t_ns <= stop_ns),
        frames=own,
    )


def _group(
    message: MessageLayout, channels: Sequence[MappedChannel], decoded: Decoded, t0_ns: int
) -> SampleGroup | None:
    """Return the samples of one message, None if there are none."""
    first = decoded.samples.get(channels[0].channel.signal)
    if first is None or not len(first.t_ns):
        return None
    times = _times(message, decoded, first.t_ns, t0_ns)
    keep = ~times.repeated
    values: dict[str, NDArray[np.float64]] = {}
    quality = np.zeros(int(keep.sum()), np.uint8)
    for m in channels:
        samples = decoded[m.channel.signal]
        values[m.channel.name] = m.values(samples)[keep]
        quality |= samples.quality[keep]
    return SampleGroup(message.name, times.time_s[keep], first.t_ns[keep], values, quality)


def _times(
    message: MessageLayout, decoded: Decoded, t_ns: NDArray[np.int64], t0_ns: int
) -> SensorTimes:
    """Return when the samples were taken: by the sensor's counter if it has one."""
    if message.counter is None or message.cycle_s is None:
        return arrival_times(t_ns, t0_ns)
    counter = decoded[f"{message.name}.{message.counter.signal}"]
    good = (counter.quality & UNUSABLE) == 0
    if good.all():
        value = counter.value.astype(np.int64)
        return sensor_times(value, message.counter.modulus, t_ns, message.cycle_s, t0_ns)
    # A frame that was garbled has no counter; its samples are unusable, and so its time is free.
    value = counter.value[good].astype(np.int64)
    fitted = sensor_times(value, message.counter.modulus, t_ns[good], message.cycle_s, t0_ns)
    time_s = np.full(len(t_ns), np.nan)
    repeated = np.ones(len(t_ns), bool)
    time_s[good], repeated[good] = fitted.time_s, fitted.repeated
    return SensorTimes(time_s, repeated)


def _losses(
    codec: Codec, decoded: Decoded, hops: HopCounts, start_ns: int, stop_ns: int
) -> Losses:
    sensors = health.advance(codec.messages, health.HealthState(), decoded).losses
    wire = hops.between(start_ns, stop_ns)
    return health.losses_added(
        sensors,
        Losses(
            bus_dropped=wire.bus_dropped,
            bus_garbled=wire.bus_garbled,
            queue_dropped=wire.queue_dropped,
        ),
    )
