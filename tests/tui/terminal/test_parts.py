"""What is drawn and decided without a terminal: traces, history, steps, the one key, the words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.control.messages import Lane, Live, Phase
from daq.control.orders import Arm
from daq.runlog.run_log import Code, entry
from daq.runs import Excitation
from tui.terminal.state.campaign import BenchStep, next_action, progress
from tui.terminal.state.glyphs import Glyphs, GlyphSet, choose_glyphs
from tui.terminal.state.lanes import RING_S, Lanes, lane_specs, window
from tui.terminal.state.traces import full_scale, pooled, trace

from .fake_recorder import BIN_S, DOUBLE_BUMP, FakeRecorder

BRAILLE = choose_glyphs(GlyphSet.BRAILLE, {}, "utf-8")
BLOCKS = choose_glyphs(GlyphSet.BLOCKS, {}, "utf-8")
ASCII = choose_glyphs(GlyphSet.ASCII, {}, "utf-8")


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


def test_zero_is_one_row_of_dots() -> None:
    low = high = np.zeros(20)
    dots = _dots(trace(low, high, 1.0, 4, BRAILLE))
    assert (dots.sum(axis=0) == 1).all()
    assert dots[8].all()


def test_a_spike_of_one_sample_is_drawn_from_its_foot_to_its_tip() -> None:
    low, high = np.zeros(400), np.zeros(400)
    high[137] = 0.99
    seen = _dots(trace(*pooled(low, high, 40), 1.0, 4, BRAILLE))
    column = 137 * 40 // 400
    assert seen[1:9, column].all()
    assert seen[:8].any(axis=0).sum() <= 2  # the column and its neighbour that it is joined to


def test_a_steep_flank_hangs_together() -> None:
    value = np.repeat([-0.9, 0.9], 10)
    seen = _dots(trace(value, value, 1.0, 4, BRAILLE))
    rows = np.flatnonzero(seen.any(axis=1))
    assert np.array_equal(rows, np.arange(rows[0], rows[-1] + 1))


@pytest.mark.parametrize("glyphs", [BRAILLE, BLOCKS, ASCII], ids=lambda g: g.name)
def test_every_set_draws_rows_of_the_same_width(glyphs: Glyphs) -> None:
    t = np.linspace(0, 6, 30 * glyphs.dots[0])
    rows = trace(np.sin(t) - 0.1, np.sin(t) + 0.1, 1.2, 4, glyphs)
    assert [len(row) for row in rows] == [30] * 4
    assert all(row.strip() for row in rows)
    if glyphs is ASCII:
        assert "".join(rows).isascii()


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


def test_the_one_key() -> None:
    recorder = FakeRecorder()
    assert next_action(None).order is None
    assert next_action(recorder.status).step is BenchStep.VEHICLE
    recorder.mark("vehicle", "check")
    assert next_action(recorder.status).order == Arm()
    for phase in (Phase.WAITING, Phase.ARMED, Phase.TRIGGERED, Phase.DECAY):
        recorder.turn(phase)
        assert next_action(recorder.status).words == ""
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    assert next_action(recorder.status).order == Arm()
    recorder.turn(Phase.PAUSED)
    assert next_action(recorder.status).order == Arm()
    recorder.bump()
    recorder.judge()
    assert next_action(recorder.status).order == Arm()
    # The last of its kind: the boards have to be moved before anything is armed.
    last = replace(recorder.status, countdown_s=None)
    assert next_action(last).order is None
    recorder.finish("baseline")
    assert next_action(recorder.status).step is BenchStep.MASSES


def test_more_runs_are_recorded_by_the_one_key_after_each_step() -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    recorder.choose("baseline", Excitation.ROLL)
    more = next_action(recorder.status)
    assert (more.words, more.order) == ("SPACE = one more roll", Arm())
    recorder.mark("masses")
    recorder.bump()
    recorder.judge()
    recorder.finish("added")
    recorder.mark("identify", "report")
    assert next_action(recorder.status).step is BenchStep.REPORT
    recorder.choose("added", Excitation.PITCH)
    assert next_action(recorder.status).order == Arm()
    recorder.bump()
    recorder.judge()
    recorder.turn(Phase.COMPLETE)
    assert next_action(recorder.status).step is BenchStep.IDENTIFY


def test_a_note_is_no_mark() -> None:
    recorder = FakeRecorder()
    recorder._enter(entry(Code.NOTE, 0, text="step vehicle done", label="", by="MK"))
    recorder.mark("check")
    assert progress(recorder.status).due is BenchStep.VEHICLE
