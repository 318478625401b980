"""Stores of frames and events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dbc.frames import FrameBatch

from ..bus.source import HopLosses
from ..runs import Event


class FrameStore(Protocol):
    """A store of frames and events: a `JournalWriter`, or `Nowhere`."""

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Store a block of frames, and the losses counted up to it."""

    def append_events(self, events: Sequence[Event]) -> None:
        """Store events."""


class Nowhere:
    """A store that drops everything, for the time between two recordings."""

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Do nothing."""

    def append_events(self, events: Sequence[Event]) -> None:
        """Do nothing."""
