"""Reproduces the paper's tables and figures."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .added_mass import fig2_study as fig2_study
    from .added_mass import mass_error_study as mass_error_study
    from .campaign import PAPER_MASS_STATES as PAPER_MASS_STATES
    from .campaign import Campaign as Campaign
    from .fig9 import fig9_study as fig9_study
    from .figures import svg as svg
    from .geometry_error import fig8_study as fig8_study
    from .noise import bound_percent as bound_percent
    from .noise import noise_study as noise_study
    from .noise import outcome as outcome
    from .result import Cell as Cell
    from .result import Column as Column
    from .result import Study as Study
    from .sensor_sets import SENSOR_SETS as SENSOR_SETS
    from .table2 import table2_study as table2_study
    from .table3 import attempt as attempt
    from .table3 import table3_campaign as table3_campaign
    from .table3 import table3_study as table3_study
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
