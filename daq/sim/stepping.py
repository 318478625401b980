"""Integrates several runs together in fine time steps, for cars whose forces remember their past.

Friction and mounts are not smooth, and a solver that searches for every kink takes minutes for a
campaign.  Here all runs are computed together, one column each, in steps a hundred times finer than
the fastest motion.  Deflections (pose, friction, mounts) are known in the middle of each step and
velocities at its ends, so every step needs the forces once, and the error falls with the square of
the step.  Friction and mounts are solved exactly for the speed within the step, so that neither a
short pre-sliding length nor a stiff mount limits it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .balance import forces
from .excitation import Bump, road_height, road_speed
from .plant import Array, Memory, Plant, corner_motion

STEP_S = 1e-4
"""Time step, s: a wheel at 15 Hz moves by a hundredth of its cycle in ten steps."""


@dataclass(frozen=True, slots=True)
class State:
    """The state of the car at one or several instants."""

    pose: Array
    """(7, n) Pose, from the free length of all springs."""
    velocity: Array
    """(7, n) Rate of change of the pose."""
    memory: Memory
    """State of friction and mounts; zero for corners without."""


@dataclass(frozen=True, slots=True)
class Steps:
    """The runs, step by step; axis 0 is time, the last axis the run."""

    begin_s: float
    """Time at which the first step begins, s."""
    step_s: float
    """Length of a step, s."""
    pose: Array
    """(m, 7, n) Pose in the middle of each step."""
    acceleration: Array
    """(m, 7, n) Acceleration in the middle of each step, from the balance of forces."""
    velocity: Array
    """(m + 1, 7, n) Velocity at the ends of the steps."""
    friction: Array
    """(m, 4, n) Share of sliding friction, in the middle of each step."""
    mount_m: Array
    """(m, 4, n) Deflection of the mounts in the middle of each step, m."""


@dataclass(slots=True)
class _Yielding:
    """The yielding mounts of the dampers."""

    plant: Plant
    stiffness_n_m: Array
    deflection_m: Array
    damper_m_s: Array
    """Speed in the damper, which is not that of the corner."""

    def advance(self, closing: Array, change: Array, time_s: float) -> None:
        """Advance the mounts while the corners close.

        The mount yields by the motion that the damper does not follow.  With the damper linearised
        at its speed this is an exponential approach, solved exactly.

        `closing`, (4, n) float64: speed of the corners at half time, m/s.  `change`, (4, n)
        float64: change of that speed, m/s.  `time_s`: duration, s.
        """
        held, damper = self.stiffness_n_m * self.deflection_m, self.plant.damper
        for _ in range(2):  # Newton: the speed at which damper and mount have the same force
            slope = damper.slope(self.damper_m_s)
            self.damper_m_s = self.damper_m_s + (held - damper.force(self.damper_m_s)) / slope
        rate = self.stiffness_n_m / slope
        share_s = -np.expm1(-rate * time_s) / rate
        lead = closing - 0.5 * change - self.damper_m_s
        followed = change * (1.0 - share_s / time_s) / rate
        self.deflection_m = self.deflection_m + share_s * lead + followed


def _yielding(plant: Plant, deflection_m: Array) -> _Yielding | None:
    if plant.mounts is None:
        return None
    # Without a mount any stiffness is valid, because its deflection is not used.
    stiffness = np.where(plant.mounts.elastic, plant.mounts.stiffness_n_m, 1.0)
    return _Yielding(plant, stiffness, deflection_m, np.zeros(deflection_m.shape))


def step_all(
    plant: Plant, bumps: Sequence[Bump], end_s: float, start: State, step_s: float = STEP_S
) -> Steps:
    """Drive the cars of a plant over their bumps.

    `plant`: one column for each run (`plant.side_by_side`).  `end_s`: end of the simulated decays,
    s.  `start`: state of each run at the beginning of the first bump, with its memory.  `step_s`:
    length of a step, s.
    """
    begin_s = min(bump.start_s for bump in bumps)
    m = int(np.ceil((end_s - begin_s) / step_s)) + 1
    middle_s = begin_s + step_s * (np.arange(m, dtype=np.float64) + 0.5)
    bumpy = int(np.searchsorted(middle_s, max(bump.end_s for bump in bumps)))
    road = np.stack([road_height(bump, middle_s[:bumpy]) for bump in bumps], axis=-1)
    rising = np.stack([road_speed(bump, middle_s[:bumpy]) for bump in bumps], axis=-1)
    flat = np.zeros((4, len(bumps)))
    pose, velocity = start.pose + 0.5 * step_s * start.velocity, start.velocity
    share, mount = start.memory.friction, start.memory.mount_m
    yielding = _yielding(plant, mount)
    before = velocity
    closing = velocity[3:] - corner_motion(plant, velocity)
    poses, accelerations = np.empty((2, m, *pose.shape))
    velocities = np.empty((m + 1, *pose.shape))
    shares, deflections = np.empty((2, m, *flat.shape))
    velocities[0] = velocity
    for k in range(m):
        memory = Memory(share, mount)
        under = (road[:, k], rising[:, k]) if k < bumpy else (flat, flat)
        # Half a step ahead, to second order, from the velocity change in the previous step.
        halfway = 1.5 * velocity - 0.5 * before
        acceleration = plant.accelerated(forces(plant, pose, halfway, *under, memory))
        poses[k], accelerations[k] = pose, acceleration
        shares[k], deflections[k] = share, mount
        before, velocity = velocity, velocity + step_s * acceleration
        velocities[k + 1] = velocity
        pose = pose + step_s * velocity
        corners_before, closing = closing, velocity[3:] - corner_motion(plant, velocity)
        share = plant.friction.slid(share, closing, step_s)
        if yielding is not None:
            change = closing - corners_before
            yielding.advance(closing, change, step_s)
            mount = yielding.deflection_m
    return Steps(begin_s, step_s, poses, accelerations, velocities, shares, deflections)
