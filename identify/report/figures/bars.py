"""Draws bars and dots of the report: intervals, sources of precision, predictions."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from ...numbers import LARGEST_PERCENT, half_width_percent
from ..panels import ClosedFormPanel, IntervalPanel, PredictionPanel
from .style import FAINT, INK, PALETTE, height_in

_ROW_IN = 0.195
_HEAD_IN, _FOOT_IN = 0.32, 0.62
_LEGEND_IN = 0.17
_ACROSS = 5
_SOURCES = ("#0072b2", "#56b4e9", "#004468", "#d55e00", "#e69f00", "#8a3c00", "#009e73", "#66c2a5",
            "#cc79a7", "#7f7f7f", "#c0c0c0")  # fmt: skip


def bars_height_in(rows: int, legend: int) -> float:
    """Return the height of a number of bars over a legend with a number of entries, inches."""
    return _HEAD_IN + _FOOT_IN + _LEGEND_IN * -(-legend // _ACROSS) + _ROW_IN * rows


def draw_intervals(panel: IntervalPanel, figure: FigureBase) -> None:
    """Draw the relative intervals on the left, and what they rest on, on the right."""
    n = len(panel.names)
    left, right = line_axes(figure, n, (0.075, 0.5))
    # A bar of 2,000 %, of a value near zero, would make all others invisible.
    shown = np.where(panel.half_percent <= LARGEST_PERCENT, panel.half_percent, np.nan)
    _interval_bars(left, shown)
    left.set_yticks(range(n), panel.names)
    for i, half in enumerate(panel.half_percent):
        text = half_width_percent(100.0, 100.0 - half, 100.0 + half)
        text = f" ±{text}" if text else (" may be zero" if half > 0.0 else " not determined")
        left.text(half if half <= LARGEST_PERCENT else 0.0, i, text, va="center", fontsize=7.5)
    left.set_xlim(*_about_zero(shown, 1.9))
    left.set_xlabel("95 % interval about the estimate, %")
    left.set_title("How well each is known")
    start = np.zeros(n)
    for number, kind in enumerate(panel.kinds):
        width = np.nan_to_num(panel.shares[:, number]) * 100.0
        colour = _SOURCES[number % len(_SOURCES)]
        right.barh(range(n), width, 0.62, left=start, color=colour, label=kind, ec="white", lw=0.5)
        start += width
    right.set_xlim(0.0, 100.0)
    right.set_yticks(range(n), [""] * n)
    right.set_xlabel("share of its precision, %")
    right.set_title("What it rests on")
    shared_legend(figure)


def draw_closed_form(panel: ClosedFormPanel, figure: FigureBase) -> None:
    """Draw the results of the paper's chain with the likelihood's intervals."""
    n = len(panel.names)
    (axes,) = line_axes(figure, n, (0.075,))
    _interval_bars(axes, panel.half_percent)
    apart = panel.apart_percent
    axes.plot(apart, range(n), "D", ms=5.0, color=PALETTE[2], label="closed form (paper's chain)")
    axes.plot([], [], "s", ms=8.0, color=PALETTE[1], alpha=0.45, label="likelihood, 95 % interval")
    axes.set_yticks(range(n), panel.names)
    axes.set_xlim(*_about_zero(np.concatenate([apart, panel.half_percent]), 1.1))
    axes.set_xlabel("difference from the likelihood's estimate, %")
    shared_legend(figure)


def draw_predictions(panel: PredictionPanel, figure: FigureBase) -> None:
    """Draw chi2/n of each run, fitted and predicted, with the limit."""
    n = len(panel.runs)
    (axes,) = line_axes(figure, n, (0.19,))
    place = np.arange(n)
    limit = np.where(np.isfinite(panel.limit), panel.limit, 1.0)
    axes.barh(place, limit - 1.0, 0.8, left=1.0, color=FAINT, alpha=0.7, label="noise level")
    axes.hlines(place, panel.fitted, panel.predicted, PALETTE[2], lw=1.4, alpha=0.6)
    axes.plot(panel.fitted, place, "o", ms=5.0, mfc="white", color=PALETTE[1], label="fitted")
    axes.plot(panel.predicted, place, "D", ms=4.5, color=PALETTE[2], label="predicted, left out")
    axes.axvline(1.0, color=INK, lw=0.8)
    axes.set_yticks(place, panel.runs)
    everything = np.concatenate([panel.fitted, panel.predicted, limit])
    high = float(np.nanmax(everything))
    if high > 3.0:
        axes.set_xscale("log")
        axes.set_xlim(0.8, high * 1.3)
    else:
        axes.set_xlim(min(0.9, float(np.nanmin(everything)) - 0.02), max(1.1, high + 0.02))
    axes.set_xlabel("chi2/n of the run's residuals; 1 = noise alone")
    shared_legend(figure)


def line_axes(figure: FigureBase, n: int, left: tuple[float, ...]) -> list[Axes]:
    """Return axes side by side with n lines of text in each, without a layout engine."""
    height = height_in(figure)
    ends = (*[start - 0.05 for start in left[1:]], 0.985)
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


def _interval_bars(axes: Axes, half: np.ndarray) -> None:
    shown = np.where(np.isfinite(half), half, 0.0)
    axes.barh(range(len(half)), 2.0 * shown, 0.55, left=-shown, color=PALETTE[1], alpha=0.45)
    axes.vlines(0.0, -0.5, len(half) - 0.5, INK, lw=0.9)


def _about_zero(values: np.ndarray, room: float) -> tuple[float, float]:
    finite = np.abs(values[np.isfinite(values)])
    reach = float(finite.max(initial=0.0)) or 1.0
    return -1.1 * reach, room * reach
