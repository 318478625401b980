"""The stabilisation diagram."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import FigureBase

from ..panels import StabilisationPanel
from .style import FAINT, PALETTE


def draw_stabilisation(panel: StabilisationPanel, figure: FigureBase) -> None:
    """Draw frequency across and rank upwards; stable poles are emphasised."""
    axes = figure.add_axes((0.125, 0.155, 0.86, 0.75))
    for mode in panel.modes_hz:
        axes.axvline(float(mode), color=PALETTE[2], lw=0.8, alpha=0.7)
    top = 1.35 * float(panel.modes_hz.max(initial=1.0))
    shown = (panel.frequency_hz > 0.0) & (panel.frequency_hz < top)
    loose, stable = shown & ~panel.stable, shown & panel.stable
    axes.plot(panel.frequency_hz[loose], panel.rank[loose], "x", ms=2.6, mew=0.5, color="#a8a8a8")
    axes.plot(panel.frequency_hz[stable], panel.rank[stable], "o", ms=2.4, mew=0, color=PALETTE[1])
    axes.set_xscale("log")
    low = 0.6 * float(panel.modes_hz.min(initial=1.0))
    axes.set_xlim(low, top)
    ticks = [t for t in (0.5, 1, 2, 3, 5, 7, 10, 15, 20, 30) if low <= t <= top]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.set_ylim(0.0, float(np.max(panel.rank, initial=1.0)) + 1.0)
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("rank")
    axes.grid(axis="y", color=FAINT, lw=0.4)
    handles = [
        axes.plot([], [], "o", ms=4.0, mew=0, color=PALETTE[1], label="recurs")[0],
        axes.plot([], [], "x", ms=4.0, color="#a8a8a8", label="does not")[0],
        axes.plot([], [], "-", lw=1.0, color=PALETTE[2], label="identified mode")[0],
    ]
    figure.legend(
        handles=handles, loc="upper right", ncols=3, frameon=False, fontsize=7.0, handlelength=1.2,
        borderaxespad=0.1, columnspacing=1.2,
    )  # fmt: skip
