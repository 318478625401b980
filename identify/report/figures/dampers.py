"""Damper force over speed."""

from __future__ import annotations

from matplotlib.figure import FigureBase

from ..panels import DamperPanel
from .style import FAINT, PALETTE


def draw_dampers(panel: DamperPanel, figure: FigureBase) -> None:
    """Draw one curve for each axle, side by side on the same scale."""
    n = len(panel.axles)
    first = None
    for i, one in enumerate(panel.axles):
        left = 0.1 + i * 0.9 / n
        axes = figure.add_axes((left, 0.19, 0.9 / n - 0.07, 0.7), sharey=first)
        first = first or axes
        axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        axes.axvline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        axes.fill_between(one.speed_m_s, one.low_n, one.high_n, color=PALETTE[1], alpha=0.25, lw=0)
        axes.plot(one.speed_m_s, one.force_n, color=PALETTE[1], lw=1.4, label="damper, 95 % band")
        axes.plot(one.speed_m_s, one.total_n, "--", color=PALETTE[2], lw=1.0, label="with friction")
        axes.set_title(one.axle)
        axes.set_xlabel("speed, m/s, compression positive")
        if not i:
            axes.set_ylabel("force, N")
            axes.legend(frameon=False, fontsize=7.5, loc="upper left")
