"""Messages of the app to the screen in front."""

from __future__ import annotations

from textual.message import Message

from daq import Status


class StatusArrived(Message):
    """A new status of the recorder."""

    def __init__(self, status: Status) -> None:
        self.status = status
        super().__init__()


class LiveArrived(Message):
    """New samples are in `app.lanes`."""


class RecorderLost(Message):
    """The recorder does not answer; `app.lost` says what to do."""
