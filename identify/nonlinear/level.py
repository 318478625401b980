"""How finely corners of the force laws are rounded: hardly on the path, more in the tangents."""

from __future__ import annotations

from typing import NamedTuple


class Level(NamedTuple):
    """Rounding of the laws; a tuple of numbers, so that compiled code takes it as it is."""

    knee_m_s: float
    """Of the damper's knees."""
    turn_m_s: float
    """Of the speed at which friction turns."""
    lag_s: float
    """Of friction: bounds how fast it turns at high speed."""
    loss_s: float
    """Loss of the damper's mount over its stiffness (t0)."""
    stop_m: float
    """Of the corner of the bump stop."""


PATH = Level(0.002, 0.0002, 0.02e-3, 0.12e-3, 0.05e-3)
"""The path: unsmoothed to the eye; the loss of the mount bounds the step to 0.31 ms."""
COARSE = Level(0.010, 0.003, 1.2e-3, 0.5e-3, 0.5e-3)
"""Tangents between the events."""
FINE = Level(0.002, 0.0005, 0.02e-3, 0.25e-3, 0.1e-3)
"""Tangents where a wheel turns or leaves the road, or a stop is touched."""
POLISH = Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3)
"""Tangents of the last steps of a fit."""
