"""Style of the figures: colours that the colour-blind can distinguish, thin axes, no frame."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

PALETTE = ("#7f7f7f", "#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Grey for what is compared with, then four of Okabe and Ito's colours."""

INK = "#262626"
FAINT = "#d9d9d9"

SETTINGS: Mapping[Any, Any] = MappingProxyType(
    {
        "font.family": "DejaVu Sans",
        "font.size": 9.0,
        "axes.titlesize": 10.0,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.labelcolor": INK,
        "axes.edgecolor": INK,
        "axes.linewidth": 0.8,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "text.color": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "svg.fonttype": "none",  # text stays text, which can be searched and read aloud
        "svg.hashsalt": "bumpbench",  # so that the same study gives the same bytes
    }
)


def zero_line(axes: Axes) -> None:
    """Mark zero without competing with the data."""
    axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)


def height_in(figure: FigureBase) -> float:
    """Return the height of a figure, or of a part of one, in inches."""
    box = figure.get_window_extent()
    return float(box.height / figure.figure.dpi)  # of the whole; get_figure(root=True) is of 3.10
