"""Mode shapes of the car, still: at rest in grey, at the largest motion in colour."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from ..panels import ShapePanel
from ..shapes import Outline, at_rest, outline
from .style import FAINT, INK, PALETTE

_ACROSS = 4
_ROW_IN = 1.55


def shapes_height_in(shapes: int) -> float:
    """Return the height of a number of shapes, inches."""
    return _ROW_IN * max(-(-shapes // _ACROSS), 1)


def draw_shapes(panel: ShapePanel, figure: FigureBase) -> None:
    """Draw the shapes four in a row."""
    down = max(-(-len(panel.shapes) // _ACROSS), 1)
    for number, shape in enumerate(panel.shapes):
        axes = figure.add_subplot(down, _ACROSS, number + 1)
        _car(axes, at_rest(shape.geometry), "#b8b8b8", 0.7)
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
        axes.plot(*wheel.T, color=INK if colour != "#b8b8b8" else FAINT, lw=width)
