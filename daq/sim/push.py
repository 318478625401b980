"""A hand on the car: a corner is pressed down and let go again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..vehicle import Corner
from .balance import forces, static_pose
from .motion import Kinematics
from .plant import Array, Plant


@dataclass(frozen=True, slots=True)
class Push:
    """A hand that presses the body down, so slowly that every spring follows, and lets go again."""

    rest: Array
    """(7, 1) The pose before and after."""
    sink: Array
    """(7, 1) What is added to it at the lowest point."""
    length_s: float
    """How long it takes, s."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s; at rest outside the push."""
        turn = 2 * np.pi / self.length_s
        phase = np.clip(t_s / self.length_s, 0.0, 1.0) * 2 * np.pi
        pushing = (phase > 0.0) & (phase < 2 * np.pi)
        return Kinematics(
            self.rest + self.sink * (1.0 - np.cos(phase)) / 2,
            self.sink * turn * np.sin(phase) / 2,
            self.sink * turn**2 * np.cos(phase) / 2 * pushing,
        )


def pushed(plant: Plant, corner: Corner, force_n: float, length_s: float) -> Push:
    """Press the body down at a corner with a force that rises and falls as a cosine."""
    rest, still, flat = static_pose(plant), np.zeros((7, 1)), np.zeros((4, 1))
    step = 1e-3 * np.eye(7)
    stiffness = -(forces(plant, rest + step, still, flat) - forces(plant, rest, still, flat)) / 1e-3
    i = corner.position
    load = np.zeros((7, 1))
    load[:3, 0] = [1.0, -plant.corner_x_m[i, 0], plant.corner_y_m[i, 0]]
    sink = np.asarray(np.linalg.solve(stiffness, -force_n * load), dtype=np.float64)
    return Push(rest, sink, length_s)
