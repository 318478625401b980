"""Draws the figures of the report: each kind of panel on a separate figure."""

from __future__ import annotations

from functools import singledispatch
from io import BytesIO, StringIO
from typing import Any

import matplotlib
from matplotlib.figure import Figure, FigureBase

from ..panels import (
    ClosedFormPanel,
    CorrelationPanel,
    DamperPanel,
    DecayPanel,
    DifferencePanel,
    IntervalPanel,
    OverlayPanel,
    Panel,
    PredictionPanel,
    ShapePanel,
    SnrPanel,
    StabilisationPanel,
    TrendPanel,
)
from .bars import bars_height_in, draw_closed_form, draw_intervals, draw_predictions
from .cars import draw_shapes, shapes_height_in
from .dampers import draw_dampers
from .decays import draw_decay
from .differences import draw_differences, draw_trend
from .heat import draw_correlation, draw_snr, heat_height_in
from .overlay import draw_overlay
from .poles import draw_stabilisation
from .style import SETTINGS

WIDTH_IN = 7.4
"""Width of a page of A4 between its margins, inches."""
HALF_IN = 3.62
_PNG_DPI = 200
_SETTINGS = {**SETTINGS, "font.size": 8.0, "axes.titlesize": 8.5}


def size_in(panel: Panel) -> tuple[float, float]:
    """Return the width and height that a panel is made for, inches."""
    match panel:
        case IntervalPanel():
            return WIDTH_IN, bars_height_in(len(panel.names), len(panel.kinds))
        case ClosedFormPanel():
            return WIDTH_IN, bars_height_in(len(panel.names), 2)
        case PredictionPanel():
            return WIDTH_IN, bars_height_in(len(panel.runs), 3)
        case DifferencePanel():
            return WIDTH_IN, bars_height_in(len(panel.names), 2)
        case TrendPanel():
            return HALF_IN, 1.7
        case ShapePanel():
            return WIDTH_IN, shapes_height_in(len(panel.shapes))
        case CorrelationPanel():
            return WIDTH_IN, heat_height_in(len(panel.names))
        case SnrPanel():
            return WIDTH_IN, heat_height_in(len(panel.runs))
        case StabilisationPanel():
            return HALF_IN, 2.7
        case DamperPanel():
            return WIDTH_IN, 2.9
        case DecayPanel():
            return HALF_IN, 2.75
        case OverlayPanel():
            return HALF_IN, 2.0


@singledispatch
def draw(panel: Panel, figure: FigureBase) -> None:
    """Draw a panel on a figure, or on a part of one, of its size.

    `panel`: what is drawn.  `figure`: where, under `rc_context(look())`.
    """
    raise TypeError(f"no drawing of a {type(panel).__name__}")


draw.register(IntervalPanel, draw_intervals)
draw.register(ClosedFormPanel, draw_closed_form)
draw.register(PredictionPanel, draw_predictions)
draw.register(ShapePanel, draw_shapes)
draw.register(DamperPanel, draw_dampers)
draw.register(DecayPanel, draw_decay)
draw.register(OverlayPanel, draw_overlay)
draw.register(DifferencePanel, draw_differences)
draw.register(TrendPanel, draw_trend)
draw.register(CorrelationPanel, draw_correlation)
draw.register(SnrPanel, draw_snr)
draw.register(StabilisationPanel, draw_stabilisation)


def look() -> dict[Any, Any]:
    """Return matplotlib's settings for the figures of a report."""
    return dict(_SETTINGS)


def figure_of(panel: Panel) -> Figure:
    """Draw a panel on a new matplotlib figure."""
    with matplotlib.rc_context(look()):
        figure = Figure(figsize=size_in(panel))
        draw(panel, figure)
    return figure


def panel_svg(panel: Panel, title: str) -> str:
    """Draw a panel as an SVG document; its text is text."""
    text = StringIO()
    figure = figure_of(panel)
    with matplotlib.rc_context(look()):
        figure.savefig(text, format="svg", metadata={"Title": title, "Date": None})
    return text.getvalue()


def panel_png(panel: Panel) -> bytes:
    """Draw a panel as a PNG file."""
    data = BytesIO()
    figure_of(panel).savefig(data, format="png", dpi=_PNG_DPI, metadata={"Software": None})
    return data.getvalue()
