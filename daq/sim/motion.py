"""The simulated car over a bump: the plant integrated in time, to be read at any instant.

Arrays have the layout of `plant`: axis 0 is the degree of freedom, axis 1 is time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy.integrate import solve_ivp

from ..vehicle import Corner
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
    """The motion at chosen instants."""

    pose: Array
    velocity: Array
    acceleration: Array
    """In the order `daq.vehicle.DOF`, shape (7, n); the pose is counted from free springs
    (`plant`)."""


class Moving(Protocol):
    """Any motion of the car, as it can be sampled."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s; at rest before 0."""


@dataclass(frozen=True, slots=True)
class Motion:
    """One run, solved: at rest, over the bump, free decay."""

    plant: Plant
    bump: Bump
    """`plant`, `bump`: what moves and why."""
    rest: Array
    """The pose before the bump, shape (7, 1)."""
    on_bump: Solution
    decay: Solution
    """`on_bump`, `decay`: the state on the bump and after it."""

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


@dataclass(frozen=True, slots=True)
class TwoBumps:
    """A car that meets a second bump before it has come to rest."""

    first: Motion
    second: Motion
    """On the same axis of time; the second takes over when its bump begins."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s."""
        split = int(np.searchsorted(t_s, self.second.bump.start_s, side="right"))
        early, late = self.first.at(t_s[:split]), self.second.at(t_s[split:])
        return Kinematics(
            np.hstack([early.pose, late.pose]),
            np.hstack([early.velocity, late.velocity]),
            np.hstack([early.acceleration, late.acceleration]),
        )


@dataclass(frozen=True, slots=True)
class Push:
    """A hand that presses the body down, so slowly that every spring follows, and lets go again."""

    rest: Array
    """The pose before and after, shape (7, 1)."""
    sink: Array
    """What is added to it at the lowest point, shape (7, 1)."""
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


def drive(plant: Plant, bump: Bump, end_s: float, state: Array | None = None) -> Motion:
    """Drive a car over a bump.

    Parameters
    ----------
    plant : Plant
        The car.
    bump : Bump
        The road; it must begin at or after time 0.
    end_s : float
        Until when the free decay is followed, s.
    state : (14,) float64, optional
        Pose and velocity at the beginning of the bump; without it the car stands still.

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
    if state is None:
        state = np.concatenate([rest[:, 0], np.zeros(7)])
    on_bump, off_bump = solve(bumpy, bump.start_s, bump.end_s, state)
    decay, _ = solve(level, bump.end_s, end_s, off_bump)
    return Motion(plant, bump, rest, on_bump, decay)
