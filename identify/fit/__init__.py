"""Maximum likelihood on the free decays."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .estimation import Estimation as Estimation
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
