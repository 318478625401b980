"""Reproduces the paper's tables and figures."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .campaign import PAPER_MASS_STATES as PAPER_MASS_STATES
    from .campaign import SENSOR_SETS as SENSOR_SETS
    from .campaign import Campaign as Campaign
    from .drawing import svg as svg
    from .low_pass import fig9_study as fig9_study
    from .noise import bound_percent as bound_percent
    from .noise import noise_study as noise_study
    from .noise import outcome as outcome
    from .paper_figures import fig2_study as fig2_study
    from .paper_figures import fig8_study as fig8_study
    from .paper_figures import mass_error_study as mass_error_study
    from .result import Cell as Cell
    from .result import Column as Column
    from .result import Study as Study
    from .tables import attempt as attempt
    from .tables import table2_study as table2_study
    from .tables import table3_campaign as table3_campaign
    from .tables import table3_study as table3_study
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
