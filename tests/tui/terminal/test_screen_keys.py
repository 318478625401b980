"""Keys off the straight way: sessions, results, report, notes and the run loop."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from dataclasses import replace
from pathlib import Path

import pytest
from textual.widgets import TextArea

from daq.control.messages import Phase, SessionState, SessionStatus
from daq.control.orders import Arm, AskCheck, Build, Note, Pause, Redo, Undo
from tui.jobs.lines import CompareTask, Done, ExportTask, Item, Line, ListTask, Task, Trouble
from tui.jobs.session_list import EntryState, SessionEntry
from tui.terminal.screens import sessions, work
from tui.terminal.screens.sessions import SessionsScreen
from tui.terminal.screens.work import IdentifyScreen, LongWork, ReportScreen, Stage
from tui.terminal.widgets.table import Table

from ...identify.results import forces
from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .operated import Make, orders_of, until
from .outcomes import outcome
from .test_results import measured, results_of
from .test_step_keys import front, pressed, seen

# Sessions ---------------------------------------------------------------------------------------

ENTRIES = [
    SessionEntry("", "/b", "2026-11-21 10:42", "T5", EntryState.CUT_OFF, 5, 1, "", "r9"),
    SessionEntry("", "/b", "2026-11-21 10:41", "T5", EntryState.DAMAGED, note="is cut off"),
    SessionEntry("", "/b", "2026-11-21 10:40", "T4", EntryState.OPEN, 5, 1, "", "r8"),
    SessionEntry("/b/s1.h5", "/b", "2026-11-20 15:01", "T3", EntryState.READY, 30, 4, "wet"),
    SessionEntry("/b/s2.h5", "/b", "2026-11-19 15:01", "T2", EntryState.READY, 30, 4, ""),
]


@pytest.fixture
def tasks(monkeypatch: pytest.MonkeyPatch) -> list[Task]:
    """Return the tasks that are given to workers, which all but the list answer with trouble."""
    given: list[Task] = []

    async def lines_of(task: Task, where: str) -> AsyncGenerator[Line, None]:
        given.append(task)
        if isinstance(task, ListTask):
            for entry in ENTRIES:
                yield Item(entry)
            yield Done({"count": len(ENTRIES)})
        else:
            yield Trouble(where, "needs more memory", "end other programs")

    for screen in (sessions, work):
        monkeypatch.setattr(screen, "lines_of", lines_of)
    return given


async def test_a_session_that_is_no_file_says_why_it_cannot_be_used(
    make_app: Make, tasks: list[Task]
) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        await app.action_sessions()
        await until(pilot, lambda: "10:42" in screen_text(app))
        screen = app.screen
        assert isinstance(screen, SessionsScreen)
        assert (screen.acts, screen.ready) == (True, False)
        assert "this recording was cut off" in await pressed(pilot, "space")
        assert "there is no session file yet: step 6" in await pressed(pilot, "r")
        recorder.publish(recording="r9")
        await pilot.pause()
        await pilot.pause()
        assert "there is no session file yet: step 6" in await pressed(pilot, "r")
        ready = SessionStatus(SessionState.READY, "/b/s2.h5", recording="r9")
        recorder.publish(recording="r9", session=ready)
        await pilot.pause()
        assert "this line is the recording itself: mark that of s2.h5" in await pressed(pilot, "r")
        recorder.publish(recording="r1")
        await pilot.pause()
        await pilot.pause()
        assert "is cut off" in await pressed(pilot, "down", "e")
        assert front(app) is screen
        assert [type(task) for task in tasks] == [ListTask]
        await pressed(pilot, "down", "space")
        assert front(app) is not screen, "the step of the recording that goes on"
        assert [type(task) for task in tasks] == [ListTask]


async def test_trouble_of_a_worker_is_shown(make_app: Make, tasks: list[Task]) -> None:
    app = make_app(measured())
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        await app.action_sessions()
        await until(pilot, lambda: "10:42" in screen_text(app))
        await pressed(pilot, "end", "c")
        said = screen_text(app)
        assert "now choose the second" in said
        (line,) = (line for line in said.splitlines() if "2026-11-19" in line)
        assert line.split()[0] == "1"
        await pressed(pilot, "c")
        assert "now choose the second" not in seen(app), "the same key takes it back"
        await pressed(pilot, "c", "up", "c")
        await until(pilot, lambda: "needs more memory" in screen_text(app))
        assert tasks[-1:] == [CompareTask(("/b/s2.h5", "/b/s1.h5"))]
        await pressed(pilot, "e", "down", "space")
        await until(pilot, lambda: isinstance(tasks[-1], ExportTask))
        assert tasks[-1] == ExportTask("/b/s1.h5", "mat")


async def test_a_search_is_left_by_escape_and_ended_by_enter(
    make_app: Make, tasks: list[Task]
) -> None:
    app = make_app(measured())
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        await app.action_sessions()
        await until(pilot, lambda: "10:42" in screen_text(app))
        screen = app.screen
        assert isinstance(screen, SessionsScreen)
        said = await pressed(pilot, "f", *"t3 wet")
        assert "/b/s1.h5 wet" in said
        assert "2026-11-19" not in said
        await pressed(pilot, "enter")
        assert app.focused is screen.query_one(Table)
        await pressed(pilot, "escape")
        assert "2026-11-19" in seen(app)
        assert "no session matches" in await pressed(pilot, "f", *"escort")
        assert not screen.acts
        await pressed(pilot, "enter", "space", "r", "e", "v", "c")
        assert front(app) is screen
        await pressed(pilot, "escape", "escape")
        assert app.screen is app.get_screen("home")


async def test_a_list_that_cannot_be_read_says_why(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def lines_of(_: Task, where: str) -> AsyncGenerator[Line, None]:
        yield Trouble(where, "no process to work in", "end other programs")

    monkeypatch.setattr(sessions, "lines_of", lines_of)
    app = make_app(measured())
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        await app.action_sessions()
        await until(pilot, lambda: "no process to work in" in screen_text(app))


# Results, report, identify ----------------------------------------------------------------------


async def test_results_scroll_export_and_turn_their_pages(
    make_app: Make, tasks: list[Task]
) -> None:
    app = make_app(measured())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        results = results_of(app)
        assert not results.ready
        await app.open("results")
        await until(pilot, lambda: "nothing is identified yet: SPACE = step 6" in screen_text(app))
        shown = outcome("/b/s1.h5")
        results.show_outcome(replace(shown, result=replace(shown.result, forces=forces())))
        assert results.ready
        await pilot.pause()
        scroll = results.query_one("Table#mck")
        for _ in range(2):
            await pressed(pilot, "tab")
        assert "M baseline" in seen(app)
        await until(pilot, lambda: scroll.max_scroll_y > 4)
        for key, row in (("down", 2), ("down", 4), ("up", 2)):
            await pilot.press(key)
            await until(pilot, lambda row=row: scroll.scroll_y == row)
        await pressed(pilot, *["shift+tab"] * 3)
        assert " Dampers " in seen(app)
        assert "Force of one corner at the wheel" in seen(app)
        await pressed(pilot, "p", "down", "down", "up")
        runs = results.query_one("#runs", Table)
        assert runs.cursor_row == 1
        assert "95 % interval" in await pressed(pilot, "p")
        await pressed(pilot, "e", "space")
        await until(pilot, lambda: bool(tasks))
        assert tasks == [ExportTask("/b/s1.h5", "mf4")]
        await until(pilot, lambda: "needs more memory" in seen(app))


async def test_identify_and_report_act_by_their_stage(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[int] = []
    monkeypatch.setattr(ReportScreen, "begin", lambda _: begun.append(1))
    answer = {"verdict": "ok", "files": {"/b/s.html": 2048}}
    app = make_app(measured())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        identify, report = app.get_screen("identify"), app.get_screen("report")
        assert isinstance(identify, IdentifyScreen)
        assert isinstance(report, ReportScreen)
        for stage, acts, ready in (
            (Stage.IDLE, True, True),
            (Stage.BUILDING, False, False),
            (Stage.WORKING, False, False),
            (Stage.DONE, True, True),
            (Stage.FAILED, True, False),
        ):
            identify.work = LongWork(stage, answer=answer)
            assert (identify.acts, identify.ready) == (acts, ready), stage
            await app.open("report")
            await pilot.pause()
            report.work = LongWork(stage, "/bench/session_0001.h5", answer=answer)
            done = stage is Stage.DONE
            assert (report.acts, report.ready) == (acts and not done, stage is Stage.IDLE)
            again = stage in (Stage.DONE, Stage.FAILED)
            assert report.check_action("again", ()) is again
            begun.clear()
            await pressed(pilot, "r")
            assert begun == [1] * again
            await pressed(pilot, "escape")
            under_way = stage in (Stage.BUILDING, Stage.WORKING)
            assert (front(app) is report) is under_way, stage
            assert (report.work == LongWork()) is under_way


# Notes and the run loop -------------------------------------------------------------------------


async def test_a_note_is_not_empty_and_not_too_long(make_app: Make) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        below = app.screen
        await pressed(pilot, "n", *"  ", "ctrl+s")
        assert app.screen is below
        await pressed(pilot, "n")
        area = app.screen.query_one(TextArea)
        area.text = "x" * 2001
        assert "2001 characters, 2000 at most" in await pressed(pilot, "ctrl+s")
        assert orders_of(recorder, Note) == []
        area.text = "x" * 2000
        assert "Note on run added_roll_2" in await pressed(pilot, "ctrl+r")
        assert "Note on the session" in await pressed(pilot, "ctrl+r")
        await pressed(pilot, "ctrl+s")
        assert orders_of(recorder, Note) == [Note("x" * 2000)]
        assert "the note is in the recording" in seen(app)
        (app.folder / "draft_note.json").mkdir()
        await pressed(pilot, "n", "a", "escape")
        await until(pilot, lambda: "cannot be written" in screen_text(app))
        assert app.screen is below


async def test_the_run_loop_says_what_a_key_has_done(make_app: Make) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(140, 40)) as pilot:
        await pilot.pause()
        await pressed(pilot, "space")
        recorder.bump()
        await pilot.pause()
        chart = await pressed(pilot, "v")
        assert "pauses after this run" in await pressed(pilot, "escape")
        assert orders_of(recorder, Pause) == [Pause()]
        recorder.turn(Phase.TRIGGERED)
        recorder.judge()
        await pilot.pause()
        assert "undone; R = redo" in await pressed(pilot, "u")
        assert orders_of(recorder, Undo) == [Undo()]
        assert "redone; U = undo" in await pressed(pilot, "r")
        assert orders_of(recorder, Redo) == [Redo()]
        recorder.turn(Phase.PAUSED)
        await pilot.pause()
        assert "next: baseline pitch" in await pressed(pilot, "down", "m")
        assert chart


async def test_a_refused_order_says_why_and_a_viewer_gives_none(make_app: Make) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        recorder.refuse = "the disk is full"
        assert "the disk is full" in await pressed(pilot, "space")
        app.in_control = False
        assert await app.ask(Arm()) is None
        await pilot.pause()
        assert "C asks for control" in seen(app)
        assert await app.ask(Build()) is None
        assert orders_of(recorder, Build) == []
        recorder.refuse = ""
        assert await app.ask(AskCheck(1.0)) is not None, "who looks on may ask"


async def test_an_export_asks_before_it_replaces_a_file(
    make_app: Make, tasks: list[Task], tmp_path: Path
) -> None:
    """A log of that name may be the one from which the session was imported."""
    session = tmp_path / "car.h5"
    app = make_app(measured())
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        csv = ["down", "down", "down"]
        for place, keys, answer, asked in (
            ("car.mf4", [], "escape", []),
            ("car.mf4", [], "space", [ExportTask(str(session), "mf4", replace=True)]),
            ("car_baseline_roll_1_IMU.csv", csv, "escape", []),
        ):
            (there := tmp_path / place).write_bytes(b"frames")
            tasks.clear()
            app.run_worker(work.export_session(app, str(session)))
            await pilot.pause()
            question = await pressed(pilot, *keys, "space")
            assert f"{place} exists already: replace it?" in question
            await pressed(pilot, answer)
            there.unlink()
            await pilot.pause()
            assert tasks == asked
