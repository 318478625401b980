"""Writes and reads the journal: every frame is on the disk before it is processed further."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .contents import RecordingInfo as RecordingInfo
    from .folder import last_campaign as last_campaign
    from .folder import read_head as read_head
    from .folder import recordings_of as recordings_of
    from .folder import segments_in as segments_in
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
