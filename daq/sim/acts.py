"""Computes the acts of the simulated bench: rest, due bumps, spoilt bumps, pushes on a corner."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from ..bench.campaign import Step
from ..bench.config import Bench
from ..bench.procedure import Method
from ..bumps import BUMPS
from ..channels import Channel
from ..runs import Excitation
from ..samples.trigger import trigger_channels
from ..vehicle import Corner
from .balance import forces, static_pose
from .ecu import Rig, Scene, scene_of
from .excitation import Bump
from .masses import GRAVITY_M_S2
from .motion import Kinematics, Motion, Moving, TwoBumps, drive
from .plant import Array, Plant
from .release import PUSHED_S, dropped, pushed_down
from .sensors import true_reading
from .spoils import SECOND_BUMP_S, WEAK_LEVELS, Fault, mixed_up

LEAD_S = 0.1
"""Rest at the beginning of an act, s, longer than the delay of any sensor."""
SWING_S = 6.0
"""Time, s, after which the motion of a car with a damping of 0.15 at 1 Hz has decayed to 1/300."""
PUSH_N, PUSH_S = 400.0, 1.2
"""Force and duration of a push by a person on a corner, who lets go gently."""
_MARGIN_S = 0.2
"""Margin at the end of an act, s, because an act ends with the piece that is being sampled."""
_SEEN_S = 1e-3


@dataclass(frozen=True, slots=True)
class Act:
    """One motion of the car with its duration."""

    scene: Scene
    """Its motion, beginning at 0."""
    length_s: float
    """Time after which the car is at rest, s."""
    bump_s: float
    """Time of the bump, s."""
    limits: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Limits of sensors that saturate, SI."""


class Acts:
    """The acts of one bench; each is computed once, in a separate thread, before it is due."""

    def __init__(self, bench: Bench, rig: Rig) -> None:
        self._bench = bench
        self._rig = rig
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="simulated car")
        self._known: dict[tuple[str, Excitation, Fault | None], Future[Act]] = {}

    def close(self) -> None:
        """Cancel the computations that have not begun."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def rest(self, mass_state: str) -> Act:
        """Return the act of a car that remains at rest."""
        pose = static_pose(self._rig.plants[mass_state])
        return Act(scene_of(self._rig, Push(pose, np.zeros((7, 1)), 1.0), 0.0, 0.0), np.inf, np.inf)

    def push(self, mass_state: str, corner: Corner) -> Act:
        """Return a push on a corner."""
        push = pushed(self._rig.plants[mass_state], corner, PUSH_N, PUSH_S)
        return Act(scene_of(self._rig, push, 0.0, PUSH_S), PUSH_S, np.inf)

    def prepare(self, step: Step, fault: Fault | None) -> Future[Act]:
        """Begin to compute a bump, if this has not been done, and return its future."""
        kind = (step.mass_state, step.excitation, fault)
        if kind not in self._known:
            self._known[kind] = self._pool.submit(self._made, *kind)
        return self._known[kind]

    def _made(self, mass_state: str, excitation: Excitation, fault: Fault | None) -> Act:
        if fault is Fault.WRONG_MODE:
            excitation = mixed_up(excitation)
        if fault is Fault.DOUBLE_BUMP:
            return self._twice(mass_state, excitation)
        act = self._bump(mass_state, excitation, 1.0)
        if fault is Fault.WEAK:
            height = WEAK_LEVELS * self._bench.trigger.level / self._peak(act)
            return self._bump(mass_state, excitation, height)
        if fault is Fault.OVERLOAD:
            return replace(act, limits=self._low_limit(act))
        if fault is Fault.FROZEN:
            name = [c.name for c in self._bench.channels if c.corner is not None][-1]
            return replace(act, limits={name: 0.0})
        return act

    def _bump(self, mass_state: str, excitation: Excitation, height: float) -> Act:
        plant, height_m = self._rig.plants[mass_state], height * self._bench.procedure.bump_height_m
        method = self._bench.procedure.method
        if method is Method.ROLL_OVER:
            return self._act(self._driven(mass_state, excitation, height), LEAD_S + SWING_S)
        if method is Method.PUSH and BUMPS[excitation].hand is not None:
            end_s = LEAD_S + PUSHED_S + SWING_S
            push = pushed_down(plant, excitation, height_m, LEAD_S, end_s + _MARGIN_S)
            return self._act(push, end_s)
        lead_s = LEAD_S + self._bench.trigger.pre_s  # it is on the blocks before they are removed
        end_s = lead_s + SWING_S
        drop = dropped(plant, excitation, height_m, lead_s, end_s + _MARGIN_S)
        return self._act(drop, end_s, lead_s)

    def _driven(self, mass_state: str, excitation: Excitation, height: float) -> Motion:
        height_m = height * self._bench.procedure.bump_height_m
        bump = Bump(excitation, height_m, LEAD_S, self._bench.bump_s)
        return drive(self._rig.plants[mass_state], bump, LEAD_S + SWING_S + _MARGIN_S)

    def _twice(self, mass_state: str, excitation: Excitation) -> Act:
        first = self._driven(mass_state, excitation, 1.0)
        again = replace(first.bump, start_s=first.bump.start_s + SECOND_BUMP_S)
        then = first.states(np.array([again.start_s]))
        length_s = LEAD_S + SWING_S + SECOND_BUMP_S
        second = drive(first.plant, again, length_s + _MARGIN_S, then)
        return self._act(TwoBumps(first, second), length_s)

    def _act(self, motion: Moving, length_s: float, lead_s: float = LEAD_S) -> Act:
        return Act(scene_of(self._rig, motion, 0.0, length_s + _MARGIN_S), length_s, lead_s)

    def _peak(self, act: Act) -> float:
        """Return the largest deviation from rest of the trigger channels, m/s2."""
        return max(float(np.max(np.abs(self._moved(act, c)))) for c in self._triggers())

    def _low_limit(self, act: Act) -> Mapping[str, float]:
        """Return the strongest trigger channel with a limit that halves its free motion."""
        free = round((LEAD_S + self._bench.bump_s + 0.01) / _SEEN_S)
        tops = [(float(np.max(self._moved(act, c)[free:])), c.name) for c in self._triggers()]
        top, name = max(tops)
        return {name: GRAVITY_M_S2 + top / 2}

    def _triggers(self) -> tuple[Channel, ...]:
        return trigger_channels(self._bench.channels, self._bench.procedure.method)

    def _moved(self, act: Act, channel: Channel) -> Array:
        """Return the reading of an accelerometer in an act without gravity, every millisecond."""
        sensor = self._rig.drawn.sensors[channel.name]
        t_s = np.arange(0.0, LEAD_S + 1.0, _SEEN_S)
        motion = act.scene.motion.at(t_s)
        return true_reading(channel, sensor, self._rig.installation, motion) - GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class Push:
    """A person who presses the body down and lets go.

    A press is so slow that every spring follows.
    """

    rest: Array
    """(7, 1) The pose before and after."""
    sink: Array
    """(7, 1) The change of the pose at the lowest point."""
    length_s: float
    """Duration, s."""

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
