"""Computes the force of a damper from its closing speed; compression is positive.

A curve describes one damper.  A `DamperLaw` holds the curves of all corners as arrays, so that four
corners of several cars are evaluated together: straight lines, tanh terms, and changes of slope at
given speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SECANT_M_S = 0.1
"""Speed that defines c_s, m/s: c_s is the slope of the straight line between the forces at minus
and plus this speed."""


class Branch(NamedTuple):
    """A digressive damper in one direction: steep at first, flatter beyond a soft knee."""

    low_ns_m: float
    """Slope at standstill, N s/m."""
    high_ns_m: float
    """Slope far above the knee, N s/m."""
    knee_m_s: float
    """Speed of the knee, m/s; the force is ``high v + (low - high) knee tanh(v / knee)``."""

    def times(self, factor: float) -> Branch:
        """Return a damper of the same shape with other forces."""
        return Branch(self.low_ns_m * factor, self.high_ns_m * factor, self.knee_m_s)


@dataclass(frozen=True, slots=True)
class Straight:
    """A damper with a slope for each direction."""

    compression_ns_m: float
    """Slope while the wheel approaches the body, N s/m."""
    rebound_ns_m: float
    """Slope while the wheel leaves it, N s/m."""


@dataclass(frozen=True, slots=True)
class Digressive:
    """A damper with a soft knee in each direction."""

    compression: Branch
    """Branch while the wheel approaches the body."""
    rebound: Branch
    """Branch while the wheel leaves the body."""


@dataclass(frozen=True, slots=True)
class Table:
    """A damper as a table of a test rig: straight between its points and after the last one."""

    compression: tuple[tuple[float, float], ...]
    """Speed (m/s) and force (N), both positive, rising; the origin is implied."""
    rebound: tuple[tuple[float, float], ...]
    """Speed and force of the other direction, also positive."""


DamperCurve = Straight | Digressive | Table


@dataclass(frozen=True, slots=True)
class Bends:
    """A soft knee of each corner and direction, (4, 1) each."""

    compression_n: Array
    """Force that the knee adds far above it, N."""
    compression_m_s: Array
    """Speed of the knee, m/s."""
    rebound_n: Array
    """Force that the knee adds, N."""
    rebound_m_s: Array
    """Speed of the knee, m/s."""

    def toward(self, ahead: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return speed and force of the knees of each corner, for its direction of motion."""
        speed = np.where(ahead, self.compression_m_s, self.rebound_m_s)
        return speed, np.where(ahead, self.compression_n, self.rebound_n)


@dataclass(frozen=True, slots=True)
class Hinges:
    """Changes of slope at given speeds, (J, 4, 1) each; a padded corner has changes of zero."""

    speed_m_s: Array
    """Speed at which the slope changes, m/s; not negative for compression, negative for rebound."""
    toward: Array
    """+1 if the change acts above the speed, -1 if it acts below."""
    change_ns_m: Array
    """Change of the slope, N s/m."""


@dataclass(frozen=True, slots=True)
class DamperLaw:
    """The dampers of four corners."""

    compression_ns_m: Array
    """(4, 1) Slope of the straight part while the wheel approaches the body, N s/m."""
    rebound_ns_m: Array
    """(4, 1) Slope of the straight part while the wheel leaves the body, N s/m."""
    bends: Bends | None
    """Soft knees, if there are any."""
    hinges: Hinges | None
    """Changes of slope, if there are any."""

    @property
    def straight(self) -> bool:
        """True if force is proportional to speed, with the same slope in both directions."""
        alike = np.array_equal(self.compression_ns_m, self.rebound_ns_m)
        return alike and self.bends is None and self.hinges is None

    def force(self, closing: Array) -> Array:
        """Return the force, N, at closing speeds (4, n), m/s."""
        ahead = closing > 0.0
        force = np.where(ahead, self.compression_ns_m, self.rebound_ns_m) * closing
        if self.bends is not None:
            speed, gain = self.bends.toward(ahead)
            force += gain * np.tanh(closing / speed)
        if self.hinges is not None:
            h = self.hinges
            beyond = np.maximum(h.toward * (closing - h.speed_m_s), 0.0)
            force += (h.toward * h.change_ns_m * beyond).sum(axis=0)
        return force

    def slope(self, closing: Array) -> Array:
        """Return the derivative of the force by the speed, N s/m; arguments of `force`."""
        ahead = closing > 0.0
        slope = np.where(ahead, self.compression_ns_m, self.rebound_ns_m)
        if self.bends is not None:
            speed, gain = self.bends.toward(ahead)
            slope = slope + gain / speed * (1.0 - np.tanh(closing / speed) ** 2)
        if self.hinges is not None:
            h = self.hinges
            passed = h.toward * (closing - h.speed_m_s) > 0.0
            slope = slope + (h.change_ns_m * passed).sum(axis=0)
        return slope


def damper_law(curves: Sequence[DamperCurve], factors: Sequence[float]) -> DamperLaw:
    """Return the dampers of four corners, each a curve times a factor."""
    sides = [_sides(curve) for curve in curves]
    factor = np.array(factors, dtype=np.float64)[:, None]
    return DamperLaw(
        compression_ns_m=factor * np.array([[side[0]] for side in sides]),
        rebound_ns_m=factor * np.array([[side[1]] for side in sides]),
        bends=_bends(curves, factor),
        hinges=_hinges(curves, factor),
    )


def secant_ns_m(curve: DamperCurve) -> float:
    """Return the slope of a curve between minus and plus `SECANT_M_S`, which is its c_s."""
    speeds = np.array([[-SECANT_M_S, SECANT_M_S]])
    below, above = damper_law([curve], [1.0]).force(speeds)[0]
    return float((above - below) / (2.0 * SECANT_M_S))


def scaled(shape: Digressive, secant: float) -> Digressive:
    """Return a curve of a given shape whose `secant_ns_m` is `secant`, N s/m."""
    factor = secant / secant_ns_m(shape)
    return Digressive(shape.compression.times(factor), shape.rebound.times(factor))


def _sides(curve: DamperCurve) -> tuple[float, float]:
    """Return the slopes of the straight part, compression and rebound."""
    match curve:
        case Straight():
            return curve.compression_ns_m, curve.rebound_ns_m
        case Digressive():
            return curve.compression.high_ns_m, curve.rebound.high_ns_m
        case Table():
            return _slopes(curve.compression)[0][1], _slopes(curve.rebound)[0][1]


def _slopes(points: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    """Return the begin of each segment of a table, m/s, and its slope, N s/m."""
    return [(v0, (f1 - f0) / (v1 - v0)) for (v0, f0), (v1, f1) in pairwise(((0.0, 0.0), *points))]


def _bends(curves: Sequence[DamperCurve], factor: Array) -> Bends | None:
    if not any(isinstance(curve, Digressive) for curve in curves):
        return None
    none = Branch(0.0, 0.0, 1.0)
    both = [
        (c.compression, c.rebound) if isinstance(c, Digressive) else (none, none) for c in curves
    ]

    def gain(branch: Branch) -> float:
        return (branch.low_ns_m - branch.high_ns_m) * branch.knee_m_s

    return Bends(
        compression_n=factor * np.array([[gain(c)] for c, _ in both]),
        compression_m_s=np.array([[c.knee_m_s] for c, _ in both]),
        rebound_n=factor * np.array([[gain(r)] for _, r in both]),
        rebound_m_s=np.array([[r.knee_m_s] for _, r in both]),
    )


def _hinges(curves: Sequence[DamperCurve], factor: Array) -> Hinges | None:
    found = [list(_changes(curve)) if isinstance(curve, Table) else [] for curve in curves]
    most = max(map(len, found))
    if most == 0:
        return None
    padded = [changes + [(0.0, 1.0, 0.0)] * (most - len(changes)) for changes in found]
    speed, toward, change = np.array(padded).transpose(2, 1, 0)[..., None]
    return Hinges(speed, toward, change * factor)


def _changes(table: Table) -> list[tuple[float, float, float]]:
    """Return speed, direction and size of each change of slope of a table."""
    return [
        (toward * speed, toward, after - before)
        for points, toward in ((table.compression, 1.0), (table.rebound, -1.0))
        for (_, before), (speed, after) in pairwise(_slopes(points))
    ]
