"""Watches buses, sensors and the recorder, and says what is wrong with them."""

from .texts import EXPLAINED, GRAVITY, Explanation
from .watch import ALARM, ALARM_END, CLOCK_STEP, Cycle, Watch, with_not_recording

__all__ = [
    "ALARM",
    "ALARM_END",
    "CLOCK_STEP",
    "EXPLAINED",
    "GRAVITY",
    "Cycle",
    "Explanation",
    "Watch",
    "with_not_recording",
]
