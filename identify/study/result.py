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

Cell = str | float
Floats = NDArray[np.float64]


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
    x: Floats
    y: Floats
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
    values: Floats
    hue: int
    reach: Floats | None = None


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


@dataclass(frozen=True, slots=True)
class Study:
    """A table of rows under columns (NaN where there is no value), notes, and rows of diagrams."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...]
    panels: tuple[tuple[CurvePanel | DotPanel, ...], ...]


def rows_of(names: Sequence[str | int], *columns: Floats) -> tuple[tuple[Cell, ...], ...]:
    """Return the rows of a table from its first column and the others, each (n,) or (n, k)."""
    cells = np.column_stack(columns).tolist()
    return tuple((name, *row) for name, row in zip(names, cells, strict=True))


def percent(values: Sequence[float] | Floats, known: Floats) -> Floats:
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
            alike = len({p.y_label for p in panels if isinstance(p, CurvePanel)}) == 1
            every = row.subplots(1, len(panels), squeeze=False, sharey=alike)[0]
            for axes, panel in zip(every, panels, strict=True):
                axes.set_xlabel(panel.x_label)
                if isinstance(panel, CurvePanel):
                    _draw_curves(axes, panel)
                else:
                    _draw_dots(axes, panel)
        text = StringIO()
        figure.savefig(text, format="svg", metadata={"Title": study.title, "Date": None})
    return text.getvalue()


def _draw_curves(axes: Axes, panel: CurvePanel) -> None:
    from ..report.page import FAINT, PALETTE

    axes.set_title(panel.title)
    axes.set_ylabel(panel.y_label)
    axes.tick_params(axis="y", labelleft=True)  # to one scale, and legible by itself
    axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
    for curve in panel.curves:
        width = 0.9 if len(curve.x) > 100 else 1.6  # a signal is drawn thin
        style = "--" if curve.dashed else "-"
        axes.plot(curve.x, curve.y, style, color=PALETTE[curve.hue], lw=width, label=curve.label)
    axes.margins(x=0.0, y=0.06)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, handlelength=1.4)


def _draw_dots(axes: Axes, panel: DotPanel) -> None:
    from ..report.page import FAINT, PALETTE

    n = len(panel.items)
    axes.set_title(panel.title, pad=24.0)  # the legend is below it
    axes.set_yticks(range(n), panel.items)
    axes.set_ylim(n - 0.4, -0.6)
    axes.grid(axis="y", color=FAINT, lw=0.6)
    axes.set_axisbelow(True)
    if panel.logarithmic:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
    elif panel.expected is None:
        axes.axvline(0.0, color=FAINT, linewidth=0.8, zorder=0)
    else:
        axes.axvspan(*panel.expected, color=FAINT, alpha=0.6, lw=0.0, label="within chance")
    with_lines = any(series.reach is not None for series in panel.series)
    for i, series in enumerate(panel.series):
        # Series with lines lie below each other within half of an item's height.
        aside = i / (len(panel.series) - 1.0) / 2.0 - 0.25 if with_lines else 0.0
        places, colour = np.arange(n) + aside, PALETTE[series.hue]
        if series.reach is not None:
            axes.hlines(places, series.values, series.reach, colour, lw=1.4, alpha=0.5)
        mark, size, edge = "|ooDs"[series.hue], 4.5, 0.0
        if series.hue == 0:  # what the others are compared with: a tick
            size, edge = 11.0, 2.0
        axes.plot(
            series.values, places, mark, color=colour, ms=size, mew=edge, label=series.label,
            zorder=3,
        )  # fmt: skip
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
