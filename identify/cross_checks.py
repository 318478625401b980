"""Checks of a fit that only a report shows: they take seconds and need nothing but the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .fit.cross_validation import Prediction, leave_one_out
from .fit.estimation import Estimation
from .modes.state_variable_method import StabilisationDiagram
from .modes.vehicle_modes import vehicle_diagram

_THIN_HZ = 250.0
"""Rate to which decays are thinned for the diagrams."""


@dataclass(frozen=True, slots=True)
class CrossChecks:
    """Runs predicted by a fit without them, and poles found without a model of the car."""

    predictions: tuple[Prediction, ...] = ()
    """Each run predicted from all the others."""
    diagrams: Mapping[str, StabilisationDiagram] = field(default_factory=dict)
    """Stabilisation diagrams by mass state, where the decays allow one."""


def cross_checks(estimation: Estimation) -> CrossChecks:
    """Predict each run from the others, and find the poles of each mass state over the rank."""
    records = estimation.records
    diagrams = {}
    for state in dict.fromkeys(record.mass_state for record in records):
        mine = [i for i, record in enumerate(records) if record.mass_state == state]
        decays = [estimation.decays[i].thinned(_THIN_HZ) for i in mine]
        diagram = vehicle_diagram([records[i] for i in mine], decays)
        if diagram is not None:
            diagrams[state] = diagram
    return CrossChecks(leave_one_out(estimation), diagrams)
