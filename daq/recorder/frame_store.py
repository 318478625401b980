"""Where a recorder puts what it is given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dbc.frames import FrameBatch

from ..bus.source import HopLosses
from ..runs import Event


class FrameStore(Protocol):
    """Keeps frames and events: a `Keeper`, or `Nowhere`."""

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Store a block of frames, and the losses counted up to it."""

    def append_events(self, events: Sequence[Event]) -> None:
        """Store events."""


class Nowhere:
    """Where frames go while nothing is recorded: they are looked at, and let go."""

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Do nothing."""

    def append_events(self, events: Sequence[Event]) -> None:
        """Do nothing."""
