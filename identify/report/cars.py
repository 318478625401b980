"""A wire car in perspective that moves as a mode does: as moving SVG, and as a still."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
Lines = Mapping[str, Floats]
"""Lines of points in the picture, each (n_lines, k, 2), x to the right, y down, m, by what they are
of: `spring`, `pillar`, `plate` or `wheel`."""

_EYE = np.array([5.2, 5.6, 3.1])
"""Position of the viewer, m from the middle of the car: in front, left, above."""
_ACROSS = 4  # stills in a row


def shape_of(
    title: str,
    numbers: str,
    frequency_hz: float,
    shape: NDArray[np.complex128],
    geometry: VehicleGeometry,
) -> Shape:
    """Return a displacement shape, (7,), enlarged and turned so that it can be seen."""
    heights = np.zeros((8, 7))  # of body corners and wheels, by each degree of freedom
    heights[:4, 0] = 1.0
    heights[:4, 1:3] = _corners(geometry) * [-1.0, 1.0]
    heights[4:, 3:] = np.eye(4)
    points = heights @ shape
    turn = np.exp(-0.5j * np.angle(np.sum(points**2)))  # makes most of the motion real
    largest_m = 0.22  # of the point that moves most: large enough to see
    motion = shape * turn * largest_m / np.max(np.abs(points))
    return Shape(title, numbers, frequency_hz, np.asarray(motion), geometry)


def _corners(g: VehicleGeometry) -> Floats:
    """Return x and y of the wheels from the CG, (4, 2) m, order `daq.vehicle.Corner`."""
    return np.array([[g.a, g.t_f], [g.a, -g.t_f], [-g.b, g.t_r], [-g.b, -g.t_r]])


def outline(g: VehicleGeometry, displacement: Floats) -> Lines:
    """Return the lines of the car displaced by (7,), m and rad, of `daq.vehicle.DOF`."""
    deck_m, roof_m, hub_m, overhang_m, rim_m = 0.62, 1.25, 0.32, 0.55, 0.31  # usual
    heave, pitch, roll, *hub_heaves = displacement.tolist()
    front, rear = g.a + overhang_m, -g.b - overhang_m
    side = max(g.t_f, g.t_r) + 0.08
    deck = np.array([[front, side], [front, -side], [rear, -side], [rear, side]])
    roof = deck * [[0.2, 0.8], [0.2, 0.8], [0.7, 0.8], [0.7, 0.8]]

    def body(points: Floats, height_m: float) -> Floats:
        z = height_m + heave - points[:, 0] * pitch + points[:, 1] * roll
        return np.column_stack([points, z])

    plates = np.array([body(deck, deck_m), body(roof, roof_m)])
    corners = _corners(g)
    hubs = np.column_stack([corners, hub_m + np.array(hub_heaves)])
    seats = body(corners, deck_m)  # upper ends of the springs
    n = 12  # points of a spring: five coils and two straight ends
    aside_m = 0.05 * np.where(np.arange(n) % 2, 1.0, -1.0)
    aside_m[[0, -1]] = 0.0
    springs = hubs[:, None] + (seats - hubs)[:, None] * np.linspace(0.0, 1.0, n)[:, None]
    springs[..., 0] += aside_m
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    rim = rim_m * np.stack([np.cos(angle), np.zeros(25), np.sin(angle)], axis=1)
    lines = {
        "spring": springs,
        "pillar": plates.swapaxes(0, 1),
        "plate": plates[:, [0, 1, 2, 3, 0]],
        "wheel": hubs[:, None] + rim,
    }
    middle = np.array([(g.a - g.b) / 2.0, 0.0, 0.45])
    return {name: _projected(points - middle) for name, points in lines.items()}


def _projected(points: Floats) -> Floats:
    """Project points, (.., 3), onto the plane through the middle of the car, (.., 2)."""
    distance_m = float(np.linalg.norm(_EYE))
    back = _EYE / distance_m
    right = np.array([-_EYE[1], _EYE[0], 0.0]) / np.hypot(_EYE[0], _EYE[1])
    scale = distance_m / (distance_m - points @ back)
    return np.stack([points @ right * scale, -(points @ np.cross(back, right)) * scale], axis=-1)


def moving_car(shape: Shape) -> Markup:
    """Return an SVG of the car in endless motion, with the car at rest behind it; it has no script.

    Faster modes move faster, but far more slowly than the real car: 1 Hz in 2.4 s, ten times that
    in half the time.
    """
    period_s = 2.4 * max(shape.frequency_hz, 0.1) ** -0.3
    frames = [outline(shape.geometry, shape.displacement(2.0 * np.pi * k / 20)) for k in range(20)]
    frames.append(frames[0])
    forever = f'dur="{period_s:.2f}s" repeatCount="indefinite"'
    at_rest = outline(shape.geometry, np.zeros(7))
    parts = [f'<g class="rest">{_still_svg(at_rest)}</g>', '<g class="car moving">']
    for name in ("spring", "pillar", "plate"):
        paths = [_path(frame[name]) for frame in frames]
        parts.append(
            f'<path class="{name}" d="{paths[0]}"><animate attributeName="d" {forever} '
            f'values="{";".join(paths)}"/></path>'
        )
    for wheel, rim in enumerate(frames[0]["wheel"]):
        moves = [(frame["wheel"][wheel] - rim).mean(axis=0) * 100.0 for frame in frames]
        steps = ";".join(f"{x:.1f} {y:.1f}" for x, y in moves)
        parts.append(
            f'<g><path class="wheel" d="{_path([rim])}"/><animateTransform '
            f'attributeName="transform" type="translate" {forever} values="{steps}"/></g>'
        )
    parts.append(f'</g><g class="car still">{_still_svg(frames[0])}</g>')
    name = escape(shape.title)
    return Markup(
        f'<svg viewBox="-218 -142 436 300" role="img" aria-label="{name}">{"".join(parts)}</svg>'
    )


def _still_svg(car: Lines) -> str:
    return "".join(f'<path class="{name}" d="{_path(lines)}"/>' for name, lines in car.items())


def _path(lines: Iterable[Floats]) -> str:
    """Return lines as the data of an SVG path, 100 units a metre."""
    return "".join(
        "M" + "L".join(f"{x:.0f} {y:.0f}" for x, y in (line * 100.0).tolist()) for line in lines
    )


def still_cars(cars: MovingCars) -> Picture:
    """Return the shapes, four in a row: at rest in grey, at the largest in colour."""
    down = max(-(-len(cars.shapes) // _ACROSS), 1)
    caption = "At the largest motion; grey: at rest."
    draw = partial(_draw_cars, cars.shapes, down)
    return Picture(cars.key, cars.title, caption, WIDTH_IN, 1.55 * down, draw)


def _draw_cars(shapes: Iterable[Shape], down: int, figure: FigureBase) -> None:
    widths = {"plate": 1.0, "pillar": 0.8, "spring": 0.7, "wheel": 1.0}
    for i, shape in enumerate(shapes):
        axes = figure.add_subplot(down, _ACROSS, i + 1)
        for displacement, colour, wheel_colour, width in (
            (np.zeros(7), "#b8b8b8", FAINT, 0.7),
            (shape.displacement(0.0), PALETTE[1], INK, 1.1),
        ):
            car = outline(shape.geometry, displacement)
            for plate in car["plate"]:
                axes.fill(*plate.T, facecolor=colour, alpha=0.08, edgecolor="none")
            for name, share in widths.items():
                hue = wheel_colour if name == "wheel" else colour
                for line in car[name]:
                    axes.plot(*line.T, color=hue, lw=width * share)
        axes.set_title(f"{shape.title}\n{shape.numbers}", fontsize=6.8, parse_math=False)
        axes.set_aspect("equal")
        axes.set_xlim(-2.15, 2.15)
        axes.set_ylim(1.55, -1.4)
        axes.set_axis_off()
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.88, wspace=0.02, hspace=0.28)
