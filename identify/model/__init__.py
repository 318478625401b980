"""The vehicle as matrices, sensors and facts."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .matrices import SYMMETRIC as SYMMETRIC
    from .matrices import loaded_model as loaded_model
    from .response import Bump as Bump
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
