"""Simulates a car that is released: off blocks under its wheels, or after a push by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..bumps import BUMPS
from ..runs import Excitation
from .balance import forces, static_pose
from .excitation import Bump
from .motion import Kinematics, Moving, drive, standing
from .plant import Array, Plant
from .stepping import State

PRESS_S = 0.5
"""Time that hands take to push the body down, s."""
_HELD_S = 0.1
"""Time for which they hold it there, s."""
PUSHED_S = PRESS_S + _HELD_S
"""Time from the beginning of a push until the release, s."""


@dataclass(frozen=True, slots=True)
class Release:
    """A car that is moved from its rest, held, and released."""

    rest: Array
    """(7, 1) Pose before the push; with blocks, the pose in which it is held."""
    held: Array
    """(7, 1) Pose in which it is released."""
    start_s: float
    """Time at which the push begins, s; the blocks are there from the beginning."""
    go_s: float
    """Time of the release, s."""
    decay: Moving
    """The motion after the release."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s."""
        split = int(np.searchsorted(t_s, self.go_s, side="right"))
        phase = np.clip((t_s[:split] - self.start_s) / PRESS_S, 0.0, 1.0)
        going = (phase > 0.0) & (phase < 1.0)
        way, turn = self.held - self.rest, np.pi / PRESS_S
        after = self.decay.at(t_s[split:])
        return Kinematics(
            np.hstack([self.rest + way * (1.0 - np.cos(np.pi * phase)) / 2.0, after.pose]),
            np.hstack([way * turn * np.sin(np.pi * phase) / 2.0 * going, after.velocity]),
            np.hstack([way * turn**2 * np.cos(np.pi * phase) / 2.0 * going, after.acceleration]),
        )


def dropped(
    plant: Plant, excitation: Excitation, height_m: float, go_s: float, end_s: float
) -> Release:
    """Drop a car off blocks of a given height under the wheels that the bump lifts."""
    road = height_m * np.array(BUMPS[excitation].shares)[:, None]
    held = _balanced(plant, road, np.zeros((7, 1)))
    return _released(plant, held, held, go_s, go_s, end_s)


def pushed_down(
    plant: Plant, excitation: Excitation, depth_m: float, start_s: float, end_s: float
) -> Release:
    """Push the body of a car down at the place for the bump, hold it, and release it.

    Raises ValueError if a push cannot make that bump.
    """
    hand = BUMPS[excitation].hand
    if hand is None:
        raise ValueError(f"a push cannot make a {excitation.words} bump")
    ahead = hand[0] * (plant.corner_x_m[0, 0] if hand[0] > 0 else -plant.corner_x_m[2, 0])
    left = hand[1] * float(np.mean(np.abs(plant.corner_y_m)))
    load = np.zeros((7, 1))
    load[:3, 0] = [1.0, -ahead, left]
    rest = static_pose(plant)
    sink = _balanced(plant, np.zeros((4, 1)), -load) - rest
    at_the_hand = abs(float(sink[0, 0] - sink[1, 0] * ahead + sink[2, 0] * left))
    held = rest + sink * depth_m / at_the_hand
    return _released(plant, rest, held, start_s, start_s + PUSHED_S, end_s)


def _released(
    plant: Plant, rest: Array, held: Array, start_s: float, go_s: float, end_s: float
) -> Release:
    state = State(held, np.zeros((7, 1)), standing(plant).memory)
    decay = drive(plant, Bump(Excitation.BOUNCE, 0.0, go_s, 0.01), end_s, state)
    return Release(rest, held, start_s, go_s, decay)


def _balanced(plant: Plant, road: Array, load: Array) -> Array:
    """Return the pose in which springs and tyres carry the car and a load, (7, 1)."""
    pose, still = static_pose(plant), np.zeros((7, 1))
    step = -1e-3 * np.eye(7)
    for _ in range(5):
        balance = forces(plant, pose, still, road) + load
        slope = (forces(plant, pose + step, still, road) + load - balance) / -1e-3
        pose = pose - np.linalg.solve(slope, balance)
    return np.asarray(pose, dtype=np.float64)
