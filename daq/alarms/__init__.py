"""Finds what is wrong with buses, sensors and the recorder, by a pure fold over recorder cycles."""

from .debounce import ALARM, ALARM_END
from .host import with_not_recording
from .texts import EXPLAINED, GRAVITY, Explanation
from .watch import CLOCK_STEP, AlarmState, Cycle, acknowledged, reconfigured, watch

__all__ = [
    "ALARM",
    "ALARM_END",
    "CLOCK_STEP",
    "EXPLAINED",
    "GRAVITY",
    "AlarmState",
    "Cycle",
    "Explanation",
    "acknowledged",
    "reconfigured",
    "watch",
    "with_not_recording",
]
