"""Scales of lanes; colours of a chart; a banner whose text comes before it is laid out."""

from __future__ import annotations

from pathlib import Path

import pytest
from textual.app import App, ComposeResult
from textual.widgets import Static

from daq.bench.config import default_bench_text, parse_bench
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.state.lanes import Lanes, Window, lane_specs
from tui.terminal.state.words import Banner
from tui.terminal.widgets.banner import BannerBar
from tui.terminal.widgets.traces import LaneChart


def test_one_scale_for_each_quantity_at_the_wheels() -> None:
    bench = parse_bench(default_bench_text(), "bench.toml", Path(), dbc_text="")
    specs = {spec.channel: spec.scale for spec in lane_specs(bench, Lanes(), 0, 40)}
    hubs = {specs[f"hub_acc_{corner}"] for corner in ("fl", "fr", "rl", "rr")}
    travels = {specs[f"travel_{corner}"] for corner in ("fl", "fr", "rl", "rr")}
    assert len(hubs) == len(travels) == 1
    assert hubs.isdisjoint(travels)
    assert specs["body_acc_z"] == "body_acc_z"
    assert specs["roll_rate"] != specs["pitch_rate"]


@pytest.mark.parametrize("glyphs", [GlyphSet.ASCII, GlyphSet.BLOCKS])
async def test_a_banner_takes_a_status_before_it_is_laid_out(glyphs: GlyphSet) -> None:
    app: App[None] = App()
    async with app.run_test(size=(80, 24)):
        bar = BannerBar(choose_glyphs(glyphs, {}, "utf-8"))
        bar.show(Banner("good", "+", "ACCEPTED", "bounce 3", "peak 9.1 m/s2", digits="3"))
        await app.mount(bar)
        assert "ACCEPTED" in str(bar.query(Static).first().render())


class Chart(App[None]):
    def compose(self) -> ComposeResult:
        yield LaneChart(choose_glyphs(GlyphSet.ASCII, {}, "utf-8"))


async def test_a_chart_takes_the_colours_of_another_theme() -> None:
    app = Chart()
    async with app.run_test() as pilot:
        chart = app.query_one(LaneChart)
        colours = []
        for theme in ("textual-dark", "textual-light"):
            app.theme = theme
            await pilot.pause()
            (segment,) = chart.render_line(0)
            assert segment.style == chart.rich_style
            colours.append(segment.style)
        assert colours[0] != colours[1]


class _Charted(App[None]):
    """An app of one chart, which counts how often the chart asks for a drawing."""

    asked = 0

    def compose(self) -> ComposeResult:
        """Show the chart."""
        yield LaneChart(choose_glyphs(GlyphSet.ASCII, {}, "utf-8"))

    def on_lane_chart_resized(self) -> None:
        """Count."""
        self.asked += 1


async def test_a_chart_that_shrinks_cuts_its_rows_and_asks_for_new_ones() -> None:
    app = _Charted()
    async with app.run_test(size=(120, 24)) as pilot:
        await pilot.pause()
        chart = app.query_one(LaneChart)
        chart.show(Lanes(), [], Window(0, 8, None), ())
        before = app.asked
        await pilot.resize_terminal(90, 24)
        await pilot.pause()
        assert app.asked > before
        row = chart.render_line(0)
        assert row.cell_length == len(row.text) == 90


def test_the_newest_bin_ends_where_all_bins_before_it_have_passed() -> None:
    lanes = Lanes()
    assert lanes.end_ns == 0
    lanes.bin_s, lanes.end = 0.02, 7
    assert lanes.end_ns == 140_000_000
