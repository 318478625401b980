"""The result of a study: a table, notes and diagrams, and its figure as SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MARKS = ("|", "o", "o", "D", "s")
_SPREAD = 0.5
"""Share of the distance between two items over which the series of one item are spread."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the table: key in JSON, printed heading with the unit, format of numbers."""

    key: str
    heading: str
    form: str = "+z.2f"


@dataclass(frozen=True, slots=True)
class Curve:
    """A line in a diagram through the points (x, y), each (n,); `hue` indexes the palette."""

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    hue: int = 0
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class CurvePanel:
    """A diagram of curves."""

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Dots:
    """One value for each item of a list, (n,), NaN for none; `reach` ends a line from each."""

    label: str
    values: NDArray[np.float64]
    hue: int
    reach: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class DotPanel:
    """A list of items downwards, each with its values across."""

    title: str
    x_label: str
    items: tuple[str, ...]
    series: tuple[Dots, ...]
    logarithmic: bool = False
    expected: tuple[float, float] | None = None
    """Range in which the values should lie."""


Panel = CurvePanel | DotPanel
Cell = str | float


@dataclass(frozen=True, slots=True)
class Study:
    """A table of rows under columns (NaN where there is no value), notes, and rows of diagrams."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...]
    panels: tuple[tuple[Panel, ...], ...]

    def numbers(self, key: str) -> dict[str, float]:
        """Return the numbers of a column by the first cell of their rows."""
        place = [column.key for column in self.columns].index(key)
        return {str(row[0]): float(row[place]) for row in self.rows}


def rows_of(
    names: Sequence[str | int], *columns: NDArray[np.float64]
) -> tuple[tuple[Cell, ...], ...]:
    """Return the rows of a table from its first column and the others, each (n,) or (n, k)."""
    cells = np.column_stack(columns).tolist()
    return tuple((name, *row) for name, row in zip(names, cells, strict=True))


def percent(
    values: Sequence[float] | NDArray[np.float64], known: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the errors of values in per cent of the true ones, (..., n)."""
    return np.asarray(100.0 * (np.asarray(values) / known - 1.0), dtype=np.float64)


def svg(study: Study) -> str:
    """Draw the panels of a study.

    Returns an SVG document; its text stays text, in DejaVu Sans where this font is installed.
    """
    import matplotlib
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    from ..report.page import SETTINGS

    heights = [
        max(3.2 if isinstance(p, CurvePanel) else 1.3 + 0.3 * len(p.items) for p in row)
        for row in study.panels
    ]
    spaced = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12)
    with matplotlib.rc_context(dict(SETTINGS)):
        figure = Figure(figsize=(9.0, sum(heights)), layout=spaced)
        rows = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
        for row, panels in zip(rows, study.panels, strict=True):
            labels = {panel.y_label for panel in panels if isinstance(panel, CurvePanel)}
            axes = row.subplots(1, len(panels), squeeze=False, sharey=len(labels) == 1)[0]
            for place, panel in zip(axes, panels, strict=True):
                if isinstance(panel, CurvePanel):
                    _draw_curves(place, panel)
                else:
                    _draw_dots(place, panel)
        text = StringIO()
        figure.savefig(text, format="svg", metadata={"Title": study.title, "Date": None})
    return text.getvalue()


def _draw_curves(axes: Axes, panel: CurvePanel) -> None:
    from ..report.page import PALETTE, zero_line

    zero_line(axes)
    axes.set_title(panel.title)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.tick_params(axis="y", labelleft=True)  # to one scale, and legible by itself
    for curve in panel.curves:
        axes.plot(
            curve.x,
            curve.y,
            color=PALETTE[curve.hue],
            linewidth=0.9 if len(curve.x) > 100 else 1.6,  # a signal is drawn thin
            linestyle=(0, (4, 2)) if curve.dashed else "-",
            label=curve.label,
        )
    axes.margins(x=0.0, y=0.06)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, handlelength=1.4)


def _draw_dots(axes: Axes, panel: DotPanel) -> None:
    from matplotlib.ticker import FuncFormatter

    from ..report.page import FAINT, PALETTE

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
    offsets = np.linspace(-_SPREAD, _SPREAD, len(panel.series)) / 2.0 * whiskers
    for series, offset in zip(panel.series, offsets, strict=True):
        place, colour, mark = np.arange(n) + offset, PALETTE[series.hue], _MARKS[series.hue]
        if series.reach is not None:
            axes.hlines(place, series.values, series.reach, colour, lw=1.4, alpha=0.5)
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
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
