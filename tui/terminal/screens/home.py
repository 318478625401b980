"""Home: the next action and the progress of the campaign."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical

from daq import Status

from ..widgets.lane_chart import LaneChart
from ..widgets.lists import AlarmList, Journal, RunList, TallyList
from ..widgets.next_panel import NextPanel
from ..widgets.sketch import SketchBox
from .bumping import AT_EASE, BumpingScreen
from .live import draw_lanes, live_chart
from .news import LiveArrived, RecorderLost


class HomeScreen(BumpingScreen):
    """Shows the next action, how to bump, progress, runs and journal."""

    HELP_PAGE: ClassVar[str] = "home"

    def compose_body(self) -> ComposeResult:
        """Compose the next action and the lists."""
        glyphs = self.bench_app.glyphs
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield NextPanel(glyphs)
                yield live_chart(glyphs)
                yield RunList(glyphs)
            with Vertical(id="right"):
                yield SketchBox()
                yield TallyList(glyphs)
                yield Journal()
        yield AlarmList(glyphs)

    def on_mount(self) -> None:
        """Show immediately that the terminal waits for a recorder."""
        self._show_next()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Hide Esc while nothing is armed, because it would only return here."""
        status = self.bench_app.status
        if (action, parameters) == ("press", ("pause",)) and status and status.phase in AT_EASE:
            return False
        return super().check_action(action, parameters)

    def show_status(self, status: Status) -> None:
        """Show the next action and the lists."""
        self._show_next()
        self.query_one(SketchBox).show(status, self.bench_app.bench)
        self.query_one(TallyList).show(status)
        self.query_one(RunList).show(status)
        self.query_one(Journal).show(status)
        self.query_one(AlarmList).show(None if self.bench_app.lost else status)
        self.refresh_bindings()

    def on_live_arrived(self, _: LiveArrived) -> None:
        """Draw the newest samples."""
        draw_lanes(self, self.bench_app)

    def on_lane_chart_resized(self, _: LaneChart.Resized) -> None:
        """Draw the samples in the chart's new size."""
        draw_lanes(self, self.bench_app)

    def on_recorder_lost(self, message: RecorderLost) -> None:
        """Show what to do."""
        super().on_recorder_lost(message)
        self.query_one(AlarmList).show(None)
        self._show_next()

    def _show_next(self) -> None:
        app = self.bench_app
        self.query_one(NextPanel).show(app.status, self._next, app.lost)

    def action_view(self) -> None:
        """Switch between sketch and runs where there is no room for both."""
        self.toggle_class("-runs")
