"""From runs to physical parameters with confidence intervals.  Pure computation."""

from .model import PhysicalModel, state_space
from .modes.era import realised_modes
from .modes.modal import ModalModel, Mode, mac, mpc
from .modes.names import mode_names
from .modes.stabilisation import identify_modes
from .modes.stable_poles import StabilisationDiagram, stabilisation_diagram
from .pipeline import Identification, identify
from .trust.finding import Finding, Quality, Verdict
from .uncertainty import Estimate

__all__ = [
    "Estimate",
    "Finding",
    "Identification",
    "ModalModel",
    "Mode",
    "PhysicalModel",
    "Quality",
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
