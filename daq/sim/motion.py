"""The simulated car over a bump: the plant integrated in time, to be read at any instant.

Arrays have the layout of `plant`: axis 0 is the degree of freedom, axis 1 is time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from .excitation import Bump, road_height, road_speed
from .plant import Array, Plant, forces, static_pose


class Tolerance(NamedTuple):
    """Of one step of the integration: share of the state, and in m, rad and their rates."""

    relative: float
    absolute: float


SMOOTH = Tolerance(1e-10, 1e-12)
"""A ten-millionth of the finest sensor's resolution."""
KINKED = Tolerance(1e-7, 1e-9)
"""For dampers and friction that turn round at standstill, where each kink costs many short steps:
accelerations stay true to 1e-4 m/s2 (measured), a hundredth of the quietest sensor's noise."""

Solution = Callable[[Array], Array]
"""State, (14, n): pose and velocity at times (n,)."""


@dataclass(frozen=True, slots=True)
class Kinematics:
    """The motion at chosen instants.

    Parameters
    ----------
    pose, velocity, acceleration : (7, n) float64
        In the order `daq.vehicle.DOF`; the pose is counted from free springs (`plant`).
    """

    pose: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, slots=True)
class Motion:
    """One run, solved: at rest, over the bump, free decay.

    Parameters
    ----------
    plant, bump : Plant, Bump
        What moves and why.
    rest : (7, 1) float64
        The pose before the bump.
    on_bump, decay : callable
        The state on the bump and after it.
    """

    plant: Plant
    bump: Bump
    rest: Array
    on_bump: Solution
    decay: Solution

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s.

        Accelerations are those of the force balance, not differences of velocities.
        """
        first, last = np.searchsorted(t_s, [self.bump.start_s, self.bump.end_s], side="right")
        state = np.zeros((14, len(t_s)))
        state[:7, :first] = self.rest
        for solution, part in (
            (self.on_bump, slice(first, last)),
            (self.decay, slice(last, None)),
        ):
            if len(t_s[part]):  # a dense output of scipy takes no empty array
                state[:, part] = solution(t_s[part])
        pose, velocity = state[:7], state[7:]
        road = road_height(self.bump, t_s), road_speed(self.bump, t_s)
        total = forces(self.plant, pose, velocity, *road)
        return Kinematics(pose, velocity, self.plant.mobility @ total)


def drive(plant: Plant, bump: Bump, end_s: float) -> Motion:
    """Drive a car that stands still over a bump.

    Parameters
    ----------
    plant : Plant
        The car.
    bump : Bump
        The road; it must begin at or after time 0.
    end_s : float
        Until when the free decay is followed, s.

    Raises
    ------
    ValueError
        If the car does not stand on four wheels (`static_pose`).
    """
    rest, still = static_pose(plant), np.zeros((4, 1))
    tolerance = SMOOTH if plant.smooth else KINKED

    def bumpy(t_s: float) -> tuple[Array, Array]:
        now = np.array([t_s])
        return road_height(bump, now), road_speed(bump, now)

    def level(t_s: float) -> tuple[Array, Array]:
        return road_height(bump, np.array([t_s])), still

    def solve(
        road: Callable[[float], tuple[Array, Array]], start_s: float, stop_s: float, state: Array
    ) -> tuple[Solution, Array]:
        def rate(t_s: float, state: Array) -> Array:
            motion = state.reshape(2, 7, 1)
            total = forces(plant, motion[0], motion[1], *road(t_s))
            return np.concatenate([state[7:], (plant.mobility @ total)[:, 0]])

        solution = solve_ivp(
            rate,
            (start_s, stop_s),
            state,
            method="DOP853",
            dense_output=True,
            rtol=tolerance.relative,
            atol=tolerance.absolute,
        )
        return solution.sol, solution.y[:, -1]

    # The road has corners where the bump begins and ends; a step across one loses its order, and so
    # does one that ends at it and already feels the other side.
    at_rest = np.concatenate([rest[:, 0], np.zeros(7)])
    on_bump, off_bump = solve(bumpy, bump.start_s, bump.end_s, at_rest)
    decay, _ = solve(level, bump.end_s, end_s, off_bump)
    return Motion(plant, bump, rest, on_bump, decay)
