"""Drives a car with nonlinear elements over a bump, to the state in which its free decay begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..elements.tyre import tyre_force, tyre_load, tyre_push
from ..nonlinear.car import BETA, C_T, K_T, MASS, STATIC, Car
from ..nonlinear.level import PATH, USUAL
from ..nonlinear.path import STATES, InitialState, first_state, step_of
from ..nonlinear.reference import Stack, rates, stack

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Driven:
    """A car at rest before its bump."""

    car: Car
    rest: Array
    """(7,) position at rest: the weights lower it from that of the bare car."""
    shares: tuple[float, float, float, float]
    """Share of the height under each wheel."""
    height_m: float
    """Height of the half sine, m."""


def after_bump(driven: Sequence[Driven], bump_s: float) -> tuple[InitialState, ...]:
    """Return the state of each car as its wheels leave the bump.

    The laws are those of the fit; the road comes in through the tyres.

    `driven`: the cars; all of them have mounts, or none.  `bump_s`: duration of the bump, s.
    """
    cars = stack([one.car for one in driven] if len(driven) > 1 else [driven[0].car] * 2, PATH)
    rows = max(len(driven), 2)  # a stack of one car has no axis for cars
    x = np.zeros((rows, STATES))
    x[:, :7] = [one.rest for one in (*driven, driven[0])[:rows]]
    road = np.array([np.multiply(one.height_m, one.shares) for one in (*driven, driven[0])[:rows]])
    steps = int(np.ceil(bump_s / step_of([one.car for one in driven], USUAL)))
    h, omega = bump_s / steps, np.pi / bump_s
    r = np.zeros((rows, 4))
    # A car whose state does not stay finite overflows, which is detected at the end.
    with np.errstate(all="ignore"):
        for k in range(steps):
            waves = [
                (road * np.sin(omega * t), road * omega * np.cos(omega * t))
                for t in (k * h, (k + 0.5) * h, (k + 1) * h)
            ]
            k1, r = _rates(x, cars, r, *waves[0])
            k2, r = _rates(x + 0.5 * h * k1, cars, r, *waves[1])
            k3, r = _rates(x + 0.5 * h * k2, cars, r, *waves[1])
            k4, r = _rates(x + h * k3, cars, r, *waves[2])
            x = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return tuple(_initial_state(one.car, state) for one, state in zip(driven, x, strict=False))


def _rates(x: Array, cars: Stack, r: Array, road: Array, rise: Array) -> tuple[Array, Array]:
    """Return the rates of change of the states with a road of heights (n, 4) under the wheels."""
    out, r = rates(x, cars, r)
    p = cars.p
    width = cars.level.load_n

    def road_force(z: Array, v: Array) -> Array:
        load = tyre_load(z, p[K_T], p[BETA], p[STATIC])
        return np.asarray(tyre_force(tyre_push(load, v, p[C_T], width), p[STATIC], width))

    change = road_force(x[:, 3:7] - road, x[:, 10:14] - rise)
    change -= road_force(x[:, 3:7], x[:, 10:14])
    out[:, 10:14] += change / p[MASS]
    return out, r


def _initial_state(car: Car, state: Array) -> InitialState:
    """Return a state in the form in which the fit describes the beginning of a run."""
    bare = InitialState(state[:14], state[14:18], np.zeros(4))
    beyond = state[18:] - first_state(car, bare, PATH)[0][18:] if car.has_mount else np.zeros(4)
    return InitialState(state[:14].copy(), state[14:18].copy(), beyond)
