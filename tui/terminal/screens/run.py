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


class RunScreen(BumpingScreen):
    """Banner and lanes; on a wide terminal also progress, runs and journal."""

    HELP_PAGE: ClassVar[str] = "run"

    def compose_body(self) -> ComposeResult:
        """Compose the run."""
        glyphs = self.bench_app.glyphs
        yield BigWord(glyphs)
        yield BannerBar(glyphs)
        with Horizontal(id="body"):
            yield LaneChart(glyphs)
            with Vertical(id="right"):
                yield TallyList(glyphs)
                yield RunList(glyphs)
                yield Journal()
        yield AlarmList(glyphs)
        yield ProgressLine(glyphs)

    def show_status(self, status: Status) -> None:
        """Show the progress too."""
        super().show_status(status)
        self.query_one(ProgressLine).show(status)

    def action_view(self) -> None:
        """Show the next group of lanes: body, then each quantity at the wheels."""
        self._page += 1
        self.draw_lanes()

    def show_next(self) -> None:
        """Show it in the banner, with the state."""
        app = self.bench_app
        shown = banner(app.status, app.lost, self._next, app.glyphs)
        self.query_one(BigWord).show(shown, app.signals.big)
        self.query_one(BannerBar).show(shown)
