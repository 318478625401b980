"""The alarm that keeps a bump from becoming a good run."""

from __future__ import annotations

from daq import Status
from daq.control import Alarm, Phase
from daq.errors import printable

_UNRECORDED = ("journal_failed", "not_recording")
_SENSORS = (
    "disconnected",
    "bus_off",
    "interface_down",
    "bus_silent",
    "check_bitrate",
    "none_of_dbc",
    "stale",
)
"""Alarms that affect a run if sensors of the bench are silent."""
_LOSSES = ("queue_dropped", "overrun", "bus_full", "counter_gap")
_LASTING_NS = 3_000_000_000
"""Age above which an alarm of lost frames means more than one disturbance, ns: a single disturbance
lasts for 2.5 s, because its frames are counted over 1 s and alarms are held for 1.5 s."""

RUNNING = (Phase.TRIGGERED, Phase.DECAY)
"""Phases in which a run is recorded."""


def first_obstacle(status: Status) -> Alarm | None:
    """Return the obstacle that is shown instead of the state; a verdict has priority."""
    read = status.phase is Phase.REJECTED or (
        status.phase is Phase.ACCEPTED and not frames_stand_still(status)
    )
    return None if read else obstacle(status)


def obstacle(status: Status) -> Alarm | None:
    """Return the gravest alarm that would spoil the next run; None without one.

    There is none while a run is recorded, or where no run is due.
    """
    if status.due is None or status.phase in RUNNING:
        return None
    lacking = status.sensors_alive < status.sensors_expected
    for alarm in status.alarms:
        lasting = status.wall_ns - alarm.since_ns >= _LASTING_NS
        if (
            alarm.code in _UNRECORDED
            or (alarm.code in _SENSORS and lacking)
            or (alarm.code in _LOSSES and lasting)
        ):
            return alarm
    return None


def frames_stand_still(status: Status) -> bool:
    """Return True if no sensor of the bench sends, so that the time in the frames stands still."""
    return status.sensors_expected > 0 and status.sensors_alive == 0


def cause_words(alarm: Alarm) -> tuple[str, str, str]:
    """Return the name of the cause with its subject, the advice as a sentence, and the details."""
    from daq.alarms import EXPLAINED

    title = EXPLAINED[alarm.code].title if alarm.code in EXPLAINED else alarm.code
    name = f"{title.upper()}  {printable(alarm.subject, 40)}".rstrip()
    advice = printable(alarm.advice, 160)
    return name, f"{advice[:1].upper()}{advice[1:]}.", printable(alarm.text, 160)
