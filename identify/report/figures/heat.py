"""Tables of numbers as colour, with the number in each cell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import FigureBase

from ..panels import CorrelationPanel, SnrPanel
from .style import PALETTE, height_in

_BOTH_WAYS = LinearSegmentedColormap.from_list("both", [PALETTE[1], "#ffffff", PALETTE[2]])
_ONE_WAY = LinearSegmentedColormap.from_list("one", ["#ffffff", "#7fb8d8", "#00507d"])
_HEAD_IN, _ROW_IN = 0.25, 0.215
_DARK = 0.62
"""Share of the range of colours beyond which the number is written in white."""


def heat_height_in(rows: int) -> float:
    """Return the height of a number of rows under a header of up to two lines, inches."""
    return 2.0 * _HEAD_IN + _ROW_IN * rows


def draw_correlation(panel: CorrelationPanel, figure: FigureBase) -> None:
    """Draw the correlation matrix; the diagonal is left out, it is 1."""
    n = len(panel.names)
    height = height_in(figure)
    axes = figure.add_axes((0.07, 0.0, 0.92, 1.0 - _HEAD_IN / height))
    values = np.where(np.eye(n, dtype=bool), np.nan, panel.matrix)
    texts = [[f"{v:+.2f}".replace("0.", ".") if np.isfinite(v) else "" for v in r] for r in values]
    _heat(axes, values, _BOTH_WAYS, (-1.0, 1.0), texts)
    _label(axes, panel.names, panel.names)


def draw_snr(panel: SnrPanel, figure: FigureBase) -> None:
    """Draw runs down and modes across."""
    n, m = len(panel.runs), len(panel.modes)
    height = height_in(figure)
    axes = figure.add_axes((0.19, 0.0, 0.8, 1.0 - 2.0 * _HEAD_IN / height))
    texts = [[f"{v:z.0f}" if np.isfinite(v) else "" for v in row] for row in panel.decibel]
    top = max(float(np.nanmax(panel.decibel, initial=panel.limit_db)), 2.0 * panel.limit_db)
    _heat(axes, panel.decibel, _ONE_WAY, (0.0, top), texts)
    _label(axes, panel.runs, [name.replace(" wheels ", " wheels\n") for name in panel.modes])
    for i in range(n):
        for j in range(m):
            if panel.decibel[i, j] < panel.limit_db:
                axes.plot([j - 0.42], [i], "v", ms=3.0, color=PALETTE[2])


def _heat(
    axes: Axes,
    values: np.ndarray,
    colours: LinearSegmentedColormap,
    limits: tuple[float, float],
    texts: Sequence[Sequence[str]],
) -> None:
    low, high = limits
    n, m = values.shape
    axes.pcolormesh(
        np.arange(m + 1) - 0.5, np.arange(n + 1) - 0.5, np.ma.masked_invalid(values), cmap=colours,
        vmin=low, vmax=high, edgecolors="white", linewidth=0.8,
    )  # fmt: skip
    away = np.abs(values) / max(abs(low), abs(high))
    for i, row in enumerate(texts):
        for j, text in enumerate(row):
            colour = "white" if away[i, j] > _DARK else "#262626"
            axes.text(j, i, text, ha="center", va="center", fontsize=7.0, color=colour)
    axes.set_ylim(n - 0.5, -0.5)


def _label(axes: Axes, rows: Sequence[str], columns: Sequence[str]) -> None:
    axes.set_yticks(range(len(rows)), rows, parse_math=False)
    axes.set_xticks(range(len(columns)), columns, fontsize=8.0)
    axes.xaxis.tick_top()
    axes.tick_params(length=0.0)
    for spine in axes.spines.values():
        spine.set_visible(False)
