"""Values of a list of items as dots, one line an item."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from ...report.figure import FAINT, PALETTE
from ..result import DotPanel

_MARKS = ("|", "o", "o", "D", "s")
_SPREAD = 0.5
"""Share of the distance between two items over which the series of one item are spread."""


def draw_dots(axes: Axes, panel: DotPanel) -> None:
    """Draw a panel with the legend above it, in the order of the series."""
    n = len(panel.items)
    axes.set_title(panel.title, pad=24.0)
    axes.set_xlabel(panel.x_label)
    axes.set_yticks(range(n), panel.items)
    axes.set_ylim(n - 0.4, -0.6)
    axes.tick_params(axis="y", length=0.0)
    axes.hlines(range(n), 0.0, 1.0, FAINT, transform=axes.get_yaxis_transform(), lw=0.6, zorder=0)
    if panel.logarithmic:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    if panel.expected is not None:
        axes.axvspan(*panel.expected, color=FAINT, alpha=0.6, lw=0.0, label="within chance")
    whiskers = any(series.reach is not None for series in panel.series)
    offsets = np.linspace(-_SPREAD, _SPREAD, len(panel.series)) / 2.0 if whiskers else None
    for number, series in enumerate(panel.series):
        place = np.arange(n) + (0.0 if offsets is None else offsets[number])
        colour = PALETTE[series.hue]
        if series.reach is not None:
            axes.hlines(place, series.values, series.reach, colour, lw=1.4, alpha=0.5)
        mark = _MARKS[series.hue]
        axes.plot(
            series.values,
            place,
            mark,
            color=colour,
            markersize=11.0 if mark == "|" else 4.5,
            markeredgewidth=2.0 if mark == "|" else 0.0,
            label=series.label,
            zorder=3,
        )
    if not panel.logarithmic and panel.expected is None:
        low, high = axes.get_xlim()
        axes.set_xlim(min(low, 0.0), max(high, 0.0))
        axes.axvline(0.0, color=FAINT, linewidth=0.8, zorder=0)
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=4,
        frameon=False,
        borderaxespad=0.2,
        handletextpad=0.3,
        columnspacing=1.2,
        borderpad=0.0,
    )
