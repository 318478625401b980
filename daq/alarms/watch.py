"""Watches the recording over the cycles of a recorder, ten per second, and keeps its alarms."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from dbc import Codec
from dbc.codec import Decoded
from dbc.frames import FrameBatch
from dbc.words import Finding, counted

from ..bench.config import RecorderConfig
from ..bus.source import HopLosses, LinkFacts, Now, wire_bits
from ..channels import Quantity
from ..control.messages import Alarm, BusState, BusStatus, DiskStatus, Status, StorageStatus
from ..runs import Event
from ..samples.converter import HealthState
from ..samples.mapping import MappedChannel
from .symptoms import DEAD, WINDOW_S, BusWatch, ChannelRange, Traffic
from .texts import EXPLAINED, RANK, Counts, Key, fault

ALARM, ALARM_END = "alarm", "alarm_end"
"""Codes of the events, which have the text "CODE SUBJECT: TEXT"."""
HOLD_S = 1.5
"""Time without the symptom after which an alarm ends, s."""
_MOST_NAMES = 4
"""Largest number of messages or channels that one line for several alarms names."""
_QUIET_S = 0.4
"""Time without a good frame, s, from which a bus is quiet: its messages are not named one by one.
It is shorter than the least timeout of a message."""
_NOT_RECORDING_S = 3.0
"""Time, s, after which frames that arrive and are not stored raise an alarm.  The queue holds 10 s
of four full buses, so nothing is lost by then; a busy machine or a slow disk may take a second."""
_GROUPED = frozenset({"stale", "counter_gap", "crc_bad", "wrong_length", "saturated", "no_value"})
"""Codes of alarms on messages and channels, which often come together: one line for each code."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """The input of one cycle of the recorder."""

    now: Now
    batch: FrameBatch
    """Frames received; may be empty."""
    decoded: Decoded | None
    """Samples of these frames; None if they were not decoded."""
    health: HealthState
    """The sensors' counters after this block."""
    links: Sequence[LinkFacts]
    """The buses, in the order of their numbers."""
    hops: HopLosses
    """Cumulative counts of losses."""
    disk: DiskStatus
    storage: StorageStatus = field(default_factory=StorageStatus)
    failed: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Parts of the recorder that were switched off after errors, with reasons."""


class Watch:
    """The alarms of a recorder, and the history from which they come."""

    def __init__(self, codec: Codec, mapped: Sequence[MappedChannel]) -> None:
        self.buses: tuple[BusStatus, ...] = ()
        self.sensors_alive = self.sensors_expected = 0
        """Number of messages with channels of the bench: those received, and all."""
        self.overloaded: tuple[str, ...] = ()
        """Channels that reached the end of their range since `acknowledge`."""
        self._bus_watches: list[BusWatch] = []
        self._missing: dict[str, int] = {}  # missing frames, by message
        self._alarms: dict[Key, Alarm] = {}
        self._seen_s: dict[Key, float] = {}  # when the symptom of an alarm was last present
        # Monotonic time, s, and counts of each cycle with a fault in the last second.
        self._counts: deque[tuple[float, Counts]] = deque()
        self._quiet_buses: frozenset[str] = frozenset()  # with channels, without good frames now
        self._queue_dropped = self._t_ns = 0
        self.adopt(codec, mapped)

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The current alarms, in order of severity."""
        return tuple(sorted(self._alarms.values(), key=lambda a: (RANK[a.code], a.subject)))

    @property
    def grouped_alarms(self) -> tuple[Alarm, ...]:
        """The alarms for a person: one line for all messages or channels with the same fault."""
        groups: dict[Key, list[Alarm]] = {}
        for alarm in self.alarms:
            subject = "" if alarm.code in _GROUPED else alarm.subject
            groups.setdefault((alarm.code, subject), []).append(alarm)
        return tuple(_one_line_for(group) for group in groups.values())

    @property
    def dead_bus(self) -> Alarm | None:
        """The alarm on a bus that delivered channels of the bench and no longer does; else None."""
        dead = (a for a in self.alarms if a.code in DEAD and a.subject in self._quiet_buses)
        return next(dead, None)

    def acknowledge(self) -> None:
        """Switch the overload lamps off."""
        self.overloaded = ()

    def adopt(self, codec: Codec, mapped: Sequence[MappedChannel]) -> None:
        """Begin anew with messages and channels; earlier counts do not raise alarms again."""
        expected = tuple(dict.fromkeys(m.message.name for m in mapped))  # messages with channels
        self.sensors_expected = len(expected)
        self._traffic = Traffic(codec, expected, self._missing)
        used = (m for m in mapped if m.channel.quantity is not Quantity.UNUSED)
        self._ranges = [ChannelRange(m) for m in used]

    def advance(self, config: RecorderConfig, cycle: Cycle) -> tuple[Event, ...]:
        """Process one cycle; return the events of the alarms that begin or end."""
        now_s, batch = cycle.now.monotonic_s, cycle.batch
        self._t_ns = int(batch.t_ns[-1]) if len(batch) else self._t_ns or cycle.now.wall_ns
        counts: Counts = {}
        self._advance_buses(cycle, counts)
        self._traffic.advance(batch, cycle.decoded, cycle.health, now_s, counts)
        for channel_range in self._ranges:
            samples = cycle.decoded.samples.get(channel_range.signal) if cycle.decoded else None
            if samples is not None and len(samples.t_ns):
                channel_range.count(samples, counts)
        counts["queue_dropped", ""] = cycle.hops.queue_dropped - self._queue_dropped, ""
        self._queue_dropped = cycle.hops.queue_dropped
        new = {key: count for key, count in counts.items() if count[0] > 0}
        saturated = (subject for code, subject in new if code == "saturated")
        self.overloaded = tuple(dict.fromkeys((*self.overloaded, *saturated)))
        totals = self._totals(new, now_s)
        self.sensors_alive = self._traffic.alive(now_s)
        self.buses = tuple(bus.status(config.silent_s, now_s) for bus in self._bus_watches)
        symptoms: dict[Key, Finding] = {}
        for symptom in self._symptoms(config, cycle, totals):  # the first of several of one key
            symptoms.setdefault((symptom.code, symptom.subject), symptom)
        return tuple(self._update_alarms(symptoms, new, totals, cycle.now))

    def _symptoms(self, config: RecorderConfig, cycle: Cycle, totals: Counts) -> Iterator[Finding]:
        """Yield the faults that are present in a cycle; find which buses deliver no good frames.

        `totals`: counts of the last second.
        """
        now_s = cycle.now.monotonic_s
        yield from _disk_symptoms(config, cycle.disk)
        if (not_recording := _not_recording(cycle.storage)) is not None:
            yield not_recording
        for name, reason in cycle.failed.items():
            yield fault("consumer_failed", name, reason)
        delivers = []  # for each bus, whether it has good frames now
        for bus, status in zip(self._bus_watches, self.buses, strict=True):
            receives = status.state in (BusState.OK, BusState.ERROR_PASSIVE)
            delivers.append(receives and now_s - bus.good_s < _QUIET_S)
            yield from bus.symptoms(status, config.silent_s, now_s)
        self._quiet_buses = frozenset(
            self.buses[number].name
            for number in self._traffic.buses()
            if number < len(delivers) and not delivers[number]
        )
        yield from self._traffic.symptoms(delivers, now_s)
        for (code, subject), (number, detail) in totals.items():
            text = f"{number} {EXPLAINED[code].counted} in the last second"
            yield fault(code, subject, f"{text}: {detail}" if detail else text)

    def _advance_buses(self, cycle: Cycle, counts: Counts) -> None:
        """Add the frames of each bus to its history, and their faults to the counts.

        A bus whose link has another name than in the last cycle begins a new history.
        """
        now_s, batch, bits = cycle.now.monotonic_s, cycle.batch, wire_bits(cycle.batch)
        earlier = {bus.link.name: bus for bus in self._bus_watches}
        self._bus_watches = [
            earlier.get(each.name) or BusWatch(each, now_s) for each in cycle.links
        ]
        for number, (link, bus) in enumerate(zip(cycle.links, self._bus_watches, strict=True)):
            on_bus = batch.bus == number
            of_bus = batch if on_bus.all() else batch.select(on_bus.nonzero()[0])
            bus.advance(link, of_bus, bits[on_bus], now_s, counts)

    def _totals(self, counts: Counts, now_s: float) -> Counts:
        """Return the sum of the counts of the last second by fault, with the latest detail.

        `counts`: of this cycle, which is included.  Fewer than five error frames are left out.
        """
        if counts:
            self._counts.append((now_s, counts))
        while self._counts and self._counts[0][0] <= now_s - WINDOW_S:
            self._counts.popleft()
        totals: Counts = {}
        for _, of_cycle in self._counts:
            for key, (number, detail) in of_cycle.items():
                earlier_number, earlier_detail = totals.get(key, (0, ""))
                totals[key] = earlier_number + number, detail or earlier_detail
        # CAN survives single disturbances.
        return {k: total for k, total in totals.items() if k[0] != "error_frames" or total[0] >= 5}

    def _update_alarms(
        self, symptoms: Mapping[Key, Finding], new: Counts, totals: Counts, now: Now
    ) -> Iterator[Event]:
        """Begin, continue and end alarms by the symptoms of a cycle; yield their events.

        `new` and `totals`: counts of this cycle and of the last second.
        """
        now_s = now.monotonic_s
        for key, symptom in symptoms.items():
            present_alarm = self._alarms.get(key)
            if present_alarm is None:
                since_ns, count = now.wall_ns, totals.get(key, (0, ""))[0]
            else:
                since_ns = present_alarm.since_ns
                count = present_alarm.count + new.get(key, (0, ""))[0]
            alarm = Alarm(*key, symptom.text, symptom.advice, since_ns, count)
            self._alarms[key], self._seen_s[key] = alarm, now_s
            if present_alarm is None:
                yield self._event(ALARM, alarm)
        for key in [k for k in self._alarms if now_s - self._seen_s[k] >= HOLD_S]:
            yield self._event(ALARM_END, self._alarms.pop(key))

    def _event(self, code: str, alarm: Alarm) -> Event:
        """Return the event of an alarm that begins or ends."""
        subject = f" {alarm.subject}" if alarm.subject else ""
        return Event(self._t_ns, code, alarm.count, f"{alarm.code}{subject}: {alarm.text}")


def _one_line_for(alarms: Sequence[Alarm]) -> Alarm:
    """Return one alarm that names the subjects of several with the same code."""
    names = [alarm.subject for alarm in alarms]
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return replace(
        alarms[0],
        subject=", ".join(names[:_MOST_NAMES]) + more,
        since_ns=min(alarm.since_ns for alarm in alarms),
        count=sum(alarm.count for alarm in alarms),
    )


def _disk_symptoms(config: RecorderConfig, disk: DiskStatus) -> Iterator[Finding]:
    """Yield the faults of the disk: it refuses, had to be worked around, or is nearly full."""
    if disk.failed:
        frames = counted(disk.held_frames, "frame is", "frames are")
        waiting = f"; {frames} held in memory" if disk.held_frames else ""
        yield fault("journal_failed", "", f"{disk.failed}{waiting}")
    if disk.warning:
        yield fault("journal_warning", "", disk.warning)
    # Ten reserves, or a tenth of the disk.
    if disk.free_bytes < max(10 * config.reserve_bytes, 0.1 * disk.total_bytes):
        free_ratio = disk.free_bytes / max(disk.total_bytes, 1)
        text = f"{disk.free_bytes / 1e6:,.0f} MB ({free_ratio:.0%}) left on the disk; "
        text += f"recording stops at {config.reserve_bytes / 1e6:,.0f} MB"
        yield fault("disk_low", "", text)


def _not_recording(storage: StorageStatus) -> Finding | None:
    """Return the fault that frames arrive and are not stored; None while they are."""
    if storage.late_s < _NOT_RECORDING_S:
        return None
    text = f"frames arrive, and none was stored for {storage.late_s:.1f} s"
    return fault("not_recording", "", text)


def with_not_recording(status: Status, storage: StorageStatus, wall_ns: int) -> Status:
    """Return a status with the alarm that a hanging writer of the recorder cannot raise itself.

    `status`: the last published one.  Returns the same object if there is no alarm to add.
    """
    symptom = _not_recording(storage)
    if symptom is None or any(a.code in ("not_recording", "journal_failed") for a in status.alarms):
        return status
    since_ns = wall_ns - round(storage.late_s * 1e9)
    alarm = Alarm(symptom.code, "", symptom.text, symptom.advice, since_ns)
    return replace(status, alarms=(alarm, *status.alarms), storage=storage)
