"""The planner: the intervals that a campaign will give, from the Fisher information.

``outlook(plan)`` gives the expected interval of every parameter, ``advise(plan)`` also the best
next steps: run, bump, rate, sensor, weight, fact; ``compare_campaigns(plan)`` gives the intervals
of other campaigns as a whole.
"""

from .design import (
    TYPICAL_NOISE,
    USUAL_ELEMENTS,
    ExpectedElements,
    Plan,
    Runs,
    Sensor,
    element_label,
    full_vector,
    identified_elements,
    sensor,
    sensors_of,
    typical_elements,
)
from .information import KnownRuns
from .outlook import Advice, NextStep, Outlook, advise, compare_campaigns, outlook, vague

__all__ = [
    "TYPICAL_NOISE",
    "USUAL_ELEMENTS",
    "Advice",
    "ExpectedElements",
    "KnownRuns",
    "NextStep",
    "Outlook",
    "Plan",
    "Runs",
    "Sensor",
    "advise",
    "compare_campaigns",
    "element_label",
    "full_vector",
    "identified_elements",
    "outlook",
    "sensor",
    "sensors_of",
    "typical_elements",
    "vague",
]
