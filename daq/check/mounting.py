"""Finds how sensors are mounted: up from gravity; forward and the wheels of travels from pushes.

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
from .push_test import ORDER

AXES = ("x", "y", "z")
_ALIGNED = 0.9
"""Share of gravity on one axis from which it is the vertical axis: a tilt of less than 26 deg."""
NEAR_1_G = 0.1
"""Largest relative deviation of a magnitude at rest from 1 g."""
_CLEAR = 2.0
"""Factor by which the best direction or corner must fit the pushes better than the next one."""

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


def mounting(
    gravity_g: Mapping[str, float],
    turns: Mapping[Corner, Mapping[str, float]] | None,
    stated: str = "",
) -> Mounting | None:
    """Return how a sensor is mounted; None if no axis is vertical.

    `gravity_g`: reading of each of the three axes at rest, in g.  `turns`: the angle by which the
    body turned about each axis in a push on each corner, any unit; None without pushes: x is then
    assumed to be forward, or z if x is vertical.  `stated`: the axis that points forward according
    to the user, as ``-x``; a vertical one is ignored.
    """
    reading = np.array([gravity_g[axis] for axis in AXES])
    size = float(np.linalg.norm(reading))
    share = reading / size if size > 0 else reading
    vertical = int(np.argmax(np.abs(share)))
    if abs(size - 1) > NEAR_1_G or abs(share[vertical]) < _ALIGNED:
        return None
    up = np.zeros(3)
    up[vertical] = np.sign(share[vertical])
    tilt_deg = float(np.degrees(np.arccos(min(abs(share[vertical]), 1.0))))
    # The four directions that may be forward.
    level = [sign * e for e in np.eye(3) if not np.any(up * e) for sign in (1.0, -1.0)]
    for forward in level:
        if len(stated) == 2 and axis_of(forward) == (stated[1], int(f"{stated[0]}1")):
            return Mounting(up, forward, tilt_deg, True)
    if turns:
        fits = [_fit(up, forward, turns) for forward in level]
        best, second = np.argsort(fits)[:-3:-1].tolist()
        if fits[best] > _CLEAR * max(fits[second], 0.0):
            return Mounting(up, level[best], tilt_deg, True)
    # x is forward; where x is vertical it is z, or -z if x points up.
    usual = -up[0] * np.eye(3)[2] if up[0] else np.eye(3)[0]
    return Mounting(up, usual, tilt_deg, False)


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
            total += ((1.0 if corner.front else -1.0) * pitch - corner.side * roll) / size
    return total


def pushed_corner(
    peaks: Mapping[Corner, float], others: Sequence[Mapping[Corner, float]]
) -> tuple[Corner, int] | None:
    """Return the corner and the sign of a travel sensor; None if they are not clear.

    `peaks`: its largest deviation in the push on each corner, any unit.  `others`: those of all
    other travels.  The push on its own corner moves it more than any other push does.
    """
    best, second = sorted(peaks, key=lambda corner: -abs(peaks[corner]))[:2]
    size = abs(peaks[best])
    if not size or size < _CLEAR * abs(peaks[second]) or any(abs(o[best]) > size for o in others):
        return None
    return best, 1 if peaks[best] > 0 else -1


# Cuts a recording of a push on each corner, with rest between them, and measures the signals ------

_BIN_S = 0.05
_QUIET_S = 0.5
"""Rest between two pushes, s."""
_LEAST_S = 0.15
"""Shortest push, s."""
_OVER_NOISE = 8.0
_REST_S = 0.5
"""Rest at the beginning, from which level and noise are taken, s."""

Trace = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Times, ns, and values of a signal, each of shape (n,)."""


@dataclass(frozen=True, slots=True)
class Pushes:
    """A recording of a push on each corner."""

    spans: Mapping[Corner, tuple[int, int]]
    """Start and end of each push, ns."""
    traces: Mapping[str, Trace]
    """Decoded samples, by full name of the signal."""

    def peaks(self, name: str) -> dict[Corner, float]:
        """Return the largest deviation of a signal from rest in each push, signed."""
        return {corner: _largest(value) for corner, _, value in self._parts(name)}

    def turns(self, name: str) -> dict[Corner, float]:
        """Return the largest angle in each push, from a signal that is a rate, signed."""
        return {
            corner: _largest(np.cumsum(rate[:-1] * np.diff(t_ns)) * 1e-9)
            for corner, t_ns, rate in self._parts(name)
        }

    def _parts(self, name: str) -> list[tuple[Corner, NDArray[np.int64], NDArray[np.float64]]]:
        t_ns, value = self.traces[name]
        level = np.median(value[t_ns < t_ns[0] + round(_REST_S * 1e9)])
        inside = {c: (t_ns >= start) & (t_ns < end) for c, (start, end) in self.spans.items()}
        return [(c, t_ns[rows], value[rows] - level) for c, rows in inside.items()]


def _largest(value: NDArray[np.float64]) -> float:
    return float(value[np.argmax(np.abs(value))]) if len(value) else 0.0


def find_pushes(traces: Mapping[str, Trace], moved: Sequence[str]) -> tuple[Pushes | None, int]:
    """Return the pushes in a recording, and how many it has; None unless there are four.

    `traces`: decoded samples, in order of time.  `moved`: the signals that a push by hand moves.
    """
    usable = [traces[name] for name in moved if name in traces and len(traces[name][0]) > 1]
    if not usable:
        return None, 0
    first = min(int(t_ns[0]) for t_ns, _ in usable)
    last = max(int(t_ns[-1]) for t_ns, _ in usable)
    active = np.zeros(int((last - first) * 1e-9 / _BIN_S) + 1, bool)
    for t_ns, value in usable:
        before = value[t_ns < first + round(_REST_S * 1e9)]
        if len(before) < 3:
            continue
        away = np.abs(value - np.median(before))
        noise = float(np.std(before)) + float(np.ptp(value)) * 1e-3
        largest = float(away.max())
        if largest > _OVER_NOISE * noise:
            far = t_ns[away > max(_OVER_NOISE * noise, 0.2 * largest)]
            active[((far - first) * 1e-9 / _BIN_S).astype(int)] = True
    bins = np.flatnonzero(active)
    cuts = np.flatnonzero(np.diff(bins) > _QUIET_S / _BIN_S) + 1  # with little rest it is one push
    bin_ns, margin_ns = round(_BIN_S * 1e9), round(_QUIET_S / 2 * 1e9)
    spans = [
        (first + int(p[0]) * bin_ns - margin_ns, first + int(p[-1] + 1) * bin_ns + margin_ns)
        for p in np.split(bins, cuts)  # the bins of one push
        if len(p) and (p[-1] + 1 - p[0]) * _BIN_S >= _LEAST_S
    ]
    if len(spans) != len(ORDER):
        return None, len(spans)
    return Pushes(dict(zip(ORDER, spans, strict=True)), traces), len(spans)
