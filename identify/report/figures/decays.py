"""Draws one run: measured against fitted, with the residuals."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator

from ..panels import DecayPanel
from .style import FAINT, INK, PALETTE

_WINDOW = "#eef4f9"
_SPAN = 6.0
"""Range of the residuals that is shown, in standard deviations of the noise, unless the largest
exceeds it."""


def draw_decay(panel: DecayPanel, figure: FigureBase) -> None:
    """Draw each trace, and beneath it its residual in units of the noise."""
    if not panel.traces:
        return
    heights = [part for _ in panel.traces for part in (3.0, 1.15)]
    grid = figure.add_gridspec(
        len(heights), 1, height_ratios=heights, left=0.13, right=0.985, top=0.985, bottom=0.115,
        hspace=0.13,
    )  # fmt: skip
    shared = None
    for number, trace in enumerate(panel.traces):
        hue = PALETTE[1 + number]
        top = figure.add_subplot(grid[2 * number], sharex=shared)
        shared = shared or top
        under = figure.add_subplot(grid[2 * number + 1], sharex=shared)
        for axes in (top, under):
            axes.axvspan(panel.start_s, panel.end_s, color=_WINDOW, lw=0.0, zorder=0)
            axes.tick_params(labelsize=7.0, length=2.5, labelbottom=False)
        top.plot(*trace.measured, color="#9a9a9a", lw=1.5, solid_joinstyle="round")
        top.plot(*trace.fitted, color=hue, lw=0.85)
        top.axvline(panel.start_s, color=INK, lw=0.7)
        if np.isfinite(panel.onset_s):
            top.axvline(panel.onset_s, color=INK, lw=0.7, ls=(0, (2, 2)))
        top.text(
            0.99, 0.95, f"{trace.channel}, {trace.unit}", transform=top.transAxes, ha="right",
            va="top", fontsize=7.5, color=hue, parse_math=False,
        )  # fmt: skip
        top.yaxis.set_major_locator(MaxNLocator(4))
        under.axhspan(-2.0, 2.0, color=FAINT, alpha=0.6, lw=0.0, zorder=0.5)
        under.plot(*trace.residual, color=hue, lw=0.5)
        reach = max(_SPAN, float(np.max(np.abs(trace.residual[1]), initial=0.0)) * 1.05)
        under.set_ylim(-reach, reach)
        under.yaxis.set_major_locator(MaxNLocator(3))
        under.set_ylabel("sigma", fontsize=6.5)
    under.tick_params(labelbottom=True)
    under.set_xlabel("time in the run, s", fontsize=7.5, labelpad=1.5)
    under.set_xlim(float(panel.traces[0].measured[0, 0]), panel.end_s)
