"""Returns what the artists of a figure hold, as plain numbers."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle


def bars(axes: Axes) -> list[tuple[float, float, float]]:
    """Return left end, right end and middle of the height of each bar, rounded."""
    found = [one for one in axes.patches if isinstance(one, Rectangle)]
    return [
        (
            round(one.get_x(), 9),
            round(one.get_x() + one.get_width(), 9),
            round(one.get_y() + one.get_height() / 2.0, 9),
        )
        for one in found
    ]


def named(axes: Axes, label: str) -> Line2D:
    (line,) = (one for one in axes.lines if one.get_label() == label)
    return line


def points(line: Line2D) -> list[tuple[float, float]]:
    xy = np.asarray(line.get_xydata(), dtype=np.float64)
    return [(float(x), float(y)) for x, y in xy.round(9)]


def segments(axes: Axes) -> list[list[list[float]]]:
    (lines,) = axes.collections
    return [np.asarray(path.vertices).round(9).tolist() for path in lines.get_paths()]


def ticks(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_yticklabels()]


def legend(axes: Axes) -> list[str]:
    (one,) = axes.figure.legends
    return [text.get_text() for text in one.get_texts()]


def upright(axes: Axes) -> list[float]:
    """Return where lines over the whole height of the diagram stand."""
    found = [points(line) for line in axes.lines if len(points(line)) == 2]
    return [a for (a, low), (b, high) in found if a == b and (low, high) == (0.0, 1.0)]
