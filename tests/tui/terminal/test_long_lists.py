"""How much of a long recording the lists show, and from which width they say more."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daq.control.orders import Note
from daq.runlog.run_log import LoggedStatus
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.widgets.lists import Journal, RunList, TallyList, clock_time, run_figures

from .alone import alone, text
from .fake_recorder import DOUBLE_BUMP, GOOD, FakeRecorder

ASCII = choose_glyphs(GlyphSet.ASCII, {}, "utf-8")


@pytest.fixture
def recorder() -> FakeRecorder:
    made = FakeRecorder()
    made.mark("vehicle", "check")
    made.bump()
    made.judge(DOUBLE_BUMP)
    return made


async def test_the_newest_two_hundred_are_listed(recorder: FakeRecorder) -> None:
    run = recorder.status.runs[0]
    many = tuple(replace(run, repeat=n, t_ns=n * 1_000_000_000) for n in range(1, 203))
    status = replace(recorder.status, runs=many, notes=(), overrides=())
    runs, journal = RunList(ASCII), Journal()
    async with alone(runs, 100, 8) as _:
        runs.show(status)
        lines = text(runs)
        assert len(lines) == 200
        assert "bounce 202 " in lines[0]
        assert "bounce 3 " in lines[-1]
    async with alone(journal, 100, 8) as _:
        journal.show(status)
        lines = text(journal)
        assert len(lines) == 200
        assert lines[0] == "00:03:22  bounce 202 rejected", "since 1970, in UTC"
        assert lines[-1] == "00:00:03  bounce 3 rejected"


@pytest.mark.parametrize(("width", "wide"), [(48, False), (49, True)])
async def test_more_than_48_columns_have_room_for_the_scatter(
    width: int, wide: bool, recorder: FakeRecorder
) -> None:
    motion = replace(GOOD, code="motion", text="f", unit="Hz", value=1.15)
    for value in (1.15, 1.25):
        recorder.bump()
        recorder.judge(replace(motion, value=value))
    tallies = TallyList(ASCII)
    async with alone(tallies, width, 8) as _:
        tallies.show(replace(recorder.status, tallies=recorder.status.tallies[:1]))
        (line,) = text(tallies)
    # Two figures have their mean, 1.20 Hz, and their standard deviation, 0.0707.
    assert ("± 0.07 Hz" in line or "rejected" in line) is wide
    assert ("rej." in line) is not wide


async def test_a_run_taken_by_a_person_says_by_whom_and_why(recorder: FakeRecorder) -> None:
    run = replace(recorder.status.runs[0], status=LoggedStatus.ACCEPTED, findings=())
    assert run_figures(run) == ""
    assert run_figures(replace(run, by="MK")) == ""
    assert run_figures(replace(run, reason="a door")) == ""
    motion = replace(GOOD, code="motion", text="1.15 Hz")
    both = replace(run, by="MK", reason="a door", findings=(GOOD, motion))
    assert run_figures(both) == "1.15 Hz  taken by MK: a door"
    assert len(run_figures(replace(both, reason="x" * 500))) == 160


async def test_a_note_has_its_author_and_a_mark_has_none(recorder: FakeRecorder) -> None:
    await recorder.ask(Note("wet"))
    journal = Journal()
    async with alone(journal, 100, 8) as _:
        journal.show(replace(recorder.status, runs=(), overrides=()))
        words = [line.partition("  ")[2] for line in text(journal)]
    assert sorted(words) == ["note: wet (MK)", "step check done", "step vehicle done"]
    assert clock_time(1_795_267_320_900_000_000) == "13:22:00"
