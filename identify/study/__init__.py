"""The paper's tables and figures, reproduced."""

from .added_mass import fig2, mass_error_study
from .campaign import PAPER_MASS_STATES, Campaign
from .fig9 import fig9
from .figures import svg
from .fleet import FleetCase, fleet_case, fleet_study, fractions
from .geometry_error import fig8
from .noise import bound_percent, noise_study, outcome
from .result import Cell, Column, Study
from .sensor_sets import SENSOR_SETS
from .table2 import table2
from .table3 import attempt, table3, table3_campaign

__all__ = [
    "PAPER_MASS_STATES",
    "SENSOR_SETS",
    "Campaign",
    "Cell",
    "Column",
    "FleetCase",
    "Study",
    "attempt",
    "bound_percent",
    "fig2",
    "fig8",
    "fig9",
    "fleet_case",
    "fleet_study",
    "fractions",
    "mass_error_study",
    "noise_study",
    "outcome",
    "svg",
    "table2",
    "table3",
    "table3_campaign",
]
