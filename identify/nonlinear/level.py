"""Step sizes of the integration, and rounding of the corners of the force laws."""

from __future__ import annotations

from typing import NamedTuple


class Level(NamedTuple):
    """Rounding of the force laws; a tuple of numbers, so that compiled code can take it."""

    knee_m_s: float
    """Rounding of the damper's knees, m/s."""
    turn_m_s: float
    """Rounding of the speed at which friction reverses, m/s."""
    lag_s: float
    """Lag of friction, s: bounds how fast it reverses at high speed."""
    loss_s: float
    """Loss of the damper's mount over its stiffness (t0), s."""
    stop_m: float
    """Rounding of the corner of the bump stop, m."""
    load_n: float
    """Rounding of the load at which a tyre meets the road, N: small compared with any static
    load."""


class Grade(NamedTuple):
    """Steps and rounding of path and tangents at one stage of a fit."""

    path: Level
    """Rounding of the path: the loss of the mount and the lag of the friction bound its step."""
    step_s: float
    """Step of the path, s."""
    tangent_steps: int
    """Number of path steps in one tangent step, between the events."""
    mounted_steps: int
    """The same number with a damper on a mount."""
    fine_steps: int
    """The same number where a wheel reverses or leaves the road, or a stop is touched; even,
    because the middle of a step must be a node of the path."""
    coarse: Level
    """Rounding of the tangents between the events."""
    fine: Level
    """Rounding of the tangents at the events."""
    filter_s: float
    """Spacing of the tangents, s, at the input of a sensor's low-pass."""


PATH = Level(0.0005, 0.01e-3, 0.02e-3, 0.12e-3, 0.05e-3, 20.0)
"""Rounding of the exact path: too small to be visible in the parameters.

A corner that sticks loses its friction as if it crept by the rounding of the turn: 0.2 mm/s moved
masses and springs of a car with solid axles by 1.5 standard deviations, and knees of 2 mm/s by
0.6."""

ROUGH = Grade(
    Level(0.004, 0.0005, 0.25e-3, 0.25e-3, 0.1e-3, 60.0), 2.5e-3 / 4, 4, 2, 2,
    Level(0.010, 0.003, 1.2e-3, 0.5e-3, 0.5e-3, 200.0),
    Level(0.005, 0.001, 0.5e-3, 0.5e-3, 0.2e-3, 100.0),
    2.5e-3,
)  # fmt: skip
"""Grade of the search: finds the optimum to a few standard deviations, at a third of the work."""
USUAL = Grade(
    PATH, 2.5e-3 / 8, 8, 4, 2,
    Level(0.010, 0.003, 1.2e-3, 0.5e-3, 0.5e-3, 200.0),
    Level(0.002, 0.0005, 0.02e-3, 0.25e-3, 0.1e-3, 60.0),
    2.5e-3,
)  # fmt: skip
"""Grade with an exact path, and tangents that are good enough for the steps of a fit."""
POLISH = Grade(
    PATH, 2.5e-3 / 10, 2, 2, 2,
    Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3, 60.0),
    Level(0.002, 0.0003, 0.1e-3, 0.2e-3, 0.1e-3, 60.0),
    1e-3,
)  # fmt: skip
"""Grade of the last steps of a fit, and of its covariance."""
