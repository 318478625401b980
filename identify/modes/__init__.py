"""Modes from free decays: the State Variable Method and its likelihood."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .modal_model import MODE_NAMES as MODE_NAMES
    from .modal_model import modes_of as modes_of
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
