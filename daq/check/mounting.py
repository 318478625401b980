"""Finds how an IMU is mounted: up from gravity, forward from pushes on the corners.

An accelerometer at rest shows +1 g along the axis that points up.  The gyroscopes of the same
device turn with it.  A push on a corner turns the body towards that corner: this shows which of
the horizontal axes points forward.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..vehicle import Corner

AXES = ("x", "y", "z")
_ALIGNED = 0.9
"""Share of gravity on one axis from which it is the vertical axis: a tilt of less than 26 deg."""
_NEAR_1_G = 0.1
"""Largest relative deviation of the magnitude at rest from 1 g."""
_CLEAR = 2.0
"""Factor by which the best direction must fit the pushes better than a direction 90 deg off."""

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Mounting:
    """Directions of the car in the axes of a sensor."""

    up: Vector
    """Upward direction, shape (3,), components -1, 0 or 1."""
    forward: Vector
    """Forward direction, shape (3,), components -1, 0 or 1."""
    tilt_deg: float
    """Angle between the sensor's nearest axis and the vertical, deg."""
    surely_forward: bool
    """True if pushes prove the forward direction, or the user states it."""

    @property
    def left(self) -> Vector:
        """The direction to the left."""
        return np.cross(self.up, self.forward)


def axis_of(direction: Vector) -> tuple[str, int]:
    """Return the axis of the sensor along a direction of the car, and its sign."""
    place = int(np.argmax(np.abs(direction)))
    return AXES[place], 1 if direction[place] > 0 else -1


def up_axis(gravity_g: Mapping[str, float]) -> tuple[Vector, float] | None:
    """Return the upward direction in the sensor's axes and the tilt, deg; None if it is not clear.

    `gravity_g`: reading of each axis at rest, in g; all three are needed.
    """
    if len(gravity_g) < len(AXES):
        return None
    read = np.array([gravity_g[axis] for axis in AXES])
    size = float(np.linalg.norm(read))
    share = read / size if size > 0 else read
    place = int(np.argmax(np.abs(share)))
    if abs(size - 1) > _NEAR_1_G or abs(share[place]) < _ALIGNED:
        return None
    up = np.zeros(3)
    up[place] = np.sign(share[place])
    return up, float(np.degrees(np.arccos(min(abs(share[place]), 1.0))))


def mounting(
    up: Vector,
    tilt_deg: float,
    turns: Mapping[Corner, Mapping[str, float]] | None,
    stated: str = "",
) -> Mounting:
    """Return how a sensor is mounted.

    `turns`: the angle by which the body turned about each axis in a push on each corner, any unit;
    None without pushes: x is then assumed to be forward, or z if x is vertical.  `stated`: the axis
    that points forward according to the user, as ``-x``; a vertical one is ignored.
    """
    candidates = [sign * e for e in np.eye(3) if not np.any(up * e) for sign in (1.0, -1.0)]
    matching = [c for c in candidates if stated and axis_of(c) == (stated[1], int(f"{stated[0]}1"))]
    if matching:
        return Mounting(up, matching[0], tilt_deg, True)
    if turns:
        fits = [_fit(up, forward, turns) for forward in candidates]
        order = np.argsort(fits)[::-1]
        best, second = fits[order[0]], fits[order[1]]
        if best > _CLEAR * max(second, 0.0):
            return Mounting(up, candidates[order[0]], tilt_deg, True)
    usual = next((f for f in candidates if f[0] == 1.0), None)
    forward = usual if usual is not None else -np.sign(up[0]) * np.eye(3)[2]
    return Mounting(up, forward, tilt_deg, False)


def _fit(up: Vector, forward: Vector, turns: Mapping[Corner, Mapping[str, float]]) -> float:
    """Return how well a forward direction explains pitch and roll in the pushes."""
    left = np.cross(up, forward)
    total = 0.0
    for corner, angles in turns.items():
        turn = np.array([angles.get(axis, 0.0) for axis in AXES])
        size = float(np.linalg.norm(turn))
        if size > 0:
            pitch, roll = float(turn @ left), float(turn @ forward)
            # Positive pitch is nose down; positive roll lifts the left side, which a push lowers.
            nose = 1.0 if corner.front else -1.0
            total += (nose * pitch - corner.side * roll) / size
    return total


def pushed_corner(
    responses: Mapping[Corner, float], others: Sequence[Mapping[Corner, float]]
) -> tuple[Corner, int] | None:
    """Return the corner and the sign of a travel sensor; None if they are not clear.

    `responses`: its largest deviation in the push on each corner, any unit.  `others`: the
    deviations of all sensors of its kind.  The push on its own corner moves it more than any other
    push does.
    """
    size = {corner: abs(value) for corner, value in responses.items()}
    ranked = sorted(size, key=lambda corner: -size[corner])
    if len(ranked) < 2 or size[ranked[0]] < _CLEAR * size[ranked[1]]:
        return None
    best = ranked[0]
    if not size[best]:  # it never moved: it is dead, or not where anybody pushed
        return None
    if any(abs(other.get(best, 0.0)) > size[best] for other in others):
        return None
    return best, 1 if responses[best] > 0 else -1
