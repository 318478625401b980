"""A wire car in perspective that moves as a mode does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import VehicleGeometry

_LIFT_M = 0.22  # of the point that moves most: large enough to see
_DECK_M, _ROOF_M, _HUB_M = 0.62, 1.25, 0.32
_RADIUS_M = 0.31
_OVERHANG_M = 0.55
_EYE = np.array([5.2, 5.6, 3.1])
"""Position of the viewer, m from the middle of the car: in front, left, above."""
_DISTANCE_M = float(np.linalg.norm(_EYE))
_BACK = _EYE / _DISTANCE_M
_RIGHT = np.array([-_EYE[1], _EYE[0], 0.0]) / np.hypot(_EYE[0], _EYE[1])
_UP = np.cross(_BACK, _RIGHT)
_COILS = 5


@dataclass(frozen=True, slots=True)
class Shape:
    """A mode of the vehicle, ready to be drawn."""

    title: str
    numbers: str
    """`title`, `numbers`: its name; its frequency and damping as text."""
    frequency_hz: float
    """Frequency of the mode, Hz."""
    motion: NDArray[np.complex128]
    """Displacements of `daq.vehicle.DOF`, turned so that most of it is real, m, shape (7,)."""
    geometry: VehicleGeometry
    """Geometry of the vehicle."""


@dataclass(frozen=True, slots=True)
class Outline:
    """The car at one instant, projected; x to the right, y down, m at the distance of the car."""

    deck: NDArray[np.float64]
    roof: NDArray[np.float64]
    """`deck`, `roof`: corners of two plates of the body, around, shape (4, 2)."""
    springs: NDArray[np.float64]
    """Lines from body to hub at each wheel, shape (4, k, 2)."""
    wheels: NDArray[np.float64]
    """Their rims, shape (4, k, 2)."""


def shape_of(
    title: str,
    numbers: str,
    frequency_hz: float,
    shape: NDArray[np.complex128],
    geometry: VehicleGeometry,
) -> Shape:
    """Scale and turn a displacement shape, (7,), so that it can be seen."""
    points = _lift(geometry) @ shape
    turn = np.exp(-0.5j * np.angle(np.sum(points**2)))
    motion = shape * turn * _LIFT_M / np.max(np.abs(points))
    return Shape(title, numbers, frequency_hz, np.asarray(motion), geometry)


def outline(shape: Shape, phase: float) -> Outline:
    """Return the car at a phase of the motion, rad; damping is left out."""
    x = (shape.motion * np.exp(1j * phase)).real
    return _outline(shape.geometry, x)


def at_rest(geometry: VehicleGeometry) -> Outline:
    """Return the car standing still."""
    return _outline(geometry, np.zeros(7))


def _corners(g: VehicleGeometry) -> NDArray[np.float64]:
    """Return where the wheels are, (4, 2), order `daq.vehicle.Corner`."""
    return np.array([[g.a, g.t_f], [g.a, -g.t_f], [-g.b, g.t_r], [-g.b, -g.t_r]])


def _lift(g: VehicleGeometry) -> NDArray[np.float64]:
    """Return the lift of body corners and wheels by the degrees of freedom, (8, 7)."""
    rows = np.zeros((8, 7))
    rows[:4, 0] = 1.0
    rows[:4, 1:3] = _corners(g) * [-1.0, 1.0]
    rows[4:, 3:] = np.eye(4)
    return rows


def _outline(g: VehicleGeometry, x: NDArray[np.float64]) -> Outline:
    front, rear = g.a + _OVERHANG_M, -g.b - _OVERHANG_M
    wide = max(g.t_f, g.t_r) + 0.08
    deck = np.array([[front, wide], [front, -wide], [rear, -wide], [rear, wide]])
    cabin = np.array([[0.2 * front, 0.8 * wide], [0.2 * front, -0.8 * wide]])
    cabin = np.vstack([cabin, [[0.7 * rear, -0.8 * wide], [0.7 * rear, 0.8 * wide]]])
    corners, hub = _corners(g), _HUB_M + x[3:]
    around = np.linspace(0.0, 2.0 * np.pi, 25)
    turn = _RADIUS_M * np.stack([np.cos(around), np.zeros(25), np.sin(around)], axis=1)
    middle = np.array([(g.a - g.b) / 2.0, 0.0, 0.45])
    return Outline(
        _seen(np.column_stack([deck, _body_z(deck, x, _DECK_M)]), middle),
        _seen(np.column_stack([cabin, _body_z(cabin, x, _ROOF_M)]), middle),
        _seen(_coils(corners, hub, _body_z(corners, x, _DECK_M)), middle),
        _seen(np.column_stack([corners, hub])[:, None] + turn, middle),
    )


def _body_z(
    points: NDArray[np.float64], x: NDArray[np.float64], height: float
) -> NDArray[np.float64]:
    return np.asarray(height + x[0] - points[:, 0] * x[1] + points[:, 1] * x[2])


def _coils(
    corners: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a zigzag from hub to body at each corner, (4, k, 3)."""
    n = 2 * _COILS + 2
    up = np.linspace(0.0, 1.0, n)
    aside = 0.05 * np.where(np.arange(n) % 2, 1.0, -1.0)
    aside[[0, -1]] = 0.0
    x, y, low, high = corners[:, :1], corners[:, 1:], low[:, None], high[:, None]
    return np.stack(np.broadcast_arrays(x + aside, y, low + (high - low) * up), axis=2)


def _seen(points: NDArray[np.float64], middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project points, (.., 3), onto the plane through the middle of the car, (.., 2)."""
    off = points - middle
    scale = _DISTANCE_M / (_DISTANCE_M - off @ _BACK)
    return np.stack([off @ _RIGHT * scale, -(off @ _UP) * scale], axis=-1)
