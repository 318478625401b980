"""Lists of the bench in a terminal of a known size: their order, their words and what is cut."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from daq.control.messages import Alarm, LeftOut, Phase
from daq.control.orders import Note, OverrideWarning
from tui.terminal.state.campaign import next_action
from tui.terminal.state.feed import Lost
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.widgets.lists import (
    AlarmList,
    Journal,
    NextPanel,
    RunList,
    TallyList,
)

from .alone import alone, text
from .fake_recorder import DOUBLE_BUMP, GOOD, FakeRecorder

ASCII = choose_glyphs(GlyphSet.ASCII, {}, "utf-8")


@pytest.fixture
def recorder() -> FakeRecorder:
    made = FakeRecorder()
    made.mark("vehicle", "check")
    return made


async def test_alarms_are_folded_and_the_last_ones_counted() -> None:
    silent = Alarm("bus_silent", "can0", "no frame for 2 s", "check the cable", 1)
    full = Alarm("disk_full", "", "1 GB left", "make room", 1)
    recorder = FakeRecorder()
    alarms = AlarmList(ASCII)
    async with alone(alarms, 70, 6) as _:
        alarms.show(replace(recorder.status, alarms=(silent, full)))
        assert text(alarms) == [
            "! BUS SILENT can0: no frame for 2 s: check the cable",
            "! DISK FULL 1 GB left: make room",
        ]
        alarms.show(replace(recorder.status, overloaded=("hub_fl",)))
        assert text(alarms) == [
            "^ OVERLOAD hub_fl touched the end of its range: A puts the lamp out"
        ]
        alarms.show(replace(recorder.status, overloaded=("a", "b")))
        assert text(alarms) == [
            "^ OVERLOAD a, b touched the end of their range: A puts the lamps out"
        ]
        alarms.show(replace(recorder.status, alarms=(silent,) * 4))
        assert len(text(alarms)) == 4
        alarms.show(replace(recorder.status, alarms=(silent,) * 5))
        assert text(alarms)[-1] == "! and 2 more"
        assert len(text(alarms)) == 4
        long = replace(silent, text="word " * 40, advice="do " * 60)
        alarms.show(replace(recorder.status, alarms=(full, long, full)))
        assert len(text(alarms)) == 4
        assert text(alarms)[1].startswith("! BUS SILENT")
        assert text(alarms)[2].startswith("  word")
        assert text(alarms)[3].startswith("! DISK")
        alarms.show(recorder.status)
        assert not alarms.display
        alarms.show(None)
        assert not alarms.display
    slim = AlarmList(ASCII)
    async with alone(slim, 40, 9) as _:
        slim.show(replace(recorder.status, alarms=(long,)))
        assert len(text(slim)) == 3
        slim.show(replace(recorder.status, alarms=(long, full)))
        assert len(text(slim)) == 4


async def test_progress_marks_what_is_due_and_says_what_was_rejected(
    recorder: FakeRecorder,
) -> None:
    motion = replace(GOOD, code="motion", text="f 1.15 Hz", unit="Hz", value=1.15)
    recorder.bump()
    recorder.judge(motion)
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    tallies = TallyList(ASCII)
    async with alone(tallies, 100, 8) as _:
        tallies.show(recorder.status)
        assert text(tallies)[:2] == [
            ">> baseline bounce  #.  1/2  1.15 Hz  1 rejected  double bump",
            "   baseline pitch   ..  0/2",
        ]
        tallies.move(1, recorder.status)
        assert [line[:2] for line in text(tallies)[:3]] == [" >", "> ", "  "]
        tallies.move(9, recorder.status)
        assert tallies.chosen == 5
        tallies.move(-9, recorder.status)
        assert tallies.chosen == 0
        recorder.bump()
        recorder.judge(replace(motion, value=1.25))
        recorder.choose("baseline", recorder.status.tallies[0].excitation)
        recorder.bump()
        recorder.judge()
        tallies.show(recorder.status)
        assert text(tallies)[0] == (
            ">  baseline bounce  ##  2/2 +1  1.20 ± 0.07 Hz  1 rejected  double bump"
        )
    narrow = TallyList(ASCII)
    async with alone(narrow, 47, 8) as _:
        narrow.show(recorder.status)
        assert text(narrow)[0].endswith("2/2 +1  1.20 Hz  1 rej.")
    slim = TallyList(ASCII)
    async with alone(slim, 46, 8) as _:
        slim.show(recorder.status)
        assert text(slim)[0].endswith("2/2 +1  1 rej.")


async def test_runs_and_journal_have_the_newest_on_top(recorder: FakeRecorder) -> None:
    motion = replace(GOOD, code="motion", text="f 1.15 Hz", unit="Hz", value=1.15)
    recorder.bump()
    recorder.judge(motion)
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    await recorder.ask(Note("wet", "baseline_bounce_2"))
    await recorder.ask(OverrideWarning("noise", "lift"))
    recorder.bump()
    runs, journal = RunList(ASCII), Journal()
    async with alone(runs, 100, 8) as _:
        runs.show(recorder.status)
        assert text(runs) == [
            "> running   baseline bounce 3",
            "x rejected  baseline bounce 2  second bump at +0.84 s, kept",
            "+ accepted  baseline bounce 1  f 1.15 Hz",
        ]
        odd = LeftOut("baseline_bounce_1", "3 mm higher")
        runs.show(replace(recorder.status, proposed=(odd,)))
        assert text(runs)[-1].endswith("bounce 1  unlike the others: 3 mm higher")
        taken = replace(recorder.status.runs[0], by="MK", reason="a door")
        runs.show(replace(recorder.status, runs=(taken,)))
        assert text(runs) == ["+ accepted  baseline bounce 1  f 1.15 Hz  taken by MK: a door"]
        runs.show(replace(recorder.status, runs=()))
        assert text(runs) == ["no runs yet"]
    async with alone(journal, 100, 12) as _:
        journal.show(recorder.status)
        said = [line.partition("  ")[2] for line in text(journal)]
        assert said[0] == "bounce 3 is recorded"
        assert set(said[1:4]) == {
            "note on baseline_bounce_2: wet (MK)",
            "WARN noise overridden by MK: lift",
            "bounce 2 rejected",
        }
        assert said[4] == "bounce 1 accepted"
        assert set(said[5:]) == {"step vehicle done", "step check done"}
        bare = replace(recorder.status, runs=(), notes=(), overrides=())
        journal.show(bare)
        assert text(journal) == ["nothing yet"]


async def test_what_is_next_stands_in_a_panel(recorder: FakeRecorder) -> None:
    panel = NextPanel(ASCII)

    def said(**changes: Any) -> list[str]:
        status = replace(recorder.status, **changes)
        panel.show(status, next_action(status), None)
        return text(panel)

    async with alone(panel, 80, 12) as _:
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
        panel.show(None, next_action(None), None)
        assert text(panel)[0].startswith("waiting for the recorder")
        panel.show(recorder.status, next_action(None), Lost("it has ended", "all is on the disk"))
        assert text(panel) == [
            "x RECORDER LOST", "it has ended", "",
            "X = start it again   (all is on the disk)",
        ]  # fmt: skip
        assert said(due=None, phase=Phase.WAITING)[0] == "step 5 Added"
