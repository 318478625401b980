"""From runs to physical parameters with confidence intervals.  Pure computation."""

from .modal import ModalModel, Mode, mac, mpc
from .model import PhysicalModel, state_space
from .pipeline import Identification, identify
from .quality import Quality, Verdict
from .stabilisation import identify_modes
from .uncertainty import Estimate

__all__ = [
    "Estimate",
    "Identification",
    "ModalModel",
    "Mode",
    "PhysicalModel",
    "Quality",
    "Verdict",
    "identify",
    "identify_modes",
    "mac",
    "mpc",
    "state_space",
]
