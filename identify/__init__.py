"""From runs to physical parameters with confidence intervals.  Pure computation."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from dbc.finding import Finding as Finding
    from dbc.finding import Severity as Severity

    from .decays.usable import usable_session as usable_session
    from .document import Document as Document
    from .fit.uncertainty import Estimate as Estimate
    from .identification import Identification as Identification
    from .model.matrices import PhysicalModel as PhysicalModel
    from .model.matrices import state_space as state_space
    from .modes.modal_model import ModalModel as ModalModel
    from .modes.modal_model import Mode as Mode
    from .modes.modal_model import mac as mac
    from .modes.modal_model import mode_names as mode_names
    from .modes.modal_model import mpc as mpc
    from .modes.mode_selection import identify_modes as identify_modes
    from .modes.state_variable_method import StabilisationDiagram as StabilisationDiagram
    from .modes.state_variable_method import realised_modes as realised_modes
    from .modes.state_variable_method import stabilisation_diagram as stabilisation_diagram
    from .pipeline import identify as identify
    from .pipeline import identify_parameters as identify_parameters
    from .trust.finding import Judgement as Judgement
    from .trust.finding import Verdict as Verdict
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
