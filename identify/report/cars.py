"""A wire car in perspective that moves as a mode does: as moving SVG, and as a still."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from daq.vehicle import VehicleGeometry

from .page import FAINT, INK, PALETTE, WIDTH_IN, MovingCars, Picture, Shape

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

Floats = NDArray[np.float64]

_DECK_M, _ROOF_M, _HUB_M = 0.62, 1.25, 0.32
_OVERHANG_M = 0.55
_EYE = np.array([5.2, 5.6, 3.1])
"""Position of the viewer, m from the middle of the car: in front, left, above."""
_DISTANCE_M = float(np.linalg.norm(_EYE))
_BACK = _EYE / _DISTANCE_M
_RIGHT = np.array([-_EYE[1], _EYE[0], 0.0]) / np.hypot(_EYE[0], _EYE[1])
_UP = np.cross(_BACK, _RIGHT)

_FRAMES = 20
_SCALE = 100.0  # of the drawing, units a metre
_SLOWEST_HZ, _PERIOD_S = 1.0, 2.4
"""Frequency, Hz, of a mode that has this period, s, on the screen; half the period at ten times the
frequency."""

_ACROSS = 4


@dataclass(frozen=True, slots=True)
class Outline:
    """The car at one instant, projected: lines of points, (k, 2), x to the right, y down, m."""

    plates: tuple[Floats, Floats]
    """Corners of the two plates of the body, around, each closed by its first."""
    springs: Floats
    """Lines from body to hub at each wheel, shape (4, k, 2)."""
    wheels: Floats
    """Their rims, shape (4, k, 2)."""

    @property
    def pillars(self) -> list[Floats]:
        """Lines between the corners of both plates."""
        return [np.stack(ends) for ends in zip(*(plate[:4] for plate in self.plates), strict=True)]


def shape_of(
    title: str,
    numbers: str,
    frequency_hz: float,
    shape: NDArray[np.complex128],
    geometry: VehicleGeometry,
) -> Shape:
    """Scale and turn a displacement shape, (7,), so that it can be seen."""
    lift = np.zeros((8, 7))  # of body corners and wheels by the degrees of freedom
    lift[:4, 0] = 1.0
    lift[:4, 1:3] = _corners(geometry) * [-1.0, 1.0]
    lift[4:, 3:] = np.eye(4)
    points = lift @ shape
    turn = np.exp(-0.5j * np.angle(np.sum(points**2)))
    lift_m = 0.22  # of the point that moves most: large enough to see
    motion = shape * turn * lift_m / np.max(np.abs(points))
    return Shape(title, numbers, frequency_hz, np.asarray(motion), geometry)


def outline(shape: Shape, phase: float) -> Outline:
    """Return the car at a phase of the motion, rad; damping is left out."""
    return _outline(shape.geometry, (shape.motion * np.exp(1j * phase)).real)


def at_rest(geometry: VehicleGeometry) -> Outline:
    """Return the car standing still."""
    return _outline(geometry, np.zeros(7))


def _corners(g: VehicleGeometry) -> Floats:
    """Return where the wheels are, (4, 2), order `daq.vehicle.Corner`."""
    return np.array([[g.a, g.t_f], [g.a, -g.t_f], [-g.b, g.t_r], [-g.b, -g.t_r]])


def _outline(g: VehicleGeometry, x: Floats) -> Outline:
    front, rear = g.a + _OVERHANG_M, -g.b - _OVERHANG_M
    wide = max(g.t_f, g.t_r) + 0.08
    around = np.array([[front, wide], [front, -wide], [rear, -wide], [rear, wide]])
    cabin = around * [[0.2, 0.8], [0.2, 0.8], [0.7, 0.8], [0.7, 0.8]]

    def body(points: Floats, height: float) -> Floats:
        return np.asarray(height + x[0] - points[:, 0] * x[1] + points[:, 1] * x[2])

    plates = [
        np.column_stack([p, body(p, height)])[[0, 1, 2, 3, 0]]
        for p, height in ((around, _DECK_M), (cabin, _ROOF_M))
    ]
    corners, hub = _corners(g), _HUB_M + x[3:]
    turn = np.linspace(0.0, 2.0 * np.pi, 25)
    rim = 0.31 * np.stack([np.cos(turn), np.zeros(25), np.sin(turn)], axis=1)
    middle = np.array([(g.a - g.b) / 2.0, 0.0, 0.45])
    deck, roof = (_seen(plate, middle) for plate in plates)
    return Outline(
        (deck, roof),
        _seen(_coils(corners, hub, body(corners, _DECK_M)), middle),
        _seen(np.column_stack([corners, hub])[:, None] + rim, middle),
    )


def _coils(corners: Floats, low: Floats, high: Floats) -> Floats:
    """Return a zigzag from hub to body at each corner, (4, k, 3)."""
    n = 12  # points of five coils and two straight ends
    up = np.linspace(0.0, 1.0, n)
    aside = 0.05 * np.where(np.arange(n) % 2, 1.0, -1.0)
    aside[[0, -1]] = 0.0
    x, y, low, high = corners[:, :1], corners[:, 1:], low[:, None], high[:, None]
    return np.stack(np.broadcast_arrays(x + aside, y, low + (high - low) * up), axis=2)


def _seen(points: Floats, middle: Floats) -> Floats:
    """Project points, (.., 3), onto the plane through the middle of the car, (.., 2)."""
    off = points - middle
    scale = _DISTANCE_M / (_DISTANCE_M - off @ _BACK)
    return np.stack([off @ _RIGHT * scale, -(off @ _UP) * scale], axis=-1)


# Moving, without a script: SVG with SMIL ----------------------------------------------------------


def moving_car(shape: Shape) -> Markup:
    """Return an SVG of the car in endless motion, with the car at rest behind it.

    Faster modes move faster, but far more slowly than the real car.
    """
    period = _PERIOD_S * (max(shape.frequency_hz, 0.1) / _SLOWEST_HZ) ** -0.3
    frames = [outline(shape, 2.0 * np.pi * k / _FRAMES) for k in range(_FRAMES)]
    frames.append(frames[0])
    forever = f'dur="{period:.2f}s" repeatCount="indefinite"'
    parts = [f'<g class="rest">{_still(at_rest(shape.geometry))}</g>', '<g class="car moving">']
    paths = [_paths(frame) for frame in frames]
    for name in paths[0]:
        values = [path[name] for path in paths]
        parts.append(
            f'<path class="{name}" d="{values[0]}"><animate attributeName="d" {forever} '
            f'values="{";".join(values)}"/></path>'
        )
    for wheel in range(4):
        rim = frames[0].wheels[wheel]
        heave = [frame.wheels[wheel].mean(axis=0) - rim.mean(axis=0) for frame in frames]
        steps = ";".join(f"{x * _SCALE:.1f} {y * _SCALE:.1f}" for x, y in heave)
        parts.append(
            f'<g><path class="wheel" d="{_line(rim)}"/><animateTransform '
            f'attributeName="transform" type="translate" {forever} values="{steps}"/></g>'
        )
    parts.append(f'</g><g class="car still">{_still(frames[0])}</g>')
    name = escape(shape.title)
    return Markup(
        f'<svg viewBox="-218 -142 436 300" role="img" aria-label="{name}">{"".join(parts)}</svg>'
    )


def _still(car: Outline) -> str:
    paths = [f'<path class="{name}" d="{path}"/>' for name, path in _paths(car).items()]
    return "".join(paths + [f'<path class="wheel" d="{_line(rim)}"/>' for rim in car.wheels])


def _paths(car: Outline) -> dict[str, str]:
    lines: dict[str, Iterable[Floats]] = {
        "spring": car.springs,
        "pillar": car.pillars,
        "plate": car.plates,
    }
    return {name: "".join(_line(line) for line in some) for name, some in lines.items()}


def _line(points: Floats) -> str:
    return "M" + "L".join(f"{x * _SCALE:.0f} {y * _SCALE:.0f}" for x, y in points)


# Still --------------------------------------------------------------------------------------------


def still_cars(cars: MovingCars) -> Picture:
    """Return the shapes, four in a row: at rest in grey, at the largest in colour."""
    down = max(-(-len(cars.shapes) // _ACROSS), 1)
    caption = "At the largest motion; grey: at rest."
    draw = partial(_draw_cars, cars.shapes)
    return Picture(cars.key, cars.title, caption, WIDTH_IN, 1.55 * down, draw)


def _draw_cars(shapes: Sequence[Shape], figure: FigureBase) -> None:
    down = max(-(-len(shapes) // _ACROSS), 1)
    for i, shape in enumerate(shapes):
        axes = figure.add_subplot(down, _ACROSS, i + 1)
        for car, colour, wheel, width in (
            (at_rest(shape.geometry), "#b8b8b8", FAINT, 0.7),
            (outline(shape, 0.0), PALETTE[1], INK, 1.1),
        ):
            for plate in car.plates:
                axes.fill(*plate.T, facecolor=colour, alpha=0.08, edgecolor="none")
                axes.plot(*plate.T, color=colour, lw=width)
            for pillar in car.pillars:
                axes.plot(*pillar.T, color=colour, lw=width * 0.8)
            for spring, rim in zip(car.springs, car.wheels, strict=True):
                axes.plot(*spring.T, color=colour, lw=width * 0.7)
                axes.plot(*rim.T, color=wheel, lw=width)
        axes.set_title(f"{shape.title}\n{shape.numbers}", fontsize=6.8, parse_math=False)
        axes.set_aspect("equal")
        axes.set_xlim(-2.15, 2.15)
        axes.set_ylim(1.55, -1.4)
        axes.set_axis_off()
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.88, wspace=0.02, hspace=0.28)
