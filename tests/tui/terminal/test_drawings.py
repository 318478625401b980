"""Bars, big letters, traces and their ranges, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.control.messages import (
    Phase,
)
from tui.jobs.lines import Done, Item, Progress, Trouble
from tui.terminal.screens.work import LongWork, Stage, after, bar_line, work_text
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.state.lanes import Lanes, lane_specs, window
from tui.terminal.state.traces import full_scale, pooled, trace
from tui.terminal.widgets.banner import big_word

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


@pytest.mark.parametrize(
    ("share", "width", "line"),
    [
        (0.0, 18, "[........]   0%"), (0.5, 18, "[####....]  50%"), (1.0, 18, "[########] 100%"),
        (0.5, 10, "[####....]  50%"), (0.5, 20, "[#####.....]  50%"),
        (0.25, 200, "[" + "#" * 15 + "." * 45 + "]  25%"),
    ],
)  # fmt: skip
def test_a_bar_of_work_is_as_wide_as_there_is_room(share: float, width: int, line: str) -> None:
    assert bar_line(share, width, ASCII) == line


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


def test_big_letters_grow_as_far_as_they_fit() -> None:
    assert big_word("IT", 9, 5, "@") == [
        "@@@ @@@@@", " @    @  ", " @    @  ", " @    @  ", "@@@   @  "
    ]  # fmt: skip
    assert big_word("IT", 8, 5, "@") == []
    assert big_word("IT", 9, 4, "@") == []
    twice = big_word("IT", 18, 10, "@")
    assert len(twice) == 10
    assert twice[0] == twice[1] == "@@@@@@  @@@@@@@@@@"
    assert len(big_word("IT", 17, 10, "@")) == 5
    assert len(big_word("IT", 500, 500, "@")) == 15
    assert big_word("", 10, 15, "@") == [""] * 15


def test_a_trace_in_bars_strikes_what_the_envelope_covers() -> None:
    # Two rows of three: 6 dots high, zero on the fourth, 2 dots for the full scale.
    low = np.array([0.0, -1.0, 0.5, np.nan])
    high = np.array([0.0, 1.0, 0.5, np.nan])
    assert trace(low, high, 1.0, 2, ASCII) == [" ,. ", "'|  "]
    rows = trace(np.zeros(3), np.zeros(3), 1.0, 2, ASCII)
    assert rows == ["   ", "'''"]
    top = trace(np.full(2, 1.0), np.full(2, 1.0), 1.0, 2, ASCII)
    assert top == ["--", "  "]
    assert trace(np.full(2, -1.0), np.full(2, -1.0), 1.0, 2, ASCII) == ["  ", ".."]
    assert trace(np.zeros(2), np.zeros(2), 1.0, 1, BLOCKS) == ["▄"]


def test_bins_are_pooled_into_equal_parts() -> None:
    low, high = pooled(np.array([3.0, 1.0, 2.0, 5.0]), np.array([4.0, 2.0, 9.0, 6.0]), 2)
    assert (low.tolist(), high.tolist()) == ([1.0, 2.0], [4.0, 9.0])
    same, _ = pooled(np.array([1.0, 2.0]), np.array([1.0, 2.0]), 2)
    assert same.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("peak", "least", "before", "scale"),
    [
        (1.0, 0.5, 0.0, 1.0), (1.01, 0.5, 0.0, 2.0), (2.01, 0.5, 0.0, 5.0), (5.01, 0.5, 0.0, 10.0),
        (0.02, 0.001, 0.0, 0.02), (30.0, 0.5, 90.0, 90.0), (29.9, 0.5, 90.0, 50.0),
        (90.0, 0.5, 90.0, 90.0), (90.1, 0.5, 90.0, 100.0),
    ],
)  # fmt: skip
def test_a_range_is_1_2_or_5_times_a_power_of_ten(
    peak: float, least: float, before: float, scale: float
) -> None:
    assert full_scale(peak, least, before) == pytest.approx(scale)


def test_the_window_is_the_last_six_seconds_or_stands_from_a_second_before_the_bump() -> None:
    recorder, lanes = FakeRecorder(), Lanes()
    lanes.bin_s, lanes.end = 0.5, 1000
    recorder.t_ns = 497 * S
    status = replace(recorder.status, phase=Phase.ARMED, bump_ns=0)
    assert window(status, lanes).first_bin == 988
    assert window(status, lanes).count == 12
    assert window(status, lanes, 3.0).count == 6
    early = window(replace(status, bump_ns=497 * S), lanes)
    assert (early.first_bin, early.trigger) == (988, 0.5)
    held = window(replace(status, bump_ns=497 * S, phase=Phase.DECAY), lanes)
    assert held.first_bin == 992
    assert held.trigger == pytest.approx(1 / 6)
    old = window(replace(status, bump_ns=490 * S, phase=Phase.ACCEPTED), lanes)
    assert (old.first_bin, old.trigger) == (988, None)
    edge = window(replace(status, bump_ns=494 * S), lanes)
    assert edge.trigger == 0.0
    assert window(replace(status, bump_ns=500 * S), lanes).trigger is None
    assert window(None, Lanes()).count == 300


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
