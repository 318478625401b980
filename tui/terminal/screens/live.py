"""The live chart of a screen, and its drawing."""

from __future__ import annotations

from textual.screen import Screen

from ..context import BenchContext
from ..state.glyphs import Glyphs
from ..state.lane_view import lane_specs, window
from ..widgets.lane_chart import LaneChart


def live_chart(glyphs: Glyphs) -> LaneChart:
    """Return a chart in a frame."""
    chart = LaneChart(glyphs)
    chart.add_class("framed")
    return chart


def draw_lanes(screen: Screen[None], app: BenchContext, page: int = 0) -> None:
    """Draw the newest samples on the chart of a screen, if it is visible."""
    chart = screen.query_one(LaneChart)
    if not chart.display or not chart.size.height:
        return
    specs = lane_specs(app.bench, app.lanes, page, chart.room)
    overloaded = app.status.overloaded if app.status else ()
    chart.show(app.lanes, specs, window(app.status, app.lanes), overloaded)
