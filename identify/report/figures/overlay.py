"""One run of several sessions, as measured."""

from __future__ import annotations

from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator

from ..panels import OverlayPanel
from .style import PALETTE


def draw_overlay(panel: OverlayPanel, figure: FigureBase) -> None:
    """Draw the curves over each other, the first session broad and grey beneath."""
    axes = figure.add_axes((0.13, 0.17, 0.855, 0.71))
    for number, (label, curve) in enumerate(zip(panel.labels, panel.curves, strict=True)):
        hue = PALETTE[number % len(PALETTE)]
        width = 0.9 if number else 1.9
        axes.plot(*curve, color=hue, lw=width, label=label, solid_joinstyle="round")
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.tick_params(labelsize=7.5, length=2.5)
    axes.set_xlabel("time since the start of the decay, s", fontsize=7.5, labelpad=1.5)
    # Above the curves, which fill the whole height.
    axes.set_ylabel(f"{panel.channel}, {panel.unit}", fontsize=7.5, parse_math=False)
    legend = axes.legend(
        fontsize=7.5, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98),
        ncols=len(panel.labels), borderaxespad=0.0, handlelength=1.4, columnspacing=1.0,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
