"""Computes how the simulated car moves: over a bump, off blocks, after a push, or pushed slowly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ..bumps import BUMPS
from ..runs import Excitation
from ..vehicle import Corner
from .elements import Array
from .engine import STATE, Plant, balances, integrate, read
from .plant import static_pose

STEP_S = 5e-5
"""Step of the integration, s: short enough for a wheel that slides at 3 m/s through a pre-sliding
length of 0.1 mm, and more than enough for a wheel that moves at 15 Hz."""
EACH = 4
"""Steps from one stored state to the next; the cubic between them adds 1e-9 of the motion."""
PRESS_S = 0.5
"""Time that hands take to push the body down, s."""
PUSHED_S = PRESS_S + 0.1
"""Time from the beginning of a push until the release, s; hands hold the car for 0.1 s."""


@dataclass(frozen=True, slots=True)
class Bump:
    """A half-sine bump that the chosen wheels pass at the same time."""

    excitation: Excitation
    """Kind of bump (`daq.bumps.BUMPS`)."""
    height_m: float
    """Height of the bump, m."""
    start_s: float
    """Time at which the wheels meet the bump, s."""
    duration_s: float
    """Time for which the wheels are on the bump, s."""

    @property
    def end_s(self) -> float:
        """Time at which the wheels have left the bump and the free decay starts, s."""
        return self.start_s + self.duration_s

    def road(self, t_s: Array) -> tuple[Array, Array]:
        """Return height, m, and vertical speed, m/s, of the road under each wheel, (4, n) (Eq. 34).

        The speed jumps where the bump begins and ends; those two instants count as on the bump.
        """
        crest_m = self.height_m * np.array(BUMPS[self.excitation].shares)[:, None]
        turn_rad_s = np.pi / self.duration_s
        is_on = (t_s >= self.start_s) & (t_s <= self.end_s)
        phase = turn_rad_s * (t_s - self.start_s)
        height_m, speed_m_s = crest_m * np.sin(phase), crest_m * turn_rad_s * np.cos(phase)
        return np.where(is_on, height_m, 0.0), np.where(is_on, speed_m_s, 0.0)


@dataclass(frozen=True, slots=True)
class Kinematics:
    """The motion at chosen instants, each (7, n) in the order `daq.vehicle.DOF`."""

    pose: Array
    """Pose, counted from free springs (`engine`), m and rad."""
    velocity: Array
    """Rate of change of the pose."""
    acceleration: Array
    """Rate of change of the velocity, from the balance of forces."""


class Moving(Protocol):
    """Any motion of the car that can be sampled."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s; at rest before 0."""


class _Span(NamedTuple):
    """States and their rates of change, (m + 1, 22), at intervals of `step_s`."""

    begin_s: float
    step_s: float
    states: Array
    rates: Array


@dataclass(frozen=True, slots=True)
class Motion:
    """One run, solved: at rest, over the bump, free decay."""

    plant: Plant
    """The car that moves."""
    bump: Bump
    """The bump."""
    start: Array
    """(22, 1) State before the bump."""
    spans: tuple[_Span, _Span]
    """The motion on the bump and after it; the road has a corner between them."""

    def states(self, t_s: Array) -> Array:
        """Return the states (`engine`) at the times `t_s`, (n,) ascending, s: (22, n)."""
        bump_s = [self.bump.start_s, self.bump.end_s]
        on_bump, after = np.searchsorted(t_s, bump_s, side="right")  # first index of each span
        states = np.repeat(self.start, len(t_s), axis=1)
        parts = slice(on_bump, after), slice(after, None)
        for span, part in zip(self.spans, parts, strict=True):
            times = np.ascontiguousarray(t_s[part], dtype=np.float64)
            states[:, part] = read(span.states, span.rates, span.begin_s, span.step_s, times)
        return states

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s.

        Accelerations are those of the balance of forces, not differences of velocities.
        """
        states = self.states(t_s)
        _, _, force = balances(self.plant, states, *self.bump.road(t_s))
        return Kinematics(states[:7], states[7:14], self.plant.mobility @ force)


@dataclass(frozen=True, slots=True)
class TwoBumps:
    """A car that meets a second bump before it has come to rest."""

    first: Motion
    """Motion up to the second bump."""
    second: Motion
    """Motion from the second bump, on the same axis of time."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s."""
        return _spliced(self.first, self.second, t_s)


def _spliced(first: Moving, second: Motion, t_s: Array) -> Kinematics:
    """Return the first motion up to the bump of the second, and the second from there, at `t_s`."""
    split = int(np.searchsorted(t_s, second.bump.start_s, side="right"))
    before, after = first.at(t_s[:split]), second.at(t_s[split:])
    return Kinematics(
        np.hstack([before.pose, after.pose]),
        np.hstack([before.velocity, after.velocity]),
        np.hstack([before.acceleration, after.acceleration]),
    )


def standing(plant: Plant, stuck: Array | None = None) -> Array:
    """Return the state of a car at rest, (22, 1).

    `stuck`, (4, 1) float64: share of its friction that each corner carries; default: none, the car
    has settled.  Raises ValueError if the car does not stand on four wheels (`static_pose`).
    """
    return _still(static_pose(plant, stuck), stuck)


def _still(pose: Array, stuck: Array | None = None) -> Array:
    """Return the state of a car that does not move, (22, 1), in a pose, (7, 1)."""
    state = np.zeros((STATE, 1))
    state[:7], state[14:18] = pose, 0.0 if stuck is None else stuck
    return state


def drive(
    plant: Plant,
    bump: Bump,
    end_s: float,
    start: Array | None = None,
    step_s: float = STEP_S,
) -> Motion:
    """Drive a car over a bump.

    `bump`: the road; it must begin at or after time 0.  `end_s`: end of the simulated free decay,
    s.  `start`, (22, 1): state at the beginning of the bump; default: the car is at rest.
    `step_s`: longest step of the integration, s.  Raises ValueError if the car does not stand on
    four wheels (`static_pose`).
    """
    start = standing(plant) if start is None else start
    crest_m = bump.height_m * np.array(BUMPS[bump.excitation].shares)
    state, spans = start[:, 0].copy(), []
    bump_s = (bump.start_s, bump.end_s)
    for begin_s, stop_s in (bump_s, (bump.end_s, max(end_s, bump.end_s + step_s))):
        count = int(np.ceil((stop_s - begin_s) / (EACH * step_s)))
        states, rates = integrate(plant, state, crest_m, (begin_s, stop_s), bump_s, count, EACH)
        spans.append(_Span(begin_s, (stop_s - begin_s) / count, states, rates))
        state = states[-1].copy()
    return Motion(plant, bump, start, (spans[0], spans[1]))


@dataclass(frozen=True, slots=True)
class Push:
    """A person who presses the body, so slowly that every spring follows: a cosine."""

    rest: Array
    """(7, 1) The pose before."""
    sink: Array
    """(7, 1) The change of the pose at the lowest point."""
    length_s: float
    """Duration, s."""
    begin_s: float = 0.0
    """Time at which it begins, s."""
    turns: float = 1.0
    """1 presses and lets go; a half presses and holds."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s; at rest outside the push."""
        end_rad = 2.0 * np.pi * self.turns
        turn_rad_s = end_rad / self.length_s
        phase = np.clip(turn_rad_s * (t_s - self.begin_s), 0.0, end_rad)
        moves = (phase > 0.0) & (phase < end_rad)
        return Kinematics(
            self.rest + self.sink * (1.0 - np.cos(phase)) / 2,
            np.where(moves, self.sink * turn_rad_s * np.sin(phase) / 2, 0.0),
            np.where(moves, self.sink * turn_rad_s**2 * np.cos(phase) / 2, 0.0),
        )


@dataclass(frozen=True, slots=True)
class Release:
    """A car that is moved from its rest, held, and released."""

    rest: Array
    """(7, 1) Pose before the push; with blocks, the pose in which it is held."""
    held: Array
    """(7, 1) Pose in which it is released."""
    start_s: float
    """Time at which the push begins, s; the blocks are there from the beginning."""
    decay: Motion
    """The motion after the release, which is where its flat bump begins."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s."""
        press = Push(self.rest, self.held - self.rest, PRESS_S, self.start_s, turns=0.5)
        return _spliced(press, self.decay, t_s)


def dropped(
    plant: Plant, excitation: Excitation, height_m: float, go_s: float, end_s: float
) -> Release:
    """Drop a car off blocks of a given height under the wheels that the bump lifts."""
    pose = static_pose(plant, road=height_m * np.array(BUMPS[excitation].shares)[:, None])
    return Release(pose, pose, go_s, _let_go(plant, pose, go_s, end_s))


def pushed_down(
    plant: Plant, excitation: Excitation, depth_m: float, start_s: float, end_s: float
) -> Release:
    """Push the body of a car down at the place for the bump, hold it, and release it.

    Raises ValueError if a push cannot make that bump.
    """
    hand = BUMPS[excitation].hand
    if hand is None:
        raise ValueError(f"a push cannot make a {excitation.words} bump")
    forward, to_left = hand
    corner_x_m = plant.corners["x_m"]
    hand_x_m = forward * float(corner_x_m[0] if forward > 0 else -corner_x_m[2])
    hand_y_m = to_left * float(np.mean(np.abs(plant.corners["y_m"])))
    before = static_pose(plant)
    sink_of_1_n = static_pose(plant, load=_down(1.0, hand_x_m, hand_y_m)) - before
    heave, pitch, roll = sink_of_1_n[:3, 0]
    hand_sinks_m = abs(float(heave - pitch * hand_x_m + roll * hand_y_m))
    lowest = before + sink_of_1_n * depth_m / hand_sinks_m
    return Release(before, lowest, start_s, _let_go(plant, lowest, start_s + PUSHED_S, end_s))


def _let_go(plant: Plant, pose: Array, go_s: float, end_s: float) -> Motion:
    """Return the motion of a car that is released in a pose: a drive over a bump of height 0."""
    return drive(plant, Bump(Excitation.BOUNCE, 0.0, go_s, 0.01), end_s, _still(pose))


def _down(force_n: float, x_m: float, y_m: float) -> Array:
    """Return the load, (7, 1), of a force that presses the body down at (x, y) from the CG."""
    load = np.zeros((7, 1))
    load[:3, 0] = -force_n * np.array([1.0, -x_m, y_m])
    return load


def pushed(plant: Plant, corner: Corner, force_n: float, length_s: float) -> Push:
    """Press the body down at a corner with a force that rises and falls as a cosine."""
    i, before = corner.position, static_pose(plant)
    load = _down(force_n, plant.corners["x_m"][i], plant.corners["y_m"][i])
    return Push(before, static_pose(plant, load=load) - before, length_s)
