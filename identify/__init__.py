"""From runs to physical parameters with confidence intervals.  Pure computation."""

from .era import realised_modes
from .modal import ModalModel, Mode, mac, mpc
from .mode_names import mode_names
from .model import PhysicalModel, state_space
from .pipeline import Identification, identify
from .stabilisation import identify_modes
from .stable_poles import StabilisationDiagram, stabilisation_diagram
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
