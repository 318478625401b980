"""Replays recorded frames, on a bus or as a source."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .recorded_source import RecordedSource as RecordedSource
    from .recorded_source import whole_frames as whole_frames
    from .replay import play as play
    from .replay import recorded_frames as recorded_frames
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
