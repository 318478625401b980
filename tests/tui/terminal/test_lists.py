"""Texts of the boxes of home and run screen: their order, their words and what is cut."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from daq.control.messages import Alarm, LeftOut, Phase, Status
from daq.control.orders import Note, OverrideWarning
from tui.terminal.state.campaign import next_action
from tui.terminal.state.feed import Lost
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.widgets.lists import (
    alarms_text,
    journal_text,
    next_text,
    runs_text,
    tally_rows,
)

from .fake_recorder import DOUBLE_BUMP, GOOD, FakeRecorder

ASCII = choose_glyphs(GlyphSet.ASCII, {}, "utf-8")
MOTION = replace(GOOD, code="motion", text="f 1.15 Hz", unit="Hz", value=1.15)


@pytest.fixture
def recorder() -> FakeRecorder:
    made = FakeRecorder()
    made.mark("vehicle", "check")
    return made


def test_alarms_are_folded_and_the_last_ones_counted(recorder: FakeRecorder) -> None:
    silent = Alarm("bus_silent", "can0", "no frame for 2 s", "check the cable", 1)
    full = Alarm("disk_full", "", "1 GB left", "make room", 1)
    long = replace(silent, text="word " * 40, advice="do " * 60)

    def shown(*alarms: Alarm, width: int = 70, overloaded: tuple[str, ...] = ()) -> list[str]:
        status = replace(recorder.status, alarms=alarms, overloaded=overloaded)
        return alarms_text(status, ASCII, width).plain.splitlines()

    assert shown(silent, full) == [
        "! BUS SILENT can0: no frame for 2 s: check the cable",
        "! DISK FULL 1 GB left: make room",
    ]
    assert shown(overloaded=("a", "b")) == [
        "^ OVERLOAD a, b touched the end of the range: A puts the lamp out"
    ]
    assert len(shown(*[silent] * 4)) == 4
    assert shown(*[silent] * 5)[3:] == ["! and 2 more"]
    lines = shown(full, long, full)
    assert [line.split()[1] for line in lines] == ["DISK", "BUS", "word", "DISK"]
    assert len(shown(long, width=40)) == 3, "the gravest has three rows"
    assert shown() == []


def test_progress_marks_what_is_due_and_says_what_was_rejected(recorder: FakeRecorder) -> None:
    def rows() -> list[list[str]]:
        return [[str(cell).strip() for cell in row] for row in tally_rows(recorder.status, ASCII)]

    recorder.bump()
    recorder.judge(MOTION)
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    assert rows()[:2] == [
        ["> baseline bounce", "#.", "1/2", "1.15 Hz", "1 rejected: double bump"],
        ["baseline pitch", "..", "0/2", "", ""],
    ]
    recorder.bump()
    recorder.judge(replace(MOTION, value=1.25))
    recorder.choose("baseline", recorder.status.tallies[0].excitation)
    recorder.bump()
    recorder.judge()
    assert rows()[0][1:4] == ["##", "2/2 +1", "1.20 ± 0.07 Hz"]


async def test_runs_and_journal_have_the_newest_on_top(recorder: FakeRecorder) -> None:
    def runs(status: Status) -> list[str]:
        return runs_text(status, ASCII).plain.splitlines()

    recorder.bump()
    recorder.judge(MOTION)
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    await recorder.ask(Note("wet", "baseline_bounce_2"))
    await recorder.ask(OverrideWarning("noise", "lift"))
    recorder.bump()
    assert runs(recorder.status) == [
        "> running   baseline bounce 3",
        "x rejected  baseline bounce 2  second bump at +0.84 s, kept",
        "+ accepted  baseline bounce 1  f 1.15 Hz",
    ]
    odd = LeftOut("baseline_bounce_1", "3 mm higher")
    unlike = runs(replace(recorder.status, proposed=(odd,)))
    assert unlike[-1].endswith("bounce 1  unlike the others: 3 mm higher")
    taken = replace(recorder.status.runs[0], by="MK", reason="a door")
    assert runs(replace(recorder.status, runs=(taken,))) == [
        "+ accepted  baseline bounce 1  f 1.15 Hz  taken by MK: a door"
    ]
    assert runs(replace(recorder.status, runs=())) == ["no runs yet"]
    said = [line.partition("  ")[2] for line in journal_text(recorder.status).plain.splitlines()]
    assert said[0] == "bounce 3 is recorded"
    assert set(said[1:4]) == {
        "note on baseline_bounce_2: wet (MK)",
        "WARN noise overridden by MK: lift",
        "bounce 2 rejected",
    }
    assert said[4] == "bounce 1 accepted"
    assert set(said[5:]) == {"step vehicle done", "step check done"}
    bare = replace(recorder.status, runs=(), notes=(), overrides=())
    assert journal_text(bare).plain == "nothing yet"


def test_what_is_next_stands_in_a_panel(recorder: FakeRecorder) -> None:
    def said(lost: Lost | None = None, **changes: Any) -> list[str]:
        status = replace(recorder.status, **changes)
        return next_text(status, next_action(status), lost, ASCII).plain.splitlines()

    assert said() == [
        "> Baseline · BOUNCE, run 1 of 2", "Roll all four wheels over the boards.", "",
        "SPACE starts",
    ]  # fmt: skip
    recorder.finish("baseline")
    assert said() == ["> Step 4 Masses", "", "SPACE = step 4 Masses"]
    recorder.mark("masses")
    recorder.choose("baseline", recorder.status.tallies[0].excitation)
    assert said()[0] == "> Baseline · BOUNCE, run 3, 2 were planned"
    odd = LeftOut("baseline_roll_1", "3 mm higher")
    assert said(proposed=(odd,) * 3)[2:5] == [
        "3 runs are unlike the others of their kind: L leaves them out.",
        "  baseline_roll_1: 3 mm higher", "  baseline_roll_1: 3 mm higher",
    ]  # fmt: skip
    failed = Alarm("journal_failed", "", "disk is full", "make room", 1)
    assert said(alarms=(failed,))[0].startswith("x STOP  ")
    assert said(due=None, phase=Phase.WAITING)[0] == "step 5 Added"
    assert next_text(None, next_action(None), None, ASCII).plain.startswith("waiting for the")
    assert said(Lost("it has ended", "all is on the disk")) == [
        "x RECORDER LOST", "it has ended", "",
        "X = start it again   (all is on the disk)",
    ]  # fmt: skip
