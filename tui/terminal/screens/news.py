"""What the app tells the active screen."""

from __future__ import annotations

from textual.message import Message

from daq.control.messages import Status


class StatusArrived(Message):
    """The recorder told where it stands."""

    def __init__(self, status: Status) -> None:
        self.status = status
        super().__init__()


class LiveArrived(Message):
    """New samples are in `app.lanes`."""


class RecorderLost(Message):
    """The recorder does not answer; `app.lost` says what to do."""
