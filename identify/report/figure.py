"""Draws the figures of the report: colours that the colour-blind can distinguish, thin axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO, StringIO
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from .page import Picture

if TYPE_CHECKING:  # slow to load; sections without a figure drawn need none of it
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

PALETTE = ("#7f7f7f", "#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Grey for what is compared with, then four of Okabe and Ito's colours."""

INK = "#262626"
FAINT = "#d9d9d9"

WIDTH_IN = 7.4
"""Width of a page of A4 between its margins, inches."""
HALF_IN = 3.62
_PNG_DPI = 200
_ROW_IN = 0.195
_HEAD_IN, _FOOT_IN = 0.32, 0.62
_LEGEND_IN = 0.17
_ACROSS = 5

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
"""Settings of matplotlib, also for the figures of the studies."""
_SMALL = {**SETTINGS, "font.size": 8.0, "axes.titlesize": 8.5}


def look() -> dict[Any, Any]:
    """Return matplotlib's settings for the figures of a report."""
    return dict(_SMALL)


def figure_of(picture: Picture) -> Figure:
    """Draw on a new matplotlib figure."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(look()):
        figure = Figure(figsize=(picture.width_in, picture.height_in))
        picture.draw(figure)
    return figure


def svg_of(picture: Picture) -> str:
    """Draw an SVG document; its text is text."""
    import matplotlib

    text = StringIO()
    figure = figure_of(picture)
    with matplotlib.rc_context(look()):
        figure.savefig(text, format="svg", metadata={"Title": picture.title, "Date": None})
    return text.getvalue()


def png_of(picture: Picture) -> bytes:
    """Draw a PNG file."""
    data = BytesIO()
    figure_of(picture).savefig(data, format="png", dpi=_PNG_DPI, metadata={"Software": None})
    return data.getvalue()


def zero_line(axes: Axes) -> None:
    """Mark zero without competing with the data."""
    axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)


def height_in(figure: FigureBase) -> float:
    """Return the height of a figure, or of a part of one, in inches."""
    box = figure.get_window_extent()
    return float(box.height / figure.figure.dpi)  # of the whole; get_figure(root=True) is of 3.10


def lines_height_in(rows: int, legend: int) -> float:
    """Return the height of lines of text over a legend with a number of entries, inches."""
    return _HEAD_IN + _FOOT_IN + _LEGEND_IN * -(-legend // _ACROSS) + _ROW_IN * rows


def line_axes(figure: FigureBase, n: int, left: Sequence[float]) -> list[Axes]:
    """Return axes side by side with n lines of text in each, without a layout engine."""
    height = height_in(figure)
    ends = (*[start - 0.05 for start in left[1:]], 0.97)  # half of the last tick's label beyond
    axes = []
    for start, end in zip(left, ends, strict=True):
        top = 1.0 - _HEAD_IN / height
        part = figure.add_axes(
            (start, top - _ROW_IN * n / height, end - start, _ROW_IN * n / height)
        )
        part.set_ylim(n - 0.5, -0.5)
        part.tick_params(axis="y", length=0.0)
        part.spines["left"].set_visible(False)
        axes.append(part)
    return axes


def shared_legend(figure: FigureBase) -> None:
    """Draw the legend of all axes at the bottom."""
    figure.legend(
        loc="lower center", ncols=_ACROSS, frameon=False, fontsize=7.5, handlelength=1.0,
        columnspacing=1.2, borderaxespad=0.0, borderpad=0.1,
    )  # fmt: skip
