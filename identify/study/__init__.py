"""Reproduces the paper's tables and figures."""

from .campaign import PAPER_MASS_STATES, SENSOR_SETS, Campaign, bound_percent, noise_study, outcome
from .paper import (
    attempt,
    fig2_study,
    fig8_study,
    fig9_study,
    mass_error_study,
    table2_study,
    table3_campaign,
    table3_study,
)
from .result import Cell, Column, Study, svg

__all__ = [
    "PAPER_MASS_STATES",
    "SENSOR_SETS",
    "Campaign",
    "Cell",
    "Column",
    "Study",
    "attempt",
    "bound_percent",
    "fig2_study",
    "fig8_study",
    "fig9_study",
    "mass_error_study",
    "noise_study",
    "outcome",
    "svg",
    "table2_study",
    "table3_campaign",
    "table3_study",
]
