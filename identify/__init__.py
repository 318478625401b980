"""From runs to physical parameters with confidence intervals.  Pure computation."""

from dbc.words import Finding, Severity

from .decays.usable import usable_session
from .fit.uncertainty import Estimate
from .model.matrices import PhysicalModel
from .model.matrices import physical_model as state_space
from .modes.modal_model import ModalModel, mac, mode_names
from .modes.mode_selection import identify_modes
from .modes.state_variable_method import (
    StabilisationDiagram,
    realised_modes,
    stabilisation_diagram,
)
from .pipeline import identify, identify_parameters
from .result import Identification
from .trust.finding import Judgement, Verdict

__all__ = [
    "Estimate",
    "Finding",
    "Identification",
    "Judgement",
    "ModalModel",
    "PhysicalModel",
    "Severity",
    "StabilisationDiagram",
    "Verdict",
    "identify",
    "identify_modes",
    "identify_parameters",
    "mac",
    "mode_names",
    "realised_modes",
    "stabilisation_diagram",
    "state_space",
    "usable_session",
]
