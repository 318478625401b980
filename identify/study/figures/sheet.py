"""A study on one sheet: its panels in rows."""

from __future__ import annotations

from io import StringIO

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from ...report.figure import SETTINGS
from ..result import CurvePanel, DotPanel, Panel, Study
from .curves import draw_curves
from .dots import draw_dots

_WIDTH_IN = 9.0
_CURVES_IN = 3.2
_ITEM_IN = 0.3


def svg(study: Study) -> str:
    """Draw the panels of a study.

    Returns an SVG document; its text stays text, in DejaVu Sans where this font is installed.
    """
    with matplotlib.rc_context(dict(SETTINGS)):
        text = StringIO()
        _sheet(study).savefig(text, format="svg", metadata={"Title": study.title, "Date": None})
    return text.getvalue()


def _sheet(study: Study) -> Figure:
    heights = [max(_height_in(panel) for panel in row) for row in study.panels]
    spaced = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12)
    figure = Figure(figsize=(_WIDTH_IN, sum(heights)), layout=spaced)
    rows = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    for row, panels in zip(rows, study.panels, strict=True):
        axes = row.subplots(1, len(panels), squeeze=False, sharey=_same_scale(panels))[0]
        for place, panel in zip(axes, panels, strict=True):
            _draw(place, panel)
    return figure


def _height_in(panel: Panel) -> float:
    return _CURVES_IN if isinstance(panel, CurvePanel) else 1.3 + _ITEM_IN * len(panel.items)


def _same_scale(panels: tuple[Panel, ...]) -> bool:
    """Return True if the panels of a row measure the same; they are then drawn to one scale."""
    labels = {panel.y_label for panel in panels if isinstance(panel, CurvePanel)}
    return len(labels) == 1 and all(isinstance(panel, CurvePanel) for panel in panels)


def _draw(axes: Axes, panel: Panel) -> None:
    match panel:
        case CurvePanel():
            draw_curves(axes, panel)
        case DotPanel():
            draw_dots(axes, panel)
