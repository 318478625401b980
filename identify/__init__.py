"""From runs to physical parameters with confidence intervals.  Pure computation."""

from dbc.finding import Finding, Severity

from .document import Document
from .fit.uncertainty import Estimate
from .identification import Identification
from .model.matrices import PhysicalModel, state_space
from .modes.era import realised_modes
from .modes.modal_model import ModalModel, Mode, mac, mpc
from .modes.mode_names import mode_names
from .modes.mode_selection import identify_modes
from .modes.stabilisation import StabilisationDiagram, stabilisation_diagram
from .pipeline import identify
from .trust.finding import Quality, Verdict

__all__ = [
    "Document",
    "Estimate",
    "Finding",
    "Identification",
    "ModalModel",
    "Mode",
    "PhysicalModel",
    "Quality",
    "Severity",
    "StabilisationDiagram",
    "Verdict",
    "identify",
    "identify_modes",
    "mac",
    "mode_names",
    "mpc",
    "realised_modes",
    "stabilisation_diagram",
    "state_space",
]
