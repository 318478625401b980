"""Defines the origin of the frames of a recording."""

from __future__ import annotations

from enum import StrEnum


class Origin(StrEnum):
    """Marks data as a measurement or a demonstration wherever they are shown or stored."""

    REAL = "real"
    """A bus; nothing more is known."""
    SIMULATED = "simulated"
    """The simulated car, within the recorder's own process."""
    REPLAYED = "replayed"
    """An earlier recording, played to a recorder."""
