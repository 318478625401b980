"""Reduces alarms to their causes: an alarm that follows from another one is not shown.

The journal holds every alarm; a person reads one line for each cause.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from ..control.messages import Alarm

DEAD_BUS = ("disconnected", "bus_off", "interface_down", "bus_silent", "check_bitrate")
"""Codes of alarms on a bus that delivers no good frame."""
_FOLLOWS_DEAD_BUS = ("error_frames", "error_passive", "garbled", "bus_full", "time_back")
_LOSS = ("queue_dropped", "overrun", "bus_full")
"""Codes of alarms on frames that did not arrive for a known reason."""
_OF_MESSAGE = ("stale", "counter_gap", "crc_bad", "wrong_length")
_OF_CHANNEL = ("stuck", "saturated", "no_value", "not_a_number", "out_of_range")
_FOLLOWS_DISK = ("not_recording", "queue_dropped", "queue_high", "journal_warning", "disk_low")
_SHOWN = 4
"""Number of names that are listed in the text of an alarm; further names are only counted."""
_FAULTS = {
    "stale": "{} silent",
    "counter_gap": "frames of {} are missing by their counters",
    "crc_bad": "bad checksums in {}",
    "wrong_length": "frames of wrong length in {}",
    "stuck": "{} frozen",
    "saturated": "{} at the end of their range",
    "no_value": "{} without a value",
    "not_a_number": "{} with values that are not numbers",
    "out_of_range": "{} out of range",
}
_ADVICE = {
    "stale": "check plug and power of these sensors, and the cables that they share",
    "counter_gap": "check the load of the bus, wiring and power of these sensors",
    "crc_bad": "check wiring and power of these sensors, and crc_rule in bench.toml",
}
"""Advice for an alarm on several messages, where the advice for one message is about one sensor."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """The bus and sensor of each message, as far as they are known from frames."""

    messages: Mapping[str, str]
    """Bus of each message that was received, by name of the message."""
    channels: Mapping[str, str]
    """Message of each channel, by name of the channel."""
    silent_ns: Mapping[str, int]
    """Wall-clock time of the last good frame of each bus that is quiet now, ns since 1970."""

    def bus_of(self, subject: str) -> str:
        """Return the bus of a message or of a channel; empty if it is not known."""
        return self.messages.get(self.channels.get(subject, subject), "")

    def on(self, bus: str) -> tuple[str, ...]:
        """Return the messages of a bus."""
        return tuple(name for name, home in self.messages.items() if home == bus)


def causes(alarms: Sequence[Alarm], wiring: Wiring) -> tuple[Alarm, ...]:
    """Return one alarm for each cause, the worst first.

    `alarms`: in order of severity.
    """
    alarms = _with_silent_buses(alarms, wiring)
    roots = _with_dead_buses([a for a in alarms if not _follows(a, alarms, wiring)], wiring)
    groups: dict[tuple[str, str], list[Alarm]] = {}
    for alarm in roots:
        groups.setdefault((alarm.code, _shared(alarm, wiring)), []).append(alarm)
    return tuple(_together(shared, group, wiring) for (_, shared), group in groups.items())


def dead_bus(shown: Iterable[Alarm], wiring: Wiring) -> Alarm | None:
    """Return the alarm on a bus that carried channels of the bench and is dead now."""
    carrying = {wiring.bus_of(channel) for channel in wiring.channels}
    quiet = carrying.intersection(wiring.silent_ns)
    return next((a for a in shown if a.code in DEAD_BUS and a.subject in quiet), None)


def _with_silent_buses(alarms: Sequence[Alarm], wiring: Wiring) -> list[Alarm]:
    """Return the alarms; one alarm replaces those of a quiet bus whose messages are all silent."""
    silent = {alarm.subject for alarm in alarms if alarm.code == "stale"}
    dead = {alarm.subject for alarm in alarms if alarm.code in DEAD_BUS}
    buses = [
        bus
        for bus in wiring.silent_ns
        if bus not in dead and len(wiring.on(bus)) > 1 and silent.issuperset(wiring.on(bus))
    ]
    found = []
    for bus in buses:
        first = next(a for a in alarms if a.code == "stale" and wiring.bus_of(a.subject) == bus)
        found.append(replace(first, code="bus_silent", subject=bus))
    return [*found, *alarms]


def _follows(alarm: Alarm, alarms: Sequence[Alarm], wiring: Wiring) -> bool:
    """Return True if an alarm follows from another one."""
    codes = {other.code for other in alarms}
    if alarm.code in _FOLLOWS_DISK and "journal_failed" in codes:
        return True
    if alarm.code == "time_back" and "clock_step" in codes:
        return True
    if alarm.code == "journal_warning" and "disk_low" in codes:  # no file to delete
        return True
    bus = alarm.subject if alarm.code in _FOLLOWS_DEAD_BUS else ""
    if alarm.code in (*_OF_MESSAGE, *_OF_CHANNEL):
        bus = wiring.bus_of(alarm.subject)
    roots = {other.code for other in alarms if bus and other.subject == bus}
    if roots.intersection(DEAD_BUS):
        return True
    lost = "queue_dropped" in codes or bool(roots.intersection(_LOSS))
    return lost and alarm.code in ("counter_gap", "stale")


def _with_dead_buses(alarms: Sequence[Alarm], wiring: Wiring) -> list[Alarm]:
    """Return the alarms; that on a dead bus also states which messages are silent since when."""
    done = []
    for alarm in alarms:
        names = wiring.on(alarm.subject)
        if alarm.code in DEAD_BUS and names and alarm.subject in wiring.silent_ns:
            at = datetime.fromtimestamp(wiring.silent_ns[alarm.subject] * 1e-9, UTC)
            what = f"all {len(names)} messages" if len(names) > 1 else names[0]
            silent = f"{what} silent since {at.astimezone():%H:%M:%S}"
            if alarm.code == "bus_silent":
                text = f"bus unplugged or unpowered: {silent}"
                advice = "plug the bus in, and check the power of the sensors"
                alarm = replace(alarm, text=text, advice=advice)
            else:
                alarm = replace(alarm, text=f"{alarm.text}; {silent}")
        done.append(alarm)
    return done


def _shared(alarm: Alarm, wiring: Wiring) -> str:
    """Return the bus or sensor that alarms of one code share if they have one cause."""
    if alarm.code in _OF_MESSAGE:
        return wiring.bus_of(alarm.subject)
    if alarm.code in _OF_CHANNEL:
        return wiring.channels.get(alarm.subject, alarm.subject)
    return alarm.subject


def _together(shared: str, alarms: Sequence[Alarm], wiring: Wiring) -> Alarm:
    """Return one alarm that replaces several with one cause."""
    first = alarms[0]
    if len(alarms) == 1:
        return first
    names = [alarm.subject for alarm in alarms]
    kind = "messages" if first.code in _OF_MESSAGE else "channels"
    number = f"{len(names)} {kind}"
    listed = ": " + ", ".join(names[:_SHOWN])
    if len(names) > _SHOWN:
        listed += f" and {len(names) - _SHOWN} more"
    if kind == "messages" and len(names) == len(wiring.on(shared)):
        number, listed = f"all {number}", ""
    since_ns = min(alarm.since_ns for alarm in alarms)
    return replace(
        first,
        subject=shared,
        text=f"{_FAULTS[first.code].format(number)}{listed}",
        advice=_ADVICE.get(first.code, first.advice),
        since_ns=since_ns,
        count=sum(alarm.count for alarm in alarms),
    )
