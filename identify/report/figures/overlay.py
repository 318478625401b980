"""Draws one run of several sessions, as measured."""

from __future__ import annotations

from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator

from ..panels import OverlayPanel
from .style import PALETTE

_ROW = 0.08
"""Height of a row of the legend, as a share of the figure's."""
_LONGEST = 20
"""Largest number of letters of a session's name: two names fit in a row, also with matplotlib 3.9,
which sets them wider."""


def draw_overlay(panel: OverlayPanel, figure: FigureBase) -> None:
    """Draw the curves over each other, the first session broad and grey beneath."""
    top = 0.9 - _ROW * -(-len(panel.labels) // 2)  # channel and legend are above the curves
    axes = figure.add_axes((0.13, 0.17, 0.855, top - 0.17))
    for number, (label, curve) in enumerate(zip(panel.labels, panel.curves, strict=True)):
        hue = PALETTE[number % len(PALETTE)]
        width = 0.9 if number else 1.9
        short = label if len(label) <= _LONGEST else f"…{label[1 - _LONGEST :]}"
        axes.plot(*curve, color=hue, lw=width, label=short, solid_joinstyle="round")
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.tick_params(labelsize=7.5, length=2.5)
    axes.set_xlabel("time since the start of the decay, s", fontsize=7.5, labelpad=1.5)
    legend = axes.legend(
        title=f"{panel.channel}, {panel.unit}", fontsize=7.5, title_fontsize=7.5, frameon=False,
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1, borderpad=0.1,
        handlelength=1.4, columnspacing=1.0, labelspacing=0.2, alignment="left",
    )  # fmt: skip
    for text in (legend.get_title(), *legend.get_texts()):
        text.set_parse_math(False)
