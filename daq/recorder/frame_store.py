"""Defines the interface of a store of frames and events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dbc.frames import FrameBatch

from ..bus.source import HopLosses
from ..runs import Event


class FrameStore(Protocol):
    """A store of frames and events: a `JournalWriter`."""

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Store a block of frames, and the losses counted up to it."""

    def append_events(self, events: Sequence[Event]) -> None:
        """Store events."""
