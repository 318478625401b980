"""Simulates the car over a bump: solves the plant in time, to be read at any instant.

Arrays have the layout of `plant`: axis 0 is the degree of freedom, axis 1 is time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from .balance import forces, static_pose
from .excitation import Bump, road_height, road_speed
from .linear import in_touch
from .plant import Array, Memory, Plant, blank_memory, side_by_side
from .stepping import State, Steps, step_all


class Tolerance(NamedTuple):
    """Tolerances of an integration step: relative, and absolute in m, rad and their rates."""

    relative: float
    absolute: float


SMOOTH = Tolerance(1e-10, 1e-12)
"""Tolerance of a ten-millionth of the finest sensor's resolution."""
KINKED = Tolerance(1e-7, 1e-9)
"""Tolerance for dampers with a kink at standstill, where each kink needs many short steps:
accelerations are accurate to 1e-4 m/s2 (measured), a hundredth of the quietest sensor's noise."""

Solution = Callable[[Array], Array]
"""State, (14, n): pose and velocity at times (n,)."""


@dataclass(frozen=True, slots=True)
class Kinematics:
    """The motion at chosen instants, each (7, n) in the order `daq.vehicle.DOF`."""

    pose: Array
    """Pose, counted from free springs (`plant`), m and rad."""
    velocity: Array
    """Rate of change of the pose."""
    acceleration: Array
    """Rate of change of the velocity, from the balance of forces."""


class Moving(Protocol):
    """Any motion of the car that can be sampled."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s; at rest before 0."""


class Motion(Moving, Protocol):
    """One run, solved: at rest, over the bump, free decay."""

    @property
    def plant(self) -> Plant:
        """The car that moves."""

    @property
    def bump(self) -> Bump:
        """The bump."""

    def states(self, t_s: Array) -> State:
        """Return the state at the times `t_s`, (n,) ascending, s."""


@dataclass(frozen=True, slots=True)
class SmoothMotion:
    """A run of a car without memory: in closed form while the car is linear, else integrated."""

    plant: Plant
    """The car that moves."""
    bump: Bump
    """The bump."""
    rest: Array
    """(7, 1) The pose before the bump."""
    on_bump: Solution
    """The state on the bump."""
    decay: Solution
    """The state after the bump."""

    def states(self, t_s: Array) -> State:
        """Return the state at the times `t_s`, (n,) ascending, s."""
        first, last = np.searchsorted(t_s, [self.bump.start_s, self.bump.end_s], side="right")
        state = np.zeros((14, len(t_s)))
        state[:7, :first] = self.rest
        for solution, part in ((self.on_bump, slice(first, last)), (self.decay, slice(last, None))):
            if len(t_s[part]):  # a dense output of SciPy does not accept an empty array
                state[:, part] = solution(t_s[part])
        return State(state[:7], state[7:], blank_memory(len(t_s)))

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s.

        Accelerations are those of the force balance, not differences of velocities.
        """
        state = self.states(t_s)
        road = road_height(self.bump, t_s), road_speed(self.bump, t_s)
        total = forces(self.plant, state.pose, state.velocity, *road)
        return Kinematics(state.pose, state.velocity, self.plant.accelerated(total))


@dataclass(frozen=True, slots=True)
class SteppedMotion:
    """A run of a car whose forces remember their past, interpolated between fine steps."""

    plant: Plant
    """The car that moves."""
    bump: Bump
    """The bump."""
    rest: State
    """State before the first step."""
    steps: Steps
    """The steps of this run and of those that were computed together with it."""
    column: int
    """Position of this run among them."""

    def states(self, t_s: Array) -> State:
        """Return the state at the times `t_s`, (n,) ascending, s."""
        kept, memory = self.steps, self.rest.memory
        return State(
            self._middle(kept.pose, self.rest.pose, t_s),
            self._ends(t_s),
            Memory(
                self._middle(kept.friction, memory.friction, t_s),
                self._middle(kept.mount_m, memory.mount_m, t_s),
            ),
        )

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s."""
        still = np.zeros((7, 1))
        return Kinematics(
            self._middle(self.steps.pose, self.rest.pose, t_s),
            self._ends(t_s),
            self._middle(self.steps.acceleration, still, t_s),
        )

    def _middle(self, values: Array, rest: Array, t_s: Array) -> Array:
        """Return values that are known in the middle of the steps, linearly interpolated."""
        return self._between(values, rest, t_s, 0.5)

    def _ends(self, t_s: Array) -> Array:
        return self._between(self.steps.velocity, self.rest.velocity, t_s, 0.0)

    def _between(self, values: Array, rest: Array, t_s: Array, first: float) -> Array:
        elapsed = (t_s - self.steps.begin_s) / self.steps.step_s
        place = np.clip(elapsed - first, 0.0, len(values) - 1)
        before = np.minimum(place.astype(np.int64), len(values) - 2)
        share = (place - before)[:, None]
        column_values = values[..., self.column]
        read = column_values[before] + share * (column_values[before + 1] - column_values[before])
        return np.asarray(np.where(elapsed < 0.0, rest, read.T), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class TwoBumps:
    """A car that meets a second bump before it has come to rest."""

    first: Motion
    """Motion up to the second bump."""
    second: Motion
    """Motion from the second bump, on the same axis of time."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s."""
        split = int(np.searchsorted(t_s, self.second.bump.start_s, side="right"))
        early, late = self.first.at(t_s[:split]), self.second.at(t_s[split:])
        return Kinematics(
            np.hstack([early.pose, late.pose]),
            np.hstack([early.velocity, late.velocity]),
            np.hstack([early.acceleration, late.acceleration]),
        )


def standing(plant: Plant, stuck: Array | None = None) -> State:
    """Return the state of a car at rest.

    `stuck`, (4, 1) float64: share of its friction that each corner carries; without it the car has
    settled without friction.  Raises ValueError if the car does not stand on four wheels
    (`static_pose`).
    """
    memory = blank_memory(1)
    if stuck is not None:
        memory = Memory(stuck, memory.mount_m)
    return State(static_pose(plant, memory), np.zeros((7, 1)), memory)


def drive(plant: Plant, bump: Bump, end_s: float, start: State | None = None) -> Motion:
    """Drive a car over a bump.

    `bump`: the road; it must begin at or after time 0.  `end_s`: end of the simulated free decay,
    s.  `start`: state at the beginning of the bump; without it the car is at rest.  Raises
    ValueError if the car does not stand on four wheels (`static_pose`).
    """
    return drive_all([plant], [bump], end_s, [start])[0]


def drive_all(
    plants: Sequence[Plant],
    bumps: Sequence[Bump],
    end_s: float,
    starts: Sequence[State | None] | None = None,
) -> list[Motion]:
    """Drive several cars over a bump each; arguments as for `drive`.

    Cars whose forces remember their past are computed together, which takes hardly longer than a
    single one.

    Raises ValueError as `drive`; and if cars with a memory have different elements
    (`plant.side_by_side`).
    """
    given = [None] * len(plants) if starts is None else starts
    if not any(plant.remembers for plant in plants):
        return [
            _solved(plant, bump, end_s, start)
            for plant, bump, start in zip(plants, bumps, given, strict=True)
        ]
    states = [start or standing(plant) for plant, start in zip(plants, given, strict=True)]
    together = State(
        np.hstack([state.pose for state in states]),
        np.hstack([state.velocity for state in states]),
        Memory(
            np.hstack([state.memory.friction for state in states]),
            np.hstack([state.memory.mount_m for state in states]),
        ),
    )
    steps = step_all(side_by_side(plants), bumps, end_s, together)
    each = enumerate(zip(plants, bumps, states, strict=True))
    return [SteppedMotion(plant, bump, state, steps, i) for i, (plant, bump, state) in each]


def _solved(plant: Plant, bump: Bump, end_s: float, start: State | None) -> SmoothMotion:
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
        if plant.smooth:
            known = in_touch(plant, bump, rest, start_s, stop_s, state)
            if known is not None:
                return known, known(np.array([stop_s]))[:, 0]

        from scipy.integrate import solve_ivp  # slow to import, and most runs need none

        def rate(t_s: float, state: Array) -> Array:
            motion = state.reshape(2, 7, 1)
            total = forces(plant, motion[0], motion[1], *road(t_s))
            return np.concatenate([state[7:], plant.accelerated(total)[:, 0]])

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

    # The road has corners where the bump begins and ends.  A step across a corner loses its order
    # of accuracy, and so does a step that ends at the corner but already uses the other side.
    state = standing(plant) if start is None else start
    from_then = np.concatenate([state.pose[:, 0], state.velocity[:, 0]])
    on_bump, off_bump = solve(bumpy, bump.start_s, bump.end_s, from_then)
    decay, _ = solve(level, bump.end_s, end_s, off_bump)
    return SmoothMotion(plant, bump, rest, on_bump, decay)
