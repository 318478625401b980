"""Where the frames of a recording come from."""

from __future__ import annotations

from enum import StrEnum


class Origin(StrEnum):
    """Marks a measurement or a demonstration wherever it is shown or stored."""

    REAL = "real"
    """A bus, of which nothing else is known."""
    SIMULATED = "simulated"
    """The simulated car, within the recorder's own process."""
    REPLAYED = "replayed"
    """An earlier recording, played to a recorder."""
