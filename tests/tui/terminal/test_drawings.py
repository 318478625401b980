"""Bars, big letters, traces and their ranges, by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tui.jobs.lines import Done, Item, Progress, Trouble
from tui.terminal.screens.work import LongWork, Stage, after, work_text
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.state.lanes import Lanes, lane_specs

from .fake_recorder import FakeRecorder

ASCII = choose_glyphs(GlyphSet.ASCII, {}, "utf-8")
BLOCKS = choose_glyphs(GlyphSet.BLOCKS, {}, "utf-8")
BRAILLE = choose_glyphs(GlyphSet.BRAILLE, {}, "utf-8")
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
    assert choose_glyphs(GlyphSet.AUTO, terminal, encoding).name == chosen


def test_long_work_shows_its_parts_and_ends_with_all_done() -> None:
    work = after(after(LongWork(), Progress(0.25, "reading")), Progress(1.5, "fitting"))
    assert (work.stage, work.share) == (Stage.WORKING, 1.0)
    assert work_text(work, ASCII, 18)[1:] == ["", "  + reading", "  > fitting"]
    assert after(work, Item({})) is work
    done = after(replace(work, share=0.5), Done({"a": 1}))
    assert (done.stage, done.share, done.answer) == (Stage.DONE, 1.0, {"a": 1})
    assert work_text(done, ASCII, 18)[3] == "  + fitting"
    failed = after(work, Trouble("a.h5", "is damaged", "build it"))
    assert work_text(failed, ASCII, 18) == [
        "x FAILED  is damaged", "  a.h5", "  What to do: build it"
    ]  # fmt: skip


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
