"""Wall-clock and monotonic time of one recorder cycle, read once at its start."""

from __future__ import annotations

import time
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Now:
    """The host's two clocks, read together."""

    wall_ns: int
    """UTC, ns since 1970; this clock may be set at any moment."""
    monotonic_s: float
    """Monotonic time, s, from an arbitrary origin; waiting and silence are measured with it."""


def read_clocks() -> Now:
    """Read the clocks of this host."""
    return Now(time.time_ns(), time.monotonic())
