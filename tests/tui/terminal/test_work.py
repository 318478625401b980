"""Work on session files: identify, report, the list of sessions, real workers."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from dataclasses import replace
from pathlib import Path

import pytest
from textual.pilot import Pilot

import daq
from daq.control.messages import Build, Mark, Reject, SessionState, SessionStatus, Start, Undo
from daq.runs import RunStatus
from daq.vehicle import FORD_GRANADA
from tui.jobs.session_list import EntryState, SessionEntry
from tui.jobs.worker import IdentifyTask, Line, ListTask, ReportTask, Task, Trouble
from tui.terminal.app import BenchApp
from tui.terminal.campaign import BenchStep, progress
from tui.terminal.screens import results
from tui.terminal.screens.results import SessionsScreen
from tui.terminal.screens.work import (
    OUTDATED,
    IdentifyScreen,
    ReportScreen,
    Stage,
    open_identify,
)

from ...identify.stress import stress_session
from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .operated import (
    PATH,
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

SMALL = (80, 24)


def identify_of(app: BenchApp) -> IdentifyScreen:
    screen = app.get_screen("identify")
    assert isinstance(screen, IdentifyScreen)
    return screen


async def test_from_space_to_results(
    make_app: Make, worker: FakeWorker, snapshot: Snapshot
) -> None:
    recorder = measured()
    recorder.changes["session"] = SessionStatus()
    app = make_app(recorder)
    worker.hold = True
    async with playing(app, (100, 30)) as pilot:
        identify = identify_of(app)
        assert app.screen is identify, "a complete campaign begins here"
        assert "12 runs accepted, 0 rejected (kept)" in seen(app)
        await at_every_size(pilot, snapshot, "identify")
        await pressed(pilot, "space")
        assert isinstance(recorder.orders[-1], Build)
        assert not identify.acts
        now_ns = recorder.status.wall_ns
        recorder.publish(session=recorder.built(PATH), wall_ns=now_ns - 1)
        await pilot.pause()
        assert not worker.tasks, "the file is older than the order"
        recorder.publish(wall_ns=now_ns)
        await until(pilot, lambda: worker.tasks == [IdentifyTask(PATH)])
        await until(pilot, lambda: shows(app, "fitting"))
        assert "40%" in seen(app)
        assert "Esc stops it; nothing is lost" in seen(app)
        worker.go.set()
        await until(pilot, lambda: app.screen is results_of(app))
        for key, shown in (("6", results_of(app)), ("escape", identify), ("3", None),
                           ("6", results_of(app))):  # fmt: skip
            await pressed(pilot, key)
            assert shown is None or app.screen is shown, key
        recorder.publish(session=replace(recorder.built(PATH), revision=-1))
        await pilot.pause()
        await pressed(pilot, "6")
        assert app.screen is identify, "the results are those of an earlier state"


async def test_the_answer_so_far_is_shown_and_taken(make_app: Make, worker: FakeWorker) -> None:
    recorder = measured()
    app = make_app(recorder)
    worker.finds = True
    async with playing(app, SMALL) as pilot:
        await app.open("identify")
        assert "T Take so far" not in seen(app)
        await pressed(pilot, "t")
        identify_of(app).begin(PATH)
        await until(pilot, lambda: shows(app, "so far: body 1,380 kg"))
        assert "T takes the answer so far, Esc stops; nothing is lost" in seen(app)
        recorder.publish()
        await until(pilot, lambda: shows(app, "T Take so far"))
        await pressed(pilot, "t")
        await until(pilot, lambda: app.screen is results_of(app))


async def test_a_failed_build_and_a_failed_fit_say_what_to_do(
    make_app: Make, worker: FakeWorker
) -> None:
    recorder = measured()
    app = make_app(recorder)
    worker.trouble = Trouble("session_0001.h5", "needs more memory than there is", "end programs")
    async with playing(app, SMALL) as pilot:
        await app.open("identify")
        await pilot.press("space")
        recorder.publish(session=SessionStatus(SessionState.FAILED, "", "no space left on device"))
        await until(pilot, lambda: shows(app, "FAILED no space left on device"))
        assert "What to do" in seen(app)
        await pilot.press("space")
        recorder.publish(session=recorder.built(PATH))
        await until(pilot, lambda: shows(app, "needs more memory"))
        assert "end programs" in seen(app)
        assert "SPACE = try again" in seen(app)


async def test_a_result_is_kept_until_its_file_changes(
    make_app: Make, worker: FakeWorker, tmp_path: Path
) -> None:
    app = make_app(measured())
    path = tmp_path / "s.h5"
    path.write_text("one")

    async with playing(app, SMALL) as pilot:
        for _ in range(2):
            await open_identify(app, str(path))
            await until(pilot, lambda: front(app) is results_of(app))
            assert len(worker.tasks) == 1
        path.write_text("another")
        await open_identify(app, str(path))
        await until(pilot, lambda: len(worker.tasks) == 2 and front(app) is results_of(app))
        assert results_of(app).step_shown is identify_of(app).step_shown is None, "of the past"
        await app.open("identify")
        assert "Session s.h5" in seen(app)
        await pressed(pilot, "space")
        assert front(app) is results_of(app), "SPACE shows the results again"
        await app.open("home")
        identify_of(app).begin(PATH)
        await until(pilot, lambda: shows(app, "identified: step 6 shows the results"))
        assert front(app) is app.get_screen("home")
        assert identify_of(app).step_shown is BenchStep.IDENTIFY


def test_a_step_that_was_done_is_due_again_until_that_is_undone() -> None:
    recorder = measured()
    recorder.mark("identify", "report")
    assert progress(recorder.status).due is BenchStep.REPORT
    recorder._carry_out(Reject(recorder.run_log.runs[-1].label, "door slammed"))
    assert not progress(recorder.status).done & {BenchStep.IDENTIFY, BenchStep.REPORT}
    recorder._carry_out(Undo())  # two changes, not none: what was identified may be either
    assert BenchStep.IDENTIFY not in progress(recorder.status).done
    recorder.mark("identify")
    assert BenchStep.IDENTIFY in progress(recorder.status).done


def spoil(recorder: FakeRecorder) -> None:
    """Reject the last run, so that the session file is outdated."""
    recorder._carry_out(Reject(recorder.run_log.runs[-1].label, "door slammed"))
    recorder.publish()


async def test_a_report_of_runs_that_have_changed_leads_to_step_6(make_app: Make) -> None:
    recorder = measured()
    recorder.mark("identify")
    app = make_app(recorder)
    async with playing(app, SMALL) as pilot:
        assert isinstance(app.screen, ReportScreen)
        assert "SPACE = write the report" in seen(app)
        assert "Write again" not in seen(app), "nothing was written yet"
        spoil(recorder)
        await until(pilot, lambda: shows(app, OUTDATED))
        await pressed(pilot, "space")
        assert isinstance(app.screen, IdentifyScreen)
        assert not [order for order in recorder.orders if isinstance(order, Mark)]


async def test_results_that_are_behind_say_so_and_are_built_anew(
    make_app: Make, worker: FakeWorker
) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with playing(app, SMALL) as pilot:
        identify_of(app).begin(PATH)
        await until(pilot, lambda: shows(app, "SPACE = step 7 Report"))
        spoil(recorder)
        await until(pilot, lambda: shows(app, OUTDATED))
        assert "SPACE = step 6 Identify" in seen(app)
        await pressed(pilot, "space")
        assert app.screen is identify_of(app)
        assert not [order for order in recorder.orders if isinstance(order, Mark)]
        assert OUTDATED in seen(app)
        assert "SPACE = build the session file anew" in seen(app)
        await pressed(pilot, "space")
        assert isinstance(recorder.orders[-1], Build)


async def test_identify_and_report_act_by_their_stage(make_app: Make, worker: FakeWorker) -> None:
    app = make_app(measured())
    async with playing(app, SMALL) as pilot:
        identify, report = identify_of(app), app.get_screen("report")
        assert isinstance(report, ReportScreen)
        await app.open("report")
        report._written = {"verdict": "ok", "files": {"/b/s.html": 2048}}
        for stage, acts, ready in (
            (Stage.IDLE, True, True),
            (Stage.WORKING, False, False),
            (Stage.DONE, True, True),
            (Stage.FAILED, True, False),
        ):
            identify.stage = report.stage = stage
            assert (identify.acts, identify.ready) == (acts, ready), stage
            done = stage is Stage.DONE
            assert (report.acts, report.ready) == (acts and not done, stage is Stage.IDLE)
            assert report.check_action("again", ()) is (stage in (Stage.DONE, Stage.FAILED))
        report.stage = Stage.WORKING
        await pressed(pilot, "escape")
        assert (front(app), report.stage) == (report, Stage.IDLE), "the work ends first"
        await pressed(pilot, "escape")
        assert front(app) is app.get_screen("home")


async def test_report_written_and_the_next_vehicle(
    make_app: Make, worker: FakeWorker, snapshot: Snapshot
) -> None:
    recorder = measured()
    recorder.mark("identify")
    app = make_app(recorder)
    async with playing(app, (100, 30)) as pilot:
        await pilot.press("space")
        await until(pilot, lambda: shows(app, "WRITTEN verdict ok"))
        task = worker.tasks[-1]
        assert isinstance(task, ReportTask)
        assert (task.html, task.pdf) == ("/bench/session_0001.html", "/bench/session_0001.pdf")
        assert Mark("step report done") in recorder.orders
        await at_every_size(pilot, snapshot, "report")
        await pilot.press("space")
        assert not [o for o in recorder.orders if isinstance(o, Start)], "SPACE ends nothing"
        await pressed(pilot, "w")
        assert Start() in recorder.orders
        assert app.screen is app.get_screen("vehicle")


async def test_real_sessions_from_the_list_to_report_and_results(
    make_app: Make, tmp_path: Path
) -> None:
    whole = stress_session("linear", 2, 100.0)
    runs = tuple(run for run in whole.runs if run.repeat == 1)
    vehicle = replace(whole.vehicle, name="[bold]T5[/]\x1b[31m")
    daq.write_session(tmp_path / "session_0001.h5", replace(whole, runs=runs, vehicle=vehicle))
    unused = tuple(replace(run, status=RunStatus.REJECTED, reasons=("cut",)) for run in runs)
    spoilt = replace(whole, runs=unused, vehicle=replace(vehicle, name="spoilt"))
    daq.write_session(tmp_path / "session_0002.h5", spoilt)  # its report has little to draw
    app = make_app(FakeRecorder())
    async with playing(app, (140, 40)) as pilot:
        await app.action_sessions()
        await until(pilot, lambda: shows(app, "spoilt"))
        assert "[bold]T5[/]\\x1b[31m" in screen_text(app)
        await pilot.press("r")
        await until(pilot, lambda: shows(app, "WRITTEN verdict refused"))
        await app.action_sessions()
        await until(pilot, lambda: shows(app, "reported"))
        await pilot.press("down", "space")
        await until(pilot, lambda: app.screen is results_of(app))
        await pilot.pause()
        assert "6 of 6 runs used" in seen(app)
        outcome = results_of(app).outcome
    assert outcome is not None
    for name in ("m_s", "k_sf", "c_sr"):  # what crossed the pipe is the car of the simulation
        e = outcome.result.parameters[name]
        assert abs(e.value - getattr(FORD_GRANADA, name)) < 6 * e.std
    assert outcome.result.estimation is None
    assert "no accepted run" in (tmp_path / "session_0002.html").read_text("utf-8")
    assert (tmp_path / "session_0002.pdf").read_bytes().startswith(b"%PDF")


# The list of sessions -----------------------------------------------------------------------------

ENTRIES = (
    SessionEntry("", "/b", "2026-11-21 10:42", "T5", EntryState.CUT_OFF, 5, 1, "", "r9"),
    SessionEntry("", "/b", "2026-11-21 10:41", "T5", EntryState.DAMAGED, note="is cut off"),
    SessionEntry("", "/b", "2026-11-21 10:40", "T4", EntryState.OPEN, 5, 1, "", "r8"),
    SessionEntry("/b/s1.h5", "/b", "2026-11-20 15:01", "T3", EntryState.READY, 30, 4, "wet"),
    SessionEntry("/b/s2.h5", "/b", "2026-11-19 15:01", "[@click=app.quit]x[/]",
                 EntryState.REPORTED, 30, 4, "[/foo] \x1b[2J"),
)  # fmt: skip


@pytest.fixture
def listing(worker: FakeWorker) -> FakeWorker:
    worker.entries = ENTRIES
    return worker


async def opened(pilot: Pilot[None]) -> SessionsScreen:
    app = pilot.app
    assert isinstance(app, BenchApp)
    await app.action_sessions()
    await until(pilot, lambda: shows(app, "2026-11-19"))
    assert isinstance(app.screen, SessionsScreen)
    return app.screen


async def test_the_list_shows_foreign_text_and_follows_the_recording(
    make_app: Make, listing: FakeWorker, snapshot: Snapshot
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
        read = len(listing.tasks)
        await pressed(pilot, "escape", "s")
        assert len(listing.tasks) == read + 1, "the folder is read again"
        assert (front(app), cursor(app)) == (screen, 4), "the mark stays"


async def test_a_session_that_is_no_file_says_why_it_cannot_be_used(
    make_app: Make, listing: FakeWorker
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
        assert "is cut off" in await pressed(pilot, "down", "r")
        assert front(app) is screen
        recorder.publish(recording="r8")
        await pilot.pause()
        await pressed(pilot, "down", "space")
        assert front(app) is not screen, "the step of the recording that goes on"
        assert [type(task) for task in listing.tasks] == [ListTask]


async def test_a_session_is_opened_and_reported(make_app: Make, listing: FakeWorker) -> None:
    app = make_app(measured())
    async with playing(app, (80, 24)) as pilot:
        await opened(pilot)
        await pressed(pilot, "end", "o")
        await until(pilot, lambda: front(app) is results_of(app))
        assert IdentifyTask("/b/s2.h5") in listing.tasks
        await opened(pilot)
        await pressed(pilot, "r")
        await until(pilot, lambda: isinstance(listing.tasks[-1], ReportTask))


async def test_trouble_of_the_list_is_shown(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def lines_of(_: Task, where: str, __: object = None) -> AsyncGenerator[Line, None]:
        yield Trouble(where, "no process to work in", "end other programs")

    monkeypatch.setattr(results, "lines_of", lines_of)
    app = make_app(measured())
    async with playing(app, (100, 30)) as pilot:
        await app.action_sessions()
        await until(pilot, lambda: shows(app, "no process to work in"))
