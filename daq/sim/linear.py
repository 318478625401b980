"""Moves a linear car in closed form, as long as all its tyres push on the road.

Such a car is a linear system, and a half sine turns at a constant rate: state and road together
follow ``z' = M z``, whose solution is a sum of exponentials.  Arrays have the layout of `plant`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .balance import forces
from .excitation import Bump, road_height, road_speed
from .plant import Array, Plant

_RATE_1_S = 60.0
"""Rate that makes a velocity comparable with a displacement: between body and wheel."""
_REACH = 0.1
"""Change of pose and velocity for the slopes of the forces, m and m/s; the car is linear there."""
_LOOK_S = 5e-4
"""Interval at which the tyres are looked at, s: a fiftieth of the fastest motion of a wheel."""
_MOST_CONDITION = 1e6
"""Condition of the mode shapes above which modes are too alike to be separated."""

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Exponentials:
    """The state of a car as a sum of exponentials of time."""

    start_s: float
    """Time at which the sum starts, s."""
    rest: Array
    """(14, 1) Pose and velocity at rest."""
    rates_1_s: Complex
    """(m,) Rate of each exponential, 1/s."""
    shapes: Complex
    """(14, m) Part of each exponential in the state."""

    def __call__(self, t_s: Array) -> Array:
        """Return pose and velocity at the times `t_s`, (14, n)."""
        grown = np.exp(self.rates_1_s[:, None] * (t_s - self.start_s))
        return np.asarray(self.rest + (self.shapes @ grown).real, dtype=np.float64)


def in_touch(
    plant: Plant, bump: Bump, rest: Array, start_s: float, stop_s: float, state: Array
) -> Exponentials | None:
    """Return the motion from one time to another, if all tyres push on the road all the while.

    `plant`: a car whose forces are linear while its tyres push (`Plant.smooth`).  `bump`: the road;
    the times lie either on it or behind it.  `rest`, (7, 1) float64: the pose at rest.  `state`,
    (14,) float64: pose and velocity at `start_s`.  Returns None if a tyre is not pushing at some
    time, or two modes are so much alike that their sum would lose digits.
    """
    if stop_s <= start_s:
        return None
    on_bump = start_s < bump.end_s
    rates, shapes = np.linalg.eig(_system(plant, bump, on_bump))
    if np.linalg.cond(shapes) > _MOST_CONDITION:
        return None
    level = np.concatenate([rest[:, 0], np.zeros(7)])
    phase = np.pi * (start_s - bump.start_s) / bump.duration_s
    road = [np.sin(phase), np.cos(phase)] if on_bump else []
    scale = np.repeat([1.0, _RATE_1_S], 7)
    first = np.concatenate([(state - level) / scale, road])
    parts = scale[:, None] * shapes[:14] * np.linalg.solve(shapes, first)
    found = Exponentials(start_s, level[:, None], rates, parts)
    return found if _pushing(plant, bump, found, stop_s) else None


def _system(plant: Plant, bump: Bump, on_bump: bool) -> Array:
    """Return the matrix of ``z' = M z``: pose from rest, velocity by `_RATE_1_S`, sine and cosine.

    Without a bump the two last ones are left out.
    """
    # Deep enough for every tyre to push with any of the changes.
    deep, none, still = np.full((7, 1), -1.0), np.zeros((7, 7)), np.zeros((7, 1))
    deep[1:3] = 0.0
    flat, reach = np.zeros((4, 1)), _REACH * np.eye(7)
    base = forces(plant, deep, still, flat)

    def slopes(total: Array) -> Array:
        return plant.accelerated(total - base) / _REACH

    stiff = slopes(forces(plant, deep + reach, none, flat))
    damped = slopes(forces(plant, deep + none, reach, flat))
    size = 16 if on_bump else 14
    system = np.zeros((size, size))
    system[:7, 7:14] = _RATE_1_S * np.eye(7)
    system[7:14, :7] = stiff / _RATE_1_S
    system[7:14, 7:14] = damped
    if on_bump:
        turn = np.pi / bump.duration_s
        share = bump.crest_m * _REACH
        lifted = slopes(forces(plant, deep, still, share))
        rising = slopes(forces(plant, deep, still, flat, share * turn))
        system[7:14, 14:] = np.hstack([lifted, rising]) / _RATE_1_S
        system[14, 15], system[15, 14] = turn, -turn
    return system


def _pushing(plant: Plant, bump: Bump, motion: Exponentials, stop_s: float) -> bool:
    """Return True if no tyre comes to the end of its push, in between the looks either."""
    count = max(3, int(np.ceil((stop_s - motion.start_s) / _LOOK_S)) + 1)
    t_s = np.linspace(motion.start_s, stop_s, count)
    state = motion(t_s)
    speed = road_speed(bump, t_s) if motion.start_s < bump.end_s else 0.0
    height = road_height(bump, t_s)
    spring = plant.tyre_n_m * (height - state[3:7])
    total = spring + plant.tyre_damping_ns_m * (speed - state[10:14])
    # A curve leaves its chord by an eighth of the second difference at most; twice that is allowed.
    return all(
        bool((force.min(axis=1) > np.abs(np.diff(force, 2)).max(axis=1) / 4.0).all())
        for force in (spring, total)
    )
