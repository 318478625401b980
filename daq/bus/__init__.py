"""Reads frames from any interface in blocks, and sends frames."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .interfaces import open_bus as open_bus
    from .interfaces import open_buses as open_buses
    from .source import FrameSource as FrameSource
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
