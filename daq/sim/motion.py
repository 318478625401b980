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
        turn = np.pi / self.duration_s
        on = (t_s >= self.start_s) & (t_s <= self.end_s)
        phase = turn * (t_s - self.start_s)
        return crest_m * np.sin(phase) * on, crest_m * turn * np.cos(phase) * on


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
    """States and rates, (m + 1, 22), at even times."""

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
        first, last = np.searchsorted(t_s, [self.bump.start_s, self.bump.end_s], side="right")
        states = np.repeat(self.start, len(t_s), axis=1)
        for span, part in zip(self.spans, (slice(first, last), slice(last, None)), strict=True):
            times = np.ascontiguousarray(t_s[part], dtype=np.float64)
            states[:, part] = read(span.states, span.rates, span.begin_s, span.step_s, times)
        return states

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s.

        Accelerations are those of the balance of forces, not differences of velocities.
        """
        states = self.states(t_s)
        total = balances(self.plant, states, *self.bump.road(t_s))[2]
        return Kinematics(states[:7], states[7:14], self.plant.mobility @ total)


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
    """Return a motion that another one follows from the beginning of its bump."""
    split = int(np.searchsorted(t_s, second.bump.start_s, side="right"))
    early, late = first.at(t_s[:split]), second.at(t_s[split:])
    return Kinematics(
        np.hstack([early.pose, late.pose]),
        np.hstack([early.velocity, late.velocity]),
        np.hstack([early.acceleration, late.acceleration]),
    )


def standing(plant: Plant, stuck: Array | None = None) -> Array:
    """Return the state of a car at rest, (22, 1).

    `stuck`, (4, 1) float64: share of its friction that each corner carries; default: none, the car
    has settled.  Raises ValueError if the car does not stand on four wheels (`static_pose`).
    """
    return _still(static_pose(plant, stuck), stuck)


def _still(pose: Array, stuck: Array | None = None) -> Array:
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
    first = standing(plant) if start is None else start
    crest = bump.height_m * np.array(BUMPS[bump.excitation].shares)
    state, spans = first[:, 0].copy(), []
    limits = (bump.start_s, bump.end_s)
    for begin_s, stop_s in (limits, (bump.end_s, max(end_s, bump.end_s + step_s))):
        count = int(np.ceil((stop_s - begin_s) / (EACH * step_s)))
        states, rates = integrate(plant, state, crest, (begin_s, stop_s), limits, count, EACH)
        spans.append(_Span(begin_s, (stop_s - begin_s) / count, states, rates))
        state = states[-1].copy()
    return Motion(plant, bump, first, (spans[0], spans[1]))


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
        end = 2.0 * np.pi * self.turns
        turn = end / self.length_s
        phase = np.clip(turn * (t_s - self.begin_s), 0.0, end)
        going = (phase > 0.0) & (phase < end)
        return Kinematics(
            self.rest + self.sink * (1.0 - np.cos(phase)) / 2,
            self.sink * turn * np.sin(phase) / 2 * going,
            self.sink * turn**2 * np.cos(phase) / 2 * going,
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
        press = Push(self.rest, self.held - self.rest, PRESS_S, self.start_s, 0.5)
        return _spliced(press, self.decay, t_s)


def dropped(
    plant: Plant, excitation: Excitation, height_m: float, go_s: float, end_s: float
) -> Release:
    """Drop a car off blocks of a given height under the wheels that the bump lifts."""
    held = static_pose(plant, road=height_m * np.array(BUMPS[excitation].shares)[:, None])
    return Release(held, held, go_s, _let_go(plant, held, go_s, end_s))


def pushed_down(
    plant: Plant, excitation: Excitation, depth_m: float, start_s: float, end_s: float
) -> Release:
    """Push the body of a car down at the place for the bump, hold it, and release it.

    Raises ValueError if a push cannot make that bump.
    """
    hand = BUMPS[excitation].hand
    if hand is None:
        raise ValueError(f"a push cannot make a {excitation.words} bump")
    x_m = plant.corners["x_m"]
    ahead = hand[0] * float(x_m[0] if hand[0] > 0 else -x_m[2])
    left = hand[1] * float(np.mean(np.abs(plant.corners["y_m"])))
    rest = static_pose(plant)
    sink = static_pose(plant, load=_down(1.0, ahead, left)) - rest
    at_the_hand = abs(float(sink[0, 0] - sink[1, 0] * ahead + sink[2, 0] * left))
    held = rest + sink * depth_m / at_the_hand
    return Release(rest, held, start_s, _let_go(plant, held, start_s + PUSHED_S, end_s))


def _let_go(plant: Plant, held: Array, go_s: float, end_s: float) -> Motion:
    return drive(plant, Bump(Excitation.BOUNCE, 0.0, go_s, 0.01), end_s, _still(held))


def _down(force_n: float, x_m: float, y_m: float) -> Array:
    load = np.zeros((7, 1))
    load[:3, 0] = -force_n * np.array([1.0, -x_m, y_m])
    return load


def pushed(plant: Plant, corner: Corner, force_n: float, length_s: float) -> Push:
    """Press the body down at a corner with a force that rises and falls as a cosine."""
    i, rest = corner.position, static_pose(plant)
    load = _down(force_n, plant.corners["x_m"][i], plant.corners["y_m"][i])
    return Push(rest, static_pose(plant, load=load) - rest, length_s)
