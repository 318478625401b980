"""The time of a turn of the recorder, by both clocks of the host; read at the edge only."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Now:
    """The host's two clocks, read together."""

    wall_ns: int
    """Since 1970, ns.  It may be set at any moment."""
    monotonic_s: float
    """Since some moment, s.  All waiting and all silence is measured by it."""
