"""A wire car in perspective that moves as a mode does: as outlines, as moving SVG, as a still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from daq.vehicle import VehicleGeometry

from .figure import FAINT, INK, PALETTE, WIDTH_IN, Drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

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

_FRAMES = 20
_SCALE = 100.0  # of the drawing, units a metre
_BOX = "-218 -142 436 300"
_SLOWEST_HZ, _PERIOD_S = 1.0, 2.4
"""Frequency, Hz, of a mode that has this period, s, on the screen; half the period at ten times the
frequency."""

_ACROSS = 4
_STILL_IN = 1.55
_REST = "#b8b8b8"


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


# Moving, without a script: SVG with SMIL ----------------------------------------------------------


def moving_car(shape: Shape) -> Markup:
    """Return an SVG of the car in endless motion, with the car at rest behind it.

    `shape`: motion of the car; faster modes move faster, but far more slowly than the real car.
    """
    period = _PERIOD_S * (max(shape.frequency_hz, 0.1) / _SLOWEST_HZ) ** -0.3
    frames = [outline(shape, 2.0 * np.pi * k / _FRAMES) for k in range(_FRAMES)]
    frames.append(frames[0])
    parts = [f'<g class="rest">{_still(at_rest(shape.geometry))}</g>', '<g class="car moving">']
    for name, path_of in _PATHS:
        values = [path_of(frame) for frame in frames]
        parts.append(
            f'<path class="{name}" d="{values[0]}"><animate attributeName="d" dur="{period:.2f}s" '
            f'repeatCount="indefinite" values="{";".join(values)}"/></path>'
        )
    for wheel in range(4):
        rim = frames[0].wheels[wheel]
        heave = [frame.wheels[wheel].mean(axis=0) - rim.mean(axis=0) for frame in frames]
        steps = ";".join(f"{x * _SCALE:.1f} {y * _SCALE:.1f}" for x, y in heave)
        parts.append(
            f'<g><path class="wheel" d="{_line(rim, closed=True)}"/><animateTransform '
            f'attributeName="transform" type="translate" dur="{period:.2f}s" '
            f'repeatCount="indefinite" values="{steps}"/></g>'
        )
    parts.append(f'</g><g class="car still">{_still(frames[0])}</g>')
    name = escape(shape.title)
    return Markup(f'<svg viewBox="{_BOX}" role="img" aria-label="{name}">{"".join(parts)}</svg>')


def _still(car: Outline) -> str:
    paths = [f'<path class="{name}" d="{path_of(car)}"/>' for name, path_of in _PATHS]
    paths += [f'<path class="wheel" d="{_line(rim, closed=True)}"/>' for rim in car.wheels]
    return "".join(paths)


def _line(points: NDArray[np.float64], closed: bool) -> str:
    text = "L".join(f"{x * _SCALE:.0f} {y * _SCALE:.0f}" for x, y in points)
    return f"M{text}{'Z' if closed else ''}"


def _plates(car: Outline) -> str:
    return _line(car.deck, closed=True) + _line(car.roof, closed=True)


def _pillars(car: Outline) -> str:
    return "".join(
        _line(np.stack(ends), closed=False) for ends in zip(car.deck, car.roof, strict=True)
    )


def _springs(car: Outline) -> str:
    return "".join(_line(spring, closed=False) for spring in car.springs)


_PATHS = (("spring", _springs), ("pillar", _pillars), ("plate", _plates))


# Still --------------------------------------------------------------------------------------------


def still_cars(shapes: Sequence[Shape]) -> Drawing:
    """Return a drawing of the shapes, four in a row: at rest in grey, at the largest in colour."""
    down = max(-(-len(shapes) // _ACROSS), 1)
    return Drawing(WIDTH_IN, _STILL_IN * down, partial(_draw_cars, tuple(shapes)))


def _draw_cars(shapes: tuple[Shape, ...], figure: FigureBase) -> None:
    down = max(-(-len(shapes) // _ACROSS), 1)
    for number, shape in enumerate(shapes):
        axes = figure.add_subplot(down, _ACROSS, number + 1)
        _car(axes, at_rest(shape.geometry), _REST, 0.7)
        _car(axes, outline(shape, 0.0), PALETTE[1], 1.1)
        axes.set_title(f"{shape.title}\n{shape.numbers}", fontsize=6.8, parse_math=False)
        axes.set_aspect("equal")
        axes.set_xlim(-2.15, 2.15)
        axes.set_ylim(1.55, -1.4)
        axes.set_axis_off()
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.88, wspace=0.02, hspace=0.28)


def _car(axes: Axes, car: Outline, colour: str, width: float) -> None:
    for plate in (car.deck, car.roof):
        axes.fill(*plate.T, facecolor=colour, alpha=0.08, edgecolor="none")
        axes.fill(*plate.T, fill=False, edgecolor=colour, lw=width)
    for low, high in zip(car.deck, car.roof, strict=True):
        axes.plot(*zip(low, high, strict=True), color=colour, lw=width * 0.8)
    for spring, wheel in zip(car.springs, car.wheels, strict=True):
        axes.plot(*spring.T, color=colour, lw=width * 0.7)
        axes.plot(*wheel.T, color=INK if colour != _REST else FAINT, lw=width)
