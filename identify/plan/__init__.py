"""The planner: the intervals that a campaign will give, from the Fisher information.

``outlook(plan)`` gives the expected interval of every parameter, ``advise(plan)`` also the best
next steps: run, bump, rate, sensor, weight, fact.
"""

from .design import TYPICAL_NOISE, Plan, Runs, Sensor, full_vector, sensor, sensors_of
from .outlook import Outlook, vague
from .ranking import Advice, NextStep, advise, outlook

__all__ = [
    "TYPICAL_NOISE",
    "Advice",
    "NextStep",
    "Outlook",
    "Plan",
    "Runs",
    "Sensor",
    "advise",
    "full_vector",
    "outlook",
    "sensor",
    "sensors_of",
    "vague",
]
