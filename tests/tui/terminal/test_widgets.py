"""Widgets by themselves, each in a terminal of a known size: what stands where, and what is cut."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from math import nan

from textual.app import App, ComposeResult
from textual.events import Paste

from daq.control.messages import Lane, Live
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.state.lanes import Lanes, LaneSpec, Window
from tui.terminal.state.words import Banner
from tui.terminal.widgets.banner import BannerBar
from tui.terminal.widgets.form import Field, FieldError, Form
from tui.terminal.widgets.table import Table
from tui.terminal.widgets.traces import LaneChart

from .alone import Shown, alone, text

ASCII = choose_glyphs(GlyphSet.ASCII, {}, "utf-8")


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


async def test_a_form_is_filled_turned_marked_and_sent() -> None:
    form = Form([FIELDS[:2], FIELDS[2:]], 9)
    async with alone(form, 60, 6) as pilot:
        app = pilot.app
        assert isinstance(app, Shown)
        form.fill({"name": "a", "kind": "one", "mass": "1", "absent": "x"})
        assert app.messages == []
        assert form.values == {"name": "a", "kind": "one", "mass": "1", "mass.sigma": ""}
        form.enter("kind")
        await pilot.pause()
        assert form.current is FIELDS[1]
        words = []
        for key in ("right", "right", "right", "left"):
            await pilot.press(key)
            words.append(form.values["kind"])
        assert words == ["two", "three", "one", "three"]
        assert app.messages == ["changed"] * 4
        form.fill({"kind": ""})
        await pilot.press("right")
        assert form.values["kind"] == "one"
        await pilot.press("enter", "down", "enter")
        assert app.messages[-1] == "submitted"
        form.enter()
        await pilot.pause()
        assert form.current is FIELDS[0]
        labels = [str(label.render()) for label in form.query("Label")]
        assert labels == [
            " Name    [", "]       Kind <", ">", " Mass    [", "] kg    ± [", "] kg"
        ]  # fmt: skip
        form.mark([FieldError("mass", "Mass", "0 to 9", "no")])
        marked = [str(label.render()) for label in form.query("Label")]
        assert marked[3] == "!Mass    ["


async def test_a_row_of_a_table_is_pasted_into_one_field_after_the_other() -> None:
    form = Form([FIELDS[:2], FIELDS[2:]], 9)
    async with alone(form, 60, 6) as pilot:
        app = pilot.app
        assert isinstance(app, Shown)
        form.fill({"kind": "one"})
        form.enter("name")
        await pilot.pause()
        app.post_message(Paste("car\tfour\t7.5\nnext"))
        await pilot.pause()
        await pilot.pause()
        assert form.values == {"name": "car", "kind": "one", "mass": "7.5", "mass.sigma": ""}
        assert form.current is FIELDS[2]
        assert app.messages[-1] == "changed"


def test_a_column_is_as_wide_as_its_widest_cell_at_once() -> None:
    """Widths that Textual measures when it is idle were those of the headings, under load."""

    class TableApp(App[None]):
        def compose(self) -> ComposeResult:
            yield Table("list")

    async def widths() -> list[int]:
        app = TableApp()
        async with app.run_test():
            table = app.query_one(Table)
            table.show(("state", ""), [["reported", "6"], ["real"]])
            return [column.get_render_width(table) for column in table.ordered_columns]

    assert asyncio.run(widths()) == [9, 2]
