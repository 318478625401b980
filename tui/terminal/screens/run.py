"""The run screen: state and live traces of the run in progress."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical

from daq import Status

from ..state.banner import banner
from ..widgets.banner_bar import BannerBar
from ..widgets.big_word import BigWord
from ..widgets.lane_chart import LaneChart
from ..widgets.lists import AlarmList, Journal, RunList, TallyList
from ..widgets.progress_line import ProgressLine
from .bumping import BumpingScreen
from .live import draw_lanes, live_chart
from .news import LiveArrived, RecorderLost


class RunScreen(BumpingScreen):
    """Banner and lanes; on a wide terminal also progress, runs and journal."""

    HELP_PAGE: ClassVar[str] = "run"

    def __init__(self) -> None:
        super().__init__()
        self._page = 0

    def compose_body(self) -> ComposeResult:
        """Compose the run."""
        glyphs = self.bench_app.glyphs
        yield BigWord(glyphs)
        yield BannerBar(glyphs)
        with Horizontal(id="body"):
            yield live_chart(glyphs)
            with Vertical(id="right"):
                yield TallyList(glyphs)
                yield RunList(glyphs)
                yield Journal()
        yield AlarmList(glyphs)
        yield ProgressLine(glyphs)

    def show_status(self, status: Status) -> None:
        """Show the run."""
        self._show_banner()
        self.query_one(TallyList).show(status)
        self.query_one(RunList).show(status)
        self.query_one(Journal).show(status)
        self.query_one(AlarmList).show(None if self.bench_app.lost else status)
        self.query_one(ProgressLine).show(status)
        self.refresh_bindings()

    def on_live_arrived(self, _: LiveArrived) -> None:
        """Draw the newest samples."""
        draw_lanes(self, self.bench_app, self._page)

    def on_lane_chart_resized(self, _: LaneChart.Resized) -> None:
        """Draw the samples in the chart's new size."""
        draw_lanes(self, self.bench_app, self._page)

    def on_recorder_lost(self, message: RecorderLost) -> None:
        """Show in the banner what to do."""
        super().on_recorder_lost(message)
        self.query_one(AlarmList).show(None)
        self._show_banner()

    def action_view(self) -> None:
        """Show the next group of lanes: body, then each quantity at the wheels."""
        self._page += 1
        draw_lanes(self, self.bench_app, self._page)

    def _show_banner(self) -> None:
        app = self.bench_app
        shown = banner(app.status, app.lost, self._next, app.glyphs)
        self.query_one(BigWord).show(shown, app.signals.big)
        self.query_one(BannerBar).show(shown)
