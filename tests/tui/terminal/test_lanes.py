"""Live traces: history, choice and drawing of lanes, and the banner."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np
import pytest
from textual.app import App, ComposeResult

from daq.bench.config import default_bench_text, parse_bench
from daq.control.messages import Lane, Live, Phase
from tui.terminal.chart import LaneChart, full_scale, pooled, trace
from tui.terminal.feed import RING_S, Lanes, LaneSpec, Window, lane_specs, window
from tui.terminal.form import Field
from tui.terminal.widgets import BannerBar
from tui.terminal.words import Banner, choose_glyphs

from .fake_recorder import BIN_S, FakeRecorder
from .operated import alone, text

BRAILLE = choose_glyphs("braille", {}, "utf-8")
BLOCKS = choose_glyphs("blocks", {}, "utf-8")
ASCII = choose_glyphs("ascii", {}, "utf-8")


def _dots(rows: list[str]) -> np.ndarray:
    """Return which dots of braille rows are set, by Unicode's own numbering."""
    height, width = 4 * len(rows), 2 * len(rows[0])
    dots = np.zeros((height, width), bool)
    for r, row in enumerate(rows):
        for c, char in enumerate(row):
            bits = 0 if char == " " else ord(char) - 0x2800
            for bit, (x, y) in enumerate(
                ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))
            ):
                dots[4 * r + y, 2 * c + x] = bool(bits >> bit & 1)
    return dots


def test_a_spike_of_one_sample_is_drawn_from_its_foot_to_its_tip() -> None:
    low, high = np.zeros(400), np.zeros(400)
    high[137] = 0.99
    seen = _dots(trace(*pooled(low, high, 40), 1.0, 4, BRAILLE))
    column = 137 * 40 // 400
    assert seen[1:9, column].all()
    assert seen[:8].any(axis=0).sum() <= 2  # the column and its neighbour that it is joined to


def test_pooling_keeps_every_extreme_and_repeats_where_bins_are_few() -> None:
    rng = np.random.default_rng(1)
    value = rng.normal(size=301)
    low, high = pooled(value, value, 40)
    assert high.max() == value.max()
    assert low.min() == value.min()
    few, _ = pooled(np.array([1.0, 2.0]), np.array([1.0, 2.0]), 6)
    assert few.tolist() == [1, 1, 1, 2, 2, 2]


def test_the_range_grows_at_once_and_shrinks_late() -> None:
    assert full_scale(0.01, 0.5, 0.0) == 0.5
    assert full_scale(7.3, 0.5, 0.5) == 10.0
    assert full_scale(4.0, 0.5, 10.0) == 10.0
    assert full_scale(3.0, 0.5, 10.0) == 5.0


def _live(first: int, values: list[float | None], channel: str = "a") -> Live:
    return Live(first, BIN_S, (Lane(channel, tuple(values), tuple(values)),))


def test_history_is_rolled_and_gaps_stay_gaps() -> None:
    lanes = Lanes()
    lanes.add(_live(100, [1.0, 2.0]))
    lanes.add(_live(104, [3.0, None]))
    low, high = lanes.window("a", 99, 8)
    expected = [np.nan, 1.0, 2.0, np.nan, np.nan, 3.0, np.nan, np.nan]
    assert np.array_equal(low, expected, equal_nan=True)
    assert np.array_equal(high, expected, equal_nan=True)
    lanes.add(_live(102, [7.0, 8.0]))  # the history that was asked for comes late
    assert lanes.window("a", 100, 6)[0][:5].tolist() == [1.0, 2.0, 7.0, 8.0, 3.0]
    assert lanes.end == 106
    assert np.isnan(lanes.window("b", 100, 4)[0]).all()


def test_history_forgets_what_is_older_than_the_ring_and_begins_anew_after_a_leap() -> None:
    lanes = Lanes()
    size = round(RING_S / BIN_S)
    lanes.add(_live(0, [float(k) for k in range(size + 10)]))
    assert np.isnan(lanes.window("a", 5, 1)[0]).all()
    assert lanes.window("a", size + 9, 1)[0].tolist() == [size + 9.0]
    lanes.add(_live(50 * size, [5.0]))
    assert np.isnan(lanes.window("a", 50 * size - 100, 100)[0]).all()
    lanes.clear()
    assert lanes.end == 0
    assert lanes.channels == ()


def test_lanes_come_in_whole_groups_and_v_begins_with_another() -> None:
    recorder = FakeRecorder()
    lanes = Lanes()
    first = [spec.channel for spec in lane_specs(recorder.bench, lanes, 0, 8)]
    second = [spec.channel for spec in lane_specs(recorder.bench, lanes, 1, 4)]
    assert first[:3] == ["body_acc_z", "roll_rate", "pitch_rate"]
    assert len(first) == 7
    assert second == ["hub_acc_fl", "hub_acc_fr", "hub_acc_rl", "hub_acc_rr"]
    labels = [spec.label for spec in lane_specs(recorder.bench, lanes, 1, 8)]
    assert len(set(labels)) == 8


def test_a_run_stands_still_while_it_is_recorded() -> None:
    recorder, lanes = FakeRecorder(), Lanes()
    recorder.bump()
    lanes.add(recorder.live())
    held = window(recorder.status, lanes)
    assert held.trigger == pytest.approx(1 / 6, abs=0.01)
    rolling = window(replace(recorder.status, phase=Phase.ARMED), lanes)
    assert rolling.first_bin + rolling.count == lanes.end
    assert window(None, lanes).trigger is None


def test_one_scale_for_each_quantity_at_the_wheels() -> None:
    bench = parse_bench(default_bench_text(), "bench.toml", Path(), dbc_text="")
    specs = {spec.channel: spec.scale for spec in lane_specs(bench, Lanes(), 0, 40)}
    hubs = {specs[f"hub_acc_{corner}"] for corner in ("fl", "fr", "rl", "rr")}
    travels = {specs[f"travel_{corner}"] for corner in ("fl", "fr", "rl", "rr")}
    assert len(hubs) == len(travels) == 1
    assert hubs.isdisjoint(travels)
    assert specs["body_acc_z"] == "body_acc_z"
    assert specs["roll_rate"] != specs["pitch_rate"]


class _Charted(App[None]):
    """An app of one chart, which counts how often the chart asks for a drawing."""

    asked = 0

    def compose(self) -> ComposeResult:
        """Show the chart."""
        yield LaneChart(choose_glyphs("ascii", {}, "utf-8"))

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


S = 1_000_000_000


@pytest.mark.parametrize(
    ("done", "planned", "mark", "bar"),
    [
        (0, 5, "", "....."), (2, 5, "", "##..."), (5, 5, "", "#####"), (7, 5, "", "#####"),
        (2, 5, ">", "##>.."), (5, 5, ">", "#####"), (0, 0, "", ""),
        (5, 20, "", "##........"), (19, 20, ">", "#########>"), (10, 10, "", "##########"),
    ],
)  # fmt: skip
def test_a_bar_has_a_piece_for_each_run_and_ten_at_most(
    done: int, planned: int, mark: str, bar: str
) -> None:
    assert ASCII.bar(done, planned, mark) == bar


@pytest.mark.parametrize(
    ("terminal", "encoding", "chosen"),
    [
        ({"TERM": "vt100"}, "utf8", "blocks"),
        ({"TERM": "vt220"}, "utf-16", "blocks"),
        ({"TERM": "dumb"}, "UTF-8", "blocks"),
        ({}, "utf-8", "braille"),
        ({"OS": "Linux"}, "utf-8", "braille"),
        ({}, "latin-1", "ascii"),
    ],
)
def test_the_best_set_is_chosen_that_the_terminal_shows(
    terminal: dict[str, str], encoding: str, chosen: str
) -> None:
    assert choose_glyphs("auto", terminal, encoding).name == chosen


def test_lanes_have_units_for_people_and_a_smallest_range() -> None:
    bench = FakeRecorder().bench
    specs = {spec.channel: spec for spec in lane_specs(bench, Lanes(), 0, 40)}
    travel, body, rate = (specs[name] for name in ("travel_fl", "body_acc_z", "roll_rate"))
    assert (travel.label, travel.unit, travel.factor, travel.least) == (
        "travel FL", "mm", 1000.0, 2.0,
    )  # fmt: skip
    assert (body.label, body.unit, body.factor, body.least) == ("body", "m/s2", 1.0, 0.5)
    assert (rate.label, rate.unit, rate.least) == ("roll", "rad/s", 0.05)
    assert len(lane_specs(bench, Lanes(), 0, 2)) == 2
    assert [s.channel for s in lane_specs(bench, Lanes(), 3, 3)] == [
        s.channel for s in lane_specs(bench, Lanes(), 0, 3)
    ]


def chart_rows(chart: LaneChart, height: int) -> list[str]:
    return [chart.render_line(y).text.rstrip() for y in range(height)]


async def test_a_chart_has_labels_scales_peaks_and_the_triggers_sign() -> None:
    lanes = Lanes()
    level = (1.0,) * 20 + (1.225,) + (1.0,) * 19
    low = tuple(value - 0.05 for value in level)
    lanes.add(Live(100, 0.1, (Lane("a", low, level), Lane("b", (nan,) * 40, (nan,) * 40))))
    specs = [
        LaneSpec("a", "body", "m/s2", 1.0, 0.1, "a"),
        LaneSpec("b", "travel FL", "mm", 1000.0, 2.0, "travel"),
    ]
    chart = LaneChart(ASCII)
    async with alone(chart, 64, 9) as _:
        assert chart.room == 2
        chart.show(lanes, specs, Window(100, 40, 0.5), ("b",))
        rows = chart_rows(chart, 9)
    # 64 less 11 of the label, 12 of the scale and one: 40 columns of a bin each, the bump at 20.
    assert [row[:11].rstrip() for row in rows] == [
        "", "", "body", "", "^ OVERLOAD", "", "travel FL", "", ""
    ]  # fmt: skip
    assert [row[11:12] for row in rows] == ["|"] * 8 + [""]
    # The middle of the envelope, 0.975, is rest: the peak is 1.225 less that.
    assert [row[52:].strip() for row in rows[:8]] == [
        "+0.5", "", "0.25 m/s2", "", "+2 all", "", "no data", ""
    ]  # fmt: skip
    assert [row[32] for row in rows[4:8]] == [":"] * 4
    assert rows[2][12:52].count("-") + rows[2][12:52].count("'") > 30
    assert [row[:52].count("|") for row in rows[:2]] != [1, 1], "the spike goes up"


async def test_a_chart_without_room_or_samples_says_so() -> None:
    chart = LaneChart(ASCII)
    lanes = Lanes()
    spec = LaneSpec("a", "a", "x", 1.0, 0.01, "a")
    async with alone(chart, 64, 3) as _:
        assert chart.room == 1
        chart.show(lanes, [spec], Window(0, 40, None), ())
        assert chart_rows(chart, 3) == ["", "  no samples yet", ""]
    lanes.add(Live(0, 0.1, (Lane("a", (1.0,), (1.0,)),)))
    narrow = LaneChart(ASCII)
    async with alone(narrow, 32, 4) as _:
        narrow.show(lanes, [spec], Window(0, 40, None), ())
        assert "no samples yet" in chart_rows(narrow, 4)[1]
    wide = LaneChart(ASCII)
    async with alone(wide, 33, 40) as _:
        wide.show(lanes, [spec], Window(0, 40, None), ())
        assert [row[:1] for row in chart_rows(wide, 40)].count("a") == 1
        assert [bool(row) for row in chart_rows(wide, 40)].count(True) == 12, "three times four"


async def test_a_banner_folds_its_first_line_and_not_a_reason() -> None:
    bar = BannerBar(ASCII)
    made = Banner("good", "+", "ACCEPTED", "bounce 3", "one two three four five", "then", "3")
    async with alone(bar, 33, 4) as _:
        bar.show(made)
        lines = text(bar.query("Static").first())
        assert lines == [
            " + ACCEPTED     bounce 3", "   one two three four", "   five  then"
        ]  # fmt: skip
        assert str(bar.query_one("#figures").render()) == "\n    3 "
        bar.show(replace(made, folds=False))
        assert text(bar.query("Static").first())[1:] == [
            "   one two three four five", "   then"
        ]  # fmt: skip
        assert bar.has_class("-good")
        bar.show(replace(made, kind="bad"))
        assert (bar.has_class("-good"), bar.has_class("-bad")) == (False, True)


FIELDS = (
    Field("name", "Name", needed=True),
    Field("kind", "Kind", choices=("one", "two", "three")),
    Field("mass", "Mass", "kg", 0.0, 9.0),
    Field("mass.sigma", "Mass ±", "kg", 0.0, 9.0),
)
