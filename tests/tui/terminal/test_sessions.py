"""The list of sessions: search, open, compare, export; and what cannot be used."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from pathlib import Path

import pytest
from textual.pilot import Pilot

from daq.control.messages import SessionState, SessionStatus
from tui.jobs.lines import (
    CompareTask,
    ExportTask,
    IdentifyTask,
    Line,
    ListTask,
    ReportTask,
    Task,
    Trouble,
)
from tui.jobs.session_list import EntryState, SessionEntry
from tui.terminal.app import BenchApp
from tui.terminal.screens import sessions, work
from tui.terminal.screens.sessions import SessionsScreen
from tui.terminal.widgets import Table

from .conftest import screen_text
from .operated import (
    FakeWorker,
    Make,
    Snapshot,
    at_every_size,
    cursor,
    front,
    measured,
    playing,
    pressed,
    results_of,
    seen,
    shows,
    until,
)

ENTRIES = (
    SessionEntry("", "/b", "2026-11-21 10:42", "T5", EntryState.CUT_OFF, 5, 1, "", "r9"),
    SessionEntry("", "/b", "2026-11-21 10:41", "T5", EntryState.DAMAGED, note="is cut off"),
    SessionEntry("", "/b", "2026-11-21 10:40", "T4", EntryState.OPEN, 5, 1, "", "r8"),
    SessionEntry("/b/s1.h5", "/b", "2026-11-20 15:01", "T3", EntryState.READY, 30, 4, "wet"),
    SessionEntry("/b/s2.h5", "/b", "2026-11-19 15:01", "[@click=app.quit]x[/]",
                 EntryState.REPORTED, 30, 4, "[/foo] \x1b[2J"),
)  # fmt: skip


@pytest.fixture(autouse=True)
def _entries(worker: FakeWorker) -> None:
    worker.entries = ENTRIES


async def opened(pilot: Pilot[None]) -> SessionsScreen:
    app = pilot.app
    assert isinstance(app, BenchApp)
    await app.action_sessions()
    await until(pilot, lambda: shows(app, "2026-11-19"))
    assert isinstance(app.screen, SessionsScreen)
    return app.screen


async def test_the_list_shows_foreign_text_and_follows_the_recording(
    make_app: Make, worker: FakeWorker, snapshot: Snapshot
) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with playing(app, (100, 30)) as pilot:
        screen = await opened(pilot)
        assert "[@click=" in seen(app)
        assert "[/foo]" in seen(app)
        assert "\x1b" not in screen_text(app)
        await at_every_size(pilot, snapshot, "sessions")
        await pilot.resize_terminal(100, 30)
        await pilot.pause()
        assert "! cut off" in seen(app)
        assert "/b/journal" in seen(app)
        recorder.publish(recording="r9")
        await until(pilot, lambda: shows(app, "2026-11-21 10:42 T5 ● open"))
        assert "/b/s2.h5" in await pressed(pilot, "end")
        said = await pressed(pilot, "v")
        assert "bumpbench tui --replay '/b/s2.h5'" in said
        await pressed(pilot, "space")
        assert front(app) is screen
        read = len(worker.tasks)
        await pressed(pilot, "escape", "s")
        assert len(worker.tasks) == read + 1, "after another screen the folder is read again"
        assert (front(app), cursor(app)) == (screen, 4), "the mark stays"
        await pressed(pilot, "v", "escape")
        assert len(worker.tasks) == read + 1, "after a dialog it is not"


async def test_a_session_that_is_no_file_says_why_it_cannot_be_used(
    make_app: Make, worker: FakeWorker
) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with playing(app, (100, 30)) as pilot:
        screen = await opened(pilot)
        assert (screen.acts, screen.ready) == (True, False)
        assert "this recording was cut off" in await pressed(pilot, "space")
        assert "there is no session file yet: step 6" in await pressed(pilot, "r")
        ready = SessionStatus(SessionState.READY, "/b/s2.h5", recording="r9")
        recorder.publish(recording="r9", session=ready)
        await pilot.pause()
        assert "this line is the recording itself: mark that of s2.h5" in await pressed(pilot, "r")
        assert "is cut off" in await pressed(pilot, "down", "e")
        assert front(app) is screen
        recorder.publish(recording="r8")
        await pilot.pause()
        await pressed(pilot, "down", "space")
        assert front(app) is not screen, "the step of the recording that goes on"
        assert [type(task) for task in worker.tasks] == [ListTask]


async def test_sessions_are_found_opened_compared_and_exported(
    make_app: Make, worker: FakeWorker
) -> None:
    app = make_app(measured())
    async with playing(app, (80, 24)) as pilot:
        screen = await opened(pilot)
        said = await pressed(pilot, "f", *"t3 wet")
        assert "/b/s1.h5" in said
        assert "2026-11-19" not in said
        await pressed(pilot, "enter")
        assert app.focused is screen.query_one(Table)
        assert "2026-11-19" in await pressed(pilot, "escape")
        assert "now choose the second" in await pressed(pilot, "c"), "the found one stays chosen"
        assert "now choose the second" not in await pressed(pilot, "c")
        await pressed(pilot, "c", "down", "c")
        await until(pilot, lambda: CompareTask(("/b/s1.h5", "/b/s2.h5")) in worker.tasks)
        assert "Nothing differs. [/foo]" in seen(app).replace("│ ", "")
        await pressed(pilot, "escape", "e")
        await pressed(pilot, "down", "enter")
        assert worker.tasks[-1] == ExportTask("/b/s2.h5", "mat")
        await pressed(pilot, "o")
        await until(pilot, lambda: front(app) is results_of(app))
        assert IdentifyTask("/b/s2.h5") in worker.tasks
        await app.action_sessions()
        await pressed(pilot, "r")
        await until(pilot, lambda: isinstance(worker.tasks[-1], ReportTask))
        screen = await opened(pilot)
        assert "no session matches" in await pressed(pilot, "f", *"escort")
        assert not screen.acts
        await pressed(pilot, "enter", "space", "r", "e", "v", "c")
        assert front(app) is screen
        await pressed(pilot, "escape", "escape")
        assert app.screen is app.get_screen("home")


async def test_trouble_of_a_worker_is_shown(
    make_app: Make, worker: FakeWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = make_app(measured())
    worker.trouble = Trouble("s2.h5", "needs more memory", "end other programs")
    async with playing(app, (100, 30)) as pilot:
        await opened(pilot)
        await pressed(pilot, "end", "c", "up", "c")
        await until(pilot, lambda: shows(app, "needs more memory"))
        await app.action_home()

        async def lines_of(_: Task, where: str) -> AsyncGenerator[Line, None]:
            yield Trouble(where, "no process to work in", "end other programs")

        monkeypatch.setattr(sessions, "lines_of", lines_of)
        await app.action_sessions()
        await until(pilot, lambda: shows(app, "no process to work in"))


async def test_an_export_asks_before_it_replaces_a_file(
    make_app: Make, worker: FakeWorker, tmp_path: Path
) -> None:
    """A log of that name may be the one from which the session was imported."""
    session = tmp_path / "car.h5"
    app = make_app(measured())
    async with playing(app, (100, 30)) as pilot:
        csv = ["down", "down", "down"]
        for place, keys, answer, asked in (
            ("car.mf4", [], "escape", []),
            ("car.mf4", [], "space", [ExportTask(str(session), "mf4", replace=True)]),
            ("car_baseline_roll_1_IMU.csv", csv, "escape", []),
        ):
            (there := tmp_path / place).write_bytes(b"frames")
            worker.tasks.clear()
            app.run_worker(work.export_session(app, str(session)))
            await pilot.pause()
            question = await pressed(pilot, *keys, "space")
            assert f"{place} exists already: replace it?" in question
            await pressed(pilot, answer)
            there.unlink()
            assert worker.tasks == asked
