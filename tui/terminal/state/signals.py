"""The bell for a distant operator: a terminal has one tone, so signals differ by their rhythm."""

from __future__ import annotations

from enum import Enum

from daq.control.messages import Phase, Status

from .feed import Lost

UNSIGNALLED = ("clock_step", "restamped")
"""Alarms that need no immediate action."""


class Signal(Enum):
    """An event that is signalled; the value has the times at which the bell rings, s."""

    ARMED = (0.0,)
    ACCEPTED = (0.0, 0.2)
    REJECTED = (0.0, 0.2, 0.4)
    ALARM = (0.0, 0.2, 0.8, 1.0)
    LOST = (0.0, 0.2, 0.4, 1.0, 1.2, 1.4)


_PHASES = {
    Phase.ARMED: Signal.ARMED,
    Phase.ACCEPTED: Signal.ACCEPTED,
    Phase.REJECTED: Signal.REJECTED,
}


def signal_of(before: Status | Lost | None, status: Status | Lost) -> Signal | None:
    """Return the signal for news: a verdict first, then an alarm, then ARMED."""
    if isinstance(status, Lost):
        return None if status.starting or before is not None else Signal.LOST
    if not isinstance(before, Status):
        return None
    of_phase = _PHASES.get(status.phase) if status.phase is not before.phase else None
    earlier = {(alarm.code, alarm.subject) for alarm in before.alarms}
    has_new_alarm = any(
        alarm.code not in UNSIGNALLED and (alarm.code, alarm.subject) not in earlier
        for alarm in status.alarms
    )
    if has_new_alarm and of_phase in (None, Signal.ARMED):
        return Signal.ALARM
    return of_phase
