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


class HomeScreen(BumpingScreen):
    """Shows the next action, how to bump, progress, runs and journal."""

    HELP_PAGE: ClassVar[str] = "home"

    def compose_body(self) -> ComposeResult:
        """Compose the next action and the lists."""
        glyphs = self.bench_app.glyphs
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield NextPanel(glyphs)
                yield LaneChart(glyphs)
                yield RunList(glyphs)
            with Vertical(id="right"):
                yield SketchBox()
                yield TallyList(glyphs)
                yield Journal()
        yield AlarmList(glyphs)

    def on_mount(self) -> None:
        """Show immediately that the terminal waits for a recorder."""
        self.show_next()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Hide Esc while nothing is armed, because it would only return here."""
        status = self.bench_app.status
        if (action, parameters) == ("press", ("pause",)) and status and status.phase in AT_EASE:
            return False
        return super().check_action(action, parameters)

    def show_status(self, status: Status) -> None:
        """Show the sketch too."""
        super().show_status(status)
        self.query_one(SketchBox).show(status, self.bench_app.bench)

    def show_next(self) -> None:
        """Show it in its panel."""
        app = self.bench_app
        self.query_one(NextPanel).show(app.status, self._next, app.lost)

    def action_view(self) -> None:
        """Switch between sketch and runs where there is no room for both."""
        self.toggle_class("-runs")
