"""Alarms: what is wrong with buses, sensors and the recorder, found by a pure fold."""

from .debounce import ALARM, ALARM_END
from .host import with_not_recording
from .texts import EXPLAINED, GRAVITY, Explanation
from .watch import CLOCK_STEP, AlarmState, Turn, acknowledged, reconfigured, watch

__all__ = [
    "ALARM",
    "ALARM_END",
    "CLOCK_STEP",
    "EXPLAINED",
    "GRAVITY",
    "AlarmState",
    "Explanation",
    "Turn",
    "acknowledged",
    "reconfigured",
    "watch",
    "with_not_recording",
]
