"""Identify, report, sessions, help, notes, palette: pilot tests and their text at three sizes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from dataclasses import replace

import pytest
from textual.app import App
from textual.pilot import Pilot
from textual.widgets import TextArea

from daq.alarms import EXPLAINED
from daq.control.messages import SessionState, SessionStatus
from daq.control.orders import Build, Mark, Note, Reject, ShutDown, Start
from daq.verdict import WORDS
from tui.jobs.lines import (
    CompareTask,
    Done,
    ExportTask,
    IdentifyTask,
    Item,
    Line,
    ListTask,
    Progress,
    ReportTask,
    Task,
    Trouble,
)
from tui.jobs.session_list import EntryState, SessionEntry
from tui.terminal.app import BenchApp
from tui.terminal.palette import commands
from tui.terminal.screens import sessions, work
from tui.terminal.screens.base import BenchScreen
from tui.terminal.screens.help import SCREEN_PAGES, HelpScreen, page_of
from tui.terminal.screens.work import ReportScreen

from .conftest import at_every_size, screen_text
from .fake_recorder import FakeRecorder
from .outcomes import outcome
from .test_results import measured

MakeApp = Callable[..., BenchApp]
Snapshot = Callable[[App[None], str], None]
Play = Callable[[Pilot[None]], Awaitable[None]]
PATH = "/bench/session_0001.h5"
ENTRIES = (
    SessionEntry("", "/bench", "2026-11-21 10:42", "T5-ABC123", EntryState.CUT_OFF, 5, 1,
                 "rear left damper looks wet", "0f3c" * 8),
    SessionEntry(PATH, "/bench", "2026-11-20 15:01", "T5-ABC123", EntryState.REPORTED, 30, 4, ""),
    SessionEntry("/bench/s2.h5", "/bench", "2026-11-19 09:30", "[@click=app.quit]x[/]",
                 EntryState.READY, 12, 0, "[/foo] \x1b[2J"),
    SessionEntry("/bench/bad.h5", "/bench", "2026-11-18 08:00", "", EntryState.DAMAGED,
                 note="is not an HDF5 file, or is cut off"),
)  # fmt: skip
REPORTED = {"files": {"/bench/session_0001.html": 1_181_489, "/bench/session_0001.pdf": 290_180}}


class FakeWorker:
    """Answers tasks from memory; `hold` keeps the last line back until `go` is set."""

    def __init__(self) -> None:
        self.tasks: list[Task] = []
        self.hold = False
        self.go = asyncio.Event()
        self.trouble: Trouble | None = None

    async def lines_of(self, task: Task, where: str) -> AsyncGenerator[Line, None]:
        self.tasks.append(task)
        if not isinstance(task, ListTask):
            yield Progress(0.1, "reading")
            yield Progress(0.4, "fitting")
            if self.hold:
                await self.go.wait()
            if self.trouble is not None:
                yield self.trouble
                return
        match task:
            case IdentifyTask(path):
                yield Done(outcome(path))
            case ReportTask():
                yield Done({**REPORTED, "verdict": "ok"})
            case CompareTask():
                yield Done({"lines": ["Nothing differs.", "[/foo]"]})
            case ExportTask():
                yield Done({"paths": ["/bench/session_0001.mf4"], "notes": []})
            case ListTask():
                for entry in ENTRIES:
                    yield Item(entry)
                yield Done({"count": len(ENTRIES)})


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch) -> FakeWorker:
    fake = FakeWorker()
    for screen in (sessions, work):
        monkeypatch.setattr(screen, "lines_of", fake.lines_of)
    return fake


def played(app: BenchApp, size: tuple[int, int], play: Play) -> None:
    async def act() -> None:
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await play(pilot)

    asyncio.run(act())


def test_identify_from_space_to_results(
    make_app: MakeApp, worker: FakeWorker, snapshot: Snapshot
) -> None:
    recorder = measured()
    recorder.changes["session"] = SessionStatus()
    app = make_app(recorder)
    worker.hold = True

    async def play(pilot: Pilot[None]) -> None:
        assert app.screen is app.get_screen("identify"), "a complete campaign begins here"
        await at_every_size(pilot, snapshot, "identify")
        await pilot.press("space")
        await pilot.pause()
        assert isinstance(recorder.orders[-1], Build)
        assert not worker.tasks, "there is no file yet"
        recorder.publish(session=recorder.built(PATH))
        await pilot.pause()
        assert worker.tasks == [IdentifyTask(PATH)]
        await pilot.pause()
        await at_every_size(pilot, snapshot, "identify_fitting")
        worker.go.set()
        await pilot.pause()
        await pilot.pause()
        results, identify = app.get_screen("results"), app.get_screen("identify")
        assert app.screen is results
        for key, shown in (("6", results), ("escape", identify), ("3", None), ("6", results)):
            await pilot.press(key)
            await pilot.pause()
            assert shown is None or app.screen is shown, key
        recorder.publish(session=replace(recorder.built(PATH), revision=-1))
        await pilot.pause()
        await pilot.press("6")
        await pilot.pause()
        assert app.screen is identify, "the results are those of an earlier state"

    played(app, (100, 30), play)


def test_a_failed_build_and_a_failed_fit_say_what_to_do(
    make_app: MakeApp, worker: FakeWorker, snapshot: Snapshot
) -> None:
    recorder = measured()
    app = make_app(recorder)
    worker.trouble = Trouble("session_0001.h5", "needs more memory than there is", "end programs")

    async def play(pilot: Pilot[None]) -> None:
        await app.open("identify")
        await pilot.press("space")
        recorder.publish(session=SessionStatus(SessionState.FAILED, "", "no space left on device"))
        await pilot.pause()
        seen = screen_text(app)
        assert "FAILED" in seen
        assert "no space left on device" in seen
        assert "What to do" in seen
        await pilot.press("space")
        recorder.publish(session=recorder.built(PATH))
        await pilot.pause()
        await pilot.pause()
        assert "needs more memory" in screen_text(app)
        assert "end programs" in screen_text(app)
        snapshot(app, "identify_failed_80x24")

    played(app, (80, 24), play)


def test_report_written_and_the_next_vehicle(
    make_app: MakeApp, worker: FakeWorker, snapshot: Snapshot
) -> None:
    recorder = measured()
    recorder.mark("identify")
    app = make_app(recorder)

    async def play(pilot: Pilot[None]) -> None:
        report = app.screen
        assert isinstance(report, ReportScreen)
        assert report.ready
        await pilot.press("space")
        await pilot.pause()
        await pilot.pause()
        task = worker.tasks[-1]
        assert isinstance(task, ReportTask)
        assert task.html == "/bench/session_0001.html"
        assert task.pdf == "/bench/session_0001.pdf"
        assert Mark("step report done") in recorder.orders
        assert not report.ready
        await at_every_size(pilot, snapshot, "report")
        await pilot.press("space")
        assert not [o for o in recorder.orders if isinstance(o, Start)], "SPACE ends nothing"
        await pilot.press("w")
        await pilot.pause()
        assert isinstance(recorder.orders[-1], Start) or Start() in recorder.orders
        assert app.screen is app.get_screen("vehicle")

    played(app, (100, 30), play)


def test_sessions(make_app: MakeApp, worker: FakeWorker, snapshot: Snapshot) -> None:
    app = make_app(measured())

    async def play(pilot: Pilot[None]) -> None:
        await app.action_sessions()
        await pilot.pause()
        await pilot.pause()
        seen = screen_text(app)
        for text in ("open", "reported", "damaged", "[/foo]", "[@click="):
            assert text in seen, text
        assert "\x1b" not in seen
        await at_every_size(pilot, snapshot, "sessions")

    played(app, (100, 30), play)


def test_sessions_are_found_opened_compared_and_exported(
    make_app: MakeApp, worker: FakeWorker
) -> None:
    app = make_app(measured())

    async def play(pilot: Pilot[None]) -> None:
        await app.action_sessions()
        await pilot.pause()
        await pilot.pause()
        await pilot.press("f", *"reported")
        await pilot.pause()
        seen = screen_text(app)
        assert "2026-11-20" in seen
        assert "2026-11-19" not in seen
        await pilot.press("escape")
        await pilot.pause()
        await pilot.press("c", "down", "c")  # the one that was found stays chosen
        await pilot.pause()
        await pilot.pause()
        assert CompareTask((PATH, "/bench/s2.h5")) in worker.tasks
        assert "[/foo]" in screen_text(app)
        await pilot.press("escape", "e")
        await pilot.pause()
        await pilot.press("enter")
        await pilot.pause()
        assert worker.tasks[-1] == ExportTask("/bench/s2.h5", "mf4")
        await pilot.press("v")
        await pilot.pause()
        assert "--replay" in screen_text(app)
        await pilot.press("escape", "o")
        await pilot.pause()
        await pilot.pause()
        assert IdentifyTask("/bench/s2.h5") in worker.tasks
        assert app.screen is app.get_screen("results")
        await app.action_sessions()
        await pilot.pause()
        await pilot.press("r")
        await pilot.pause()
        assert isinstance(worker.tasks[-1], ReportTask)

    played(app, (80, 24), play)


@pytest.mark.parametrize("name", [*SCREEN_PAGES, *WORDS, *EXPLAINED])
def test_there_is_help_for_everything(name: str) -> None:
    page = page_of(name)
    assert page.startswith("# ")
    assert len(page) > 80
    assert "no page for this" not in page
    for table in (WORDS, EXPLAINED):
        if name in table:
            assert table[name].advice.rstrip(".")[1:] in page


def test_every_screen_names_a_page_of_help(make_app: MakeApp) -> None:
    app = make_app(FakeRecorder())
    for name in app.SCREENS:
        screen = app.get_screen(name)
        assert isinstance(screen, BenchScreen)
        assert screen.HELP_PAGE in SCREEN_PAGES


def test_help_shows_the_keys_of_the_screen(
    make_app: MakeApp, worker: FakeWorker, snapshot: Snapshot
) -> None:
    app = make_app(measured())

    async def play(pilot: Pilot[None]) -> None:
        await pilot.press("f1")
        await pilot.pause()
        assert isinstance(app.screen, HelpScreen)
        await at_every_size(pilot, snapshot, "help_identify")
        await pilot.press("escape")
        await pilot.pause()
        assert not isinstance(app.screen, HelpScreen)
        app.show_help("double_bump")
        await pilot.pause()
        assert "bumped twice" in screen_text(app)

    played(app, (100, 30), play)


def test_a_note_outlives_the_dialog_and_a_refusal(make_app: MakeApp, snapshot: Snapshot) -> None:
    recorder = measured()
    app = make_app(recorder)

    async def play(pilot: Pilot[None]) -> None:
        await pilot.press("n")
        await pilot.pause()
        await pilot.press(*"wet [b] 7")
        await pilot.pause()
        snapshot(app, "note_80x24")
        await pilot.press("escape")
        await pilot.pause()
        await pilot.press("n")
        await pilot.pause()
        assert app.screen.query_one(TextArea).text == "wet [b] 7"
        recorder.refuse = "JL is in control"
        await pilot.press("ctrl+s")
        await pilot.pause()
        assert app.screen.query_one(TextArea).text == "wet [b] 7"
        recorder.refuse = ""
        await pilot.press("ctrl+r", "ctrl+s")
        await pilot.pause()
        last = recorder.run_log.runs[-1].label
        assert Note("wet [b] 7", last) in recorder.orders
        await pilot.press("n")
        await pilot.pause()
        assert app.screen.query_one(TextArea).text == ""

    played(app, (80, 24), play)


def test_the_commands_of_the_palette_act(make_app: MakeApp, worker: FakeWorker) -> None:
    recorder = measured()
    app = make_app(recorder)

    async def do(name: str) -> None:
        act = next(act for found, _, act in commands(app) if found == name)
        made = act()
        if isinstance(made, Awaitable):
            await made

    async def play(pilot: Pilot[None]) -> None:
        names = [name for name, _, _ in commands(app)]
        assert len(set(names)) == len(names)
        assert all(": " in name for name in names)
        await do("run: reject last")
        assert isinstance(recorder.orders[-1], Reject)
        await do("theme: bench-light")
        assert app.theme == "bench-light"
        await do("session: list")
        await pilot.pause()
        assert app.screen is app.get_screen("sessions")
        assert "session: export" in [name for name, _, _ in commands(app)]
        await do("help: this screen")
        await pilot.pause()
        assert isinstance(app.screen, HelpScreen)
        await pilot.press("escape", "ctrl+p")
        await pilot.press(*"undo")
        await pilot.pause(0.3)
        assert "run: undo" in screen_text(app)
        await do("recorder: shut down")
        assert isinstance(recorder.orders[-1], ShutDown)
        assert app._exit

    played(app, (80, 24), play)
