"""Differences between sessions, and their trend."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import FigureBase

from ..panels import DifferencePanel, TrendPanel
from .bars import line_axes, shared_legend
from .style import INK, PALETTE


def draw_differences(panel: DifferencePanel, figure: FigureBase) -> None:
    """Draw each difference with its interval; significant ones by another mark."""
    n = len(panel.names)
    (axes,) = line_axes(figure, n, (0.09,))
    place = np.arange(n)
    axes.hlines(
        place, panel.percent - panel.half_percent, panel.percent + panel.half_percent,
        PALETTE[1], lw=4.0, alpha=0.35,
    )  # fmt: skip
    for chosen, mark, hue, label in (
        (panel.significant, "D", 2, "differs"),
        (~panel.significant, "o", 1, "within chance"),
    ):
        axes.plot(
            panel.percent[chosen], place[chosen], mark, ms=4.5, color=PALETTE[hue], label=label
        )
    axes.axvline(0.0, color=INK, lw=0.8)
    axes.set_yticks(place, panel.names)
    axes.set_xlabel("difference, % of the first session's value")
    shared_legend(figure)


def draw_trend(panel: TrendPanel, figure: FigureBase) -> None:
    """Draw values with their intervals, and the weighted line."""
    axes = figure.add_axes((0.2, 0.2, 0.77, 0.74))
    order = np.arange(1, len(panel.values) + 1)
    axes.errorbar(
        order, panel.values, yerr=panel.half, fmt="o", ms=3.5, color=PALETTE[1], lw=1.0, capsize=2.0
    )
    weight = panel.half**-2.0
    middle = float(weight @ order / weight.sum())
    level = float(weight @ panel.values / weight.sum())
    axes.plot(order, level + panel.slope * (order - middle), color=PALETTE[2], lw=1.0)
    axes.ticklabel_format(useOffset=False)
    axes.set_xticks(order[:: max(len(order) // 8, 1)])
    axes.set_xlabel("session", labelpad=1.0)
    axes.set_ylabel(panel.unit)
    axes.margins(x=0.08)
