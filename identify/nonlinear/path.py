"""The path of one run: all states over time, and their values at the samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .car import KNEES, LENGTH, MOUNT, RATIO, C, Car, X, Y
from .laws import knee, knee_slope

# Step sizes of the integration, and rounding of the corners of the force laws ---------------------


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


# The path -----------------------------------------------------------------------------------------

STATES = 22
"""Seven displacements, their speeds, and at each corner the share of friction and the mount."""
_SHORT_M = 0.15e-3
"""Pre-sliding length, m, below which the friction needs half the step."""
_FAST_M_S = 1.0
"""Speed of a suspension, m/s, that this assumes: with a lag above the quotient of both, the whole
step is enough."""


@dataclass(frozen=True, slots=True)
class InitialState:
    """State of one run as the free decay begins."""

    motion: NDArray[np.float64]
    """(14,) displacements and speeds of `daq.vehicle.DOF`, from the position of the bare car at
    rest."""
    friction: NDArray[np.float64]
    """(4,) share of the friction that acts at each corner, -1..1."""
    mount: NDArray[np.float64]
    """(4,) deflection of each damper's mount beyond that of its force, m."""

    def moved(self, step: NDArray[np.float64]) -> InitialState:
        """Return the state after a step, (18,) or with mounts (22,)."""
        mount = self.mount + step[18:] if len(step) > 18 else self.mount
        friction = np.clip(self.friction + step[14:18], -1.0, 1.0)
        return InitialState(self.motion + step[:14], friction, mount)


@dataclass(frozen=True, slots=True)
class Path:
    """All states at evenly spaced nodes, or at given times."""

    step_s: float
    """Of the nodes; 0 for given times."""
    level: Level
    """Rounding of the laws."""
    states: NDArray[np.float64]
    """(n, 22)."""
    slopes: NDArray[np.float64]
    """(n, 22), their rates of change."""
    speeds: NDArray[np.float64]
    """(n, 4), of the dampers, m/s."""

    @property
    def end_s(self) -> float:
        """Time of the last node, s."""
        return (len(self.states) - 1) * self.step_s

    def motion(self, derivative: int) -> NDArray[np.float64]:
        """Return displacement, speed or acceleration of the degrees of freedom, (n, 7)."""
        return self.slopes[:, 7:14] if derivative == 2 else self.states[:, 7 * derivative :][:, :7]


def travel_speeds(car: Car, motion: NDArray[np.float64], first: int = 7) -> NDArray[np.float64]:
    """Return the speeds of the four suspensions, (..., 4) m/s, compression positive.

    With `first` 0 instead of 7, their travels.
    """
    body = (
        motion[..., first : first + 1]
        - motion[..., first + 1 : first + 2] * car.corner[:, X]
        + motion[..., first + 2 : first + 3] * car.corner[:, Y]
    )
    return np.asarray(motion[..., first + 3 : first + 7] - body)


def damper_curve(
    car: Car, speed: NDArray[np.float64], width: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return force and slope of the axle's curve at the four dampers' speeds, (..., 4) each."""
    force, slope = car.corner[:, C] * speed, car.corner[:, C] + 0.0 * speed
    for j, at in enumerate(car.knots):
        h = car.corner[:, KNEES + j]
        force, slope = force + h * knee(speed, at, width), slope + h * knee_slope(speed, at, width)
    return force, slope


def first_state(
    car: Car, own: InitialState, level: Level
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the state at the start, (22,), and the speeds of the dampers, (4,)."""
    speed = travel_speeds(car, own.motion)
    force, _ = damper_curve(car, speed, level.knee_m_s)
    mount = car.corner[:, MOUNT] * car.corner[:, RATIO] * force + own.mount
    return np.concatenate([own.motion, own.friction, mount]), speed


def step_of(cars: list[Car], grade: Grade) -> float:
    """Return the step that the shortest pre-sliding length allows, s."""
    shortest = min(float(car.corner[:, LENGTH].min()) for car in cars)
    short = shortest < _SHORT_M and grade.path.lag_s < _SHORT_M / _FAST_M_S
    return grade.step_s / 2.0 if short else grade.step_s


def hermite(share: NDArray[np.float64], step_s: float) -> tuple[NDArray[np.float64], ...]:
    """Return the weights of cubic Hermite: value before, value after, slope before, slope after.

    `share` is the position in the step, 0..1, (n,).
    """
    s = share
    before = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
    after = s * s * (3.0 - 2.0 * s)
    return before, after, s * (1.0 - s) * (1.0 - s) * step_s, -s * s * (1.0 - s) * step_s
