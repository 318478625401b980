"""The planner: the intervals that a campaign will give, from the Fisher information.

``outlook(plan)`` gives the expected interval of every parameter, ``advise(plan)`` also the best
next steps: run, bump, rate, sensor, weight, fact; ``compare_campaigns(plan)`` gives the intervals
of other campaigns as a whole.
"""

from .design import TYPICAL_NOISE, Plan, Runs, Sensor, full_vector, sensor, sensors_of
from .outlook import (
    Advice,
    KnownRuns,
    NextStep,
    Outlook,
    advise,
    compare_campaigns,
    outlook,
    vague,
)

__all__ = [
    "TYPICAL_NOISE",
    "Advice",
    "KnownRuns",
    "NextStep",
    "Outlook",
    "Plan",
    "Runs",
    "Sensor",
    "advise",
    "compare_campaigns",
    "full_vector",
    "outlook",
    "sensor",
    "sensors_of",
    "vague",
]
