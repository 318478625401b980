"""The result of a study: a table, notes and diagrams, and its figure as SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO

import numpy as np
from numpy.typing import NDArray

Cell = str | float
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the table: key in JSON, printed heading with the unit, format of numbers."""

    key: str
    heading: str
    cells: Sequence[Cell] | Floats
    """One for each row; NaN where there is no value."""
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
class Panel:
    """A diagram of curves."""

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Study:
    """A table, notes, and rows of diagrams."""

    title: str
    columns: tuple[Column, ...]
    notes: tuple[str, ...]
    panels: tuple[tuple[Panel, ...], ...] = ()

    @property
    def rows(self) -> tuple[tuple[Cell, ...], ...]:
        """Rows of the table."""
        return tuple(zip(*(np.asarray(c.cells).tolist() for c in self.columns), strict=True))


def percent(values: Sequence[float] | Floats, known: Floats) -> Floats:
    """Return the errors of values in per cent of the true ones, (..., n)."""
    return np.asarray(100.0 * (np.asarray(values) / known - 1.0), dtype=np.float64)


def svg(study: Study) -> str:
    """Draw the panels of a study, which all have the same number in a row.

    Returns an SVG document; its text stays text, in DejaVu Sans where this font is installed.
    """
    import matplotlib
    from matplotlib.figure import Figure

    from ..report.page import FAINT, PALETTE, SETTINGS

    n_rows, n_cols = len(study.panels), len(study.panels[0])
    panels = [panel for row in study.panels for panel in row]
    same_unit = len({panel.y_label for panel in panels}) == 1
    with matplotlib.rc_context(dict(SETTINGS)):
        figure = Figure(figsize=(9.0, 3.2 * n_rows), layout="constrained")
        grid = figure.subplots(n_rows, n_cols, squeeze=False, sharey="row" if same_unit else "none")
        for axes, panel in zip(grid.flat, panels, strict=True):
            axes.set_title(panel.title)
            axes.set_xlabel(panel.x_label)
            axes.set_ylabel(panel.y_label)
            axes.tick_params(axis="y", labelleft=True)  # to one scale, and legible by itself
            axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
            for curve in panel.curves:
                width = 0.9 if len(curve.x) > 100 else 1.6  # a signal is drawn thin
                style = "--" if curve.dashed else "-"
                hue = PALETTE[curve.hue]
                axes.plot(curve.x, curve.y, style, color=hue, lw=width, label=curve.label)
            axes.margins(x=0.0, y=0.06)
            axes.legend(
                loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, handlelength=1.4
            )
        text = StringIO()
        figure.savefig(text, format="svg", metadata={"Title": study.title, "Date": None})
    return text.getvalue()
