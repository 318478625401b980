"""How finely a motion is integrated and corners of the force laws are rounded."""

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
    load_n: float
    """Of the load at which a tyre meets the road: small beside any static load."""


class Grade(NamedTuple):
    """Steps and rounding of path and tangents at one stage of a fit."""

    path: Level
    """Of the path: the loss of the mount and the lag of the friction bound its step."""
    step_s: float
    """Of the path, s."""
    tangent_steps: int
    """Steps of the path in one of the tangents, between the events."""
    mounted_steps: int
    """The same with a damper on a mount."""
    fine_steps: int
    """The same where a wheel turns or leaves the road, or a stop is touched; even, because the
    middle of a step must be a node of the path."""
    coarse: Level
    """Of the tangents between the events."""
    fine: Level
    """Of the tangents at the events."""
    filter_s: float
    """Spacing of the tangents, s, at the input of a sensor's low-pass."""


PATH = Level(0.002, 0.0002, 0.02e-3, 0.12e-3, 0.05e-3, 20.0)
"""Unsmoothed to the eye."""

ROUGH = Grade(
    Level(0.004, 0.0005, 0.25e-3, 0.25e-3, 0.1e-3, 60.0), 2.5e-3 / 4, 4, 2, 2,
    Level(0.010, 0.003, 1.2e-3, 0.5e-3, 0.5e-3, 200.0),
    Level(0.005, 0.001, 0.5e-3, 0.5e-3, 0.2e-3, 100.0),
    2.5e-3,
)  # fmt: skip
"""For the search: an optimum within a few standard deviations, at a third of the work."""
USUAL = Grade(
    PATH, 2.5e-3 / 8, 8, 4, 2,
    Level(0.010, 0.003, 1.2e-3, 0.5e-3, 0.5e-3, 200.0),
    Level(0.002, 0.0005, 0.02e-3, 0.25e-3, 0.1e-3, 60.0),
    2.5e-3,
)  # fmt: skip
"""An exact path with tangents that are good enough to walk by."""
POLISH = Grade(
    PATH, 2.5e-3 / 10, 2, 2, 2,
    Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3, 60.0),
    Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3, 60.0),
    1e-3,
)  # fmt: skip
"""The last steps of a fit, and its covariance."""
