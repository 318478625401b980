"""Steps 6 and 7, and results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import nan

import pytest
from textual.pilot import Pilot

from daq.control.messages import Accept, Build, Mark, Reject, SessionState, SessionStatus, Start
from dbc.words import Finding, InputError, Severity
from tui.jobs.worker import Outcome, identify_session, report_session
from tui.terminal.app import BenchApp
from tui.terminal.screens.results import parameter_rows, verdict_lines
from tui.terminal.screens.work import OUTDATED, IdentifyScreen, ReportScreen
from tui.terminal.widgets import Table

from .fake_recorder import FakeRecorder
from .operated import (
    PATH,
    PLAIN,
    SMALL,
    FakeWorker,
    Make,
    Snapshot,
    asked,
    at_every_size,
    doubtful,
    estimate,
    front,
    judged,
    measured,
    orders_of,
    outcome,
    playing,
    pressed,
    refused,
    results_of,
    seen,
    showing,
    shows,
    until,
)


def identify_of(app: BenchApp) -> IdentifyScreen:
    screen = app.get_screen("identify")
    assert isinstance(screen, IdentifyScreen)
    return screen


async def identified(app: BenchApp, pilot: Pilot[None], recorder: FakeRecorder) -> IdentifyScreen:
    """Build and identify the recording; return the screen that has done so."""
    await app.open("identify")
    await pressed(pilot, "space")
    recorder.publish(session=recorder.built(PATH))
    await until(pilot, lambda: front(app) is results_of(app))
    return identify_of(app)


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
        assert not identify.next_enabled
        now_ns = recorder.status.wall_ns
        recorder.publish(session=recorder.built(PATH), wall_ns=now_ns - 1)
        await pilot.pause()
        assert not worker.tasks, "the file is older than the order"
        recorder.publish(wall_ns=now_ns)
        await until(
            pilot, lambda: [asked(t) for t in worker.tasks] == [(identify_session, (PATH,))]
        )
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
    async with playing(app) as pilot:
        await app.open("identify")
        assert "T Take so far" not in seen(app)
        await pressed(pilot, "t", "space")
        recorder.publish(session=recorder.built(PATH))
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
    worker.trouble = InputError(
        "session_0001.h5", "needs more memory than there is", "end programs"
    )
    async with playing(app) as pilot:
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


async def test_the_next_vehicle_is_identified_anew(make_app: Make, worker: FakeWorker) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with playing(app) as pilot:
        identify = await identified(app, pilot, recorder)
        recorder.publish(recording="1f" * 16)
        await app.open("results")
        assert "SPACE = step 6 Identify" in await pressed(pilot, "tab", "tab", "x"), OUTDATED
        assert "these are the runs of the recording before" in seen(app)
        assert identify.valid_outcome is None
        await pressed(pilot, "space", "space")
        assert isinstance(recorder.orders[-1], Build)


async def test_results_of_another_screen_are_announced(make_app: Make, worker: FakeWorker) -> None:
    recorder = measured()
    app = make_app(recorder)
    worker.hold = True
    async with playing(app) as pilot:
        await app.open("identify")
        await pressed(pilot, "space")
        recorder.publish(session=recorder.built(PATH))
        await until(pilot, lambda: shows(app, "fitting"))
        await app.open("home")
        worker.go.set()
        await until(pilot, lambda: shows(app, "identified: step 6 shows the results"))
        assert front(app) is app.get_screen("home")


def spoil(recorder: FakeRecorder) -> None:
    """Reject the last run, so that the session file is outdated."""
    recorder._carry_out(Reject(recorder.run_log.runs[-1].label, "door slammed"))
    recorder.publish()


async def test_results_that_are_behind_say_so_and_are_built_anew(
    make_app: Make, worker: FakeWorker
) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with playing(app) as pilot:
        await identified(app, pilot, recorder)
        assert "SPACE = step 7 Report" in seen(app)
        spoil(recorder)
        await until(pilot, lambda: shows(app, OUTDATED))
        assert "SPACE = step 6 Identify" in seen(app)
        await pressed(pilot, "space")
        assert app.screen is identify_of(app)
        assert not [order for order in recorder.orders if isinstance(order, Mark)]
        assert OUTDATED in seen(app)
        assert "SPACE = build the session file anew" in seen(app)
        await app.open("report")
        assert OUTDATED in await pressed(pilot, "f1", "f1")
        await pressed(pilot, "space", "space")
        assert isinstance(recorder.orders[-1], Build)


async def test_report_written_and_the_next_vehicle(
    make_app: Make, worker: FakeWorker, snapshot: Snapshot
) -> None:
    recorder = measured()
    recorder.mark("identify")
    app = make_app(recorder)
    worker.hold = True
    async with playing(app, (100, 30)) as pilot:
        await pressed(pilot, "space", "w")
        assert not orders_of(recorder, Start), "the report would count as the next vehicle's"
        worker.go.set()
        await until(pilot, lambda: shows(app, "WRITTEN verdict ok"))
        report = ("/bench/session_0001.html", "/bench/session_0001.pdf")
        assert asked(worker.tasks[-1]) == (report_session, (PATH, *report))
        assert Mark("step report done") in recorder.orders
        await at_every_size(pilot, snapshot, "report")
        await pilot.press("space")
        assert not orders_of(recorder, Start), "SPACE ends nothing"
        await pressed(pilot, "w")
        assert Start() in recorder.orders
        assert app.screen is app.get_screen("vehicle")


async def test_every_page(make_app: Make, snapshot: Snapshot) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with playing(app) as pilot:
        await app.open("results")
        results_of(app).show_outcome(outcome())
        await pilot.pause()
        for name in ("OK", "m_s", "I_yy", "k_sf", "c_sr", "t_r", "SPACE"):
            assert name in seen(app), "the whole table is seen without scrolling"
        for page in ("parameters", "modes", "runs", "findings"):
            await at_every_size(pilot, snapshot, f"results_{page}")
            await pressed(pilot, "tab")
        await pressed(pilot, "tab")
        await pilot.resize_terminal(80, 16)
        await pilot.pause()
        table = results_of(app).query_one("#modes-table", Table)
        for key, row in (("down", 2), ("down", 4), ("up", 2)):
            await pressed(pilot, key)
            assert table.scroll_y == row
        await pressed(pilot, "tab", "down", "down", "up")
        assert results_of(app).query_one("#runs-table", Table).cursor_row == 1
        await pilot.resize_terminal(*SMALL)
        await pilot.pause()
        assert "[6 Identify]" in seen(app)
        assert "SPACE = step 7 Report" in seen(app)
        assert "session_0001.h5" in await pressed(pilot, "space")
        assert isinstance(app.screen, ReportScreen)
        assert Mark("step identify done") in recorder.orders


@pytest.mark.parametrize(("name", "made"), [("doubtful", doubtful), ("refused", refused)])
async def test_a_verdict_that_is_not_ok_says_why_and_what_to_do(
    name: str, made: Callable[[], Outcome], make_app: Make, snapshot: Snapshot
) -> None:
    app = make_app(measured(), glyphs="blocks")
    async with showing(app, SMALL, made()):
        assert name.upper() in seen(app)
        snapshot(app, f"results_{name}_80x24")


async def test_x_rejects_the_chosen_run_and_builds_again(make_app: Make) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with showing(app, (140, 40), outcome()) as pilot:
        assert "choose the run first" in await pressed(pilot, "x")
        await pressed(pilot, "tab", "tab", "down", "down", "x")
        rejects = [o for o in recorder.orders if isinstance(o, Reject)]
        assert [r.label for r in rejects] == ["baseline_pitch_1"]
        assert isinstance(recorder.orders[-1], Build)
        assert app.screen is app.get_screen("identify")
        recorder.publish(session=recorder.built(PATH))
        await app.open("results")  # the same key takes it back
        await pressed(pilot, "x")
        accepts = [o for o in recorder.orders if isinstance(o, Accept)]
        assert [a.label for a in accepts] == ["baseline_pitch_1"]
        assert all(a.reason for a in accepts)


def test_a_table_shows_what_is_known_given_and_not_determined() -> None:
    known = {
        "m_s": estimate(1380.0, 27.6, "kg"),
        "a": estimate(1.25, 0.0, "m"),
        "t_f": estimate(0.74, 9.0, "m"),
    }
    rows = parameter_rows(replace(outcome().result, parameters=known))
    texts = [[str(cell).strip() for cell in row] for row in rows]
    assert texts[0] == ["m_s  sprung mass", "1,380", "kg", "1,352 .. 1,408", "2.0 %"]
    assert texts[1][1:5] == ["1.2500", "m", "", ""]
    assert texts[2][1:4] == ["", "m", "not determined"]


def test_a_verdict_is_one_line_where_it_fits_and_two_where_not() -> None:
    made = outcome()
    whole = "+ OK  The parameters may be used.   12 of 12 runs used   chi2/n 1.016"
    assert verdict_lines(made, PLAIN, len(whole), 9)[0] == whole
    assert verdict_lines(made, PLAIN, len(whole) - 1, 9)[:2] == [
        "+ OK  The parameters may be used.",
        "  12 of 12 runs used   chi2/n 1.016",
    ]
    quality = replace(made.result.quality, chi2_per_n=nan)
    lines = verdict_lines(judged(made, quality), PLAIN, 100, 9)
    assert lines[0].endswith("12 of 12 runs used")
    assert lines[1].startswith("  The model of the car")


def test_a_verdict_says_its_gravest_reasons_and_how_many_lines_are_hidden() -> None:
    doubts = tuple(Finding(f"g{i}", Severity.WARNING, f"reason {i}") for i in range(4))
    note = Finding("note", Severity.NOTE, "began late")
    quality = replace(outcome().result.quality, findings=(*doubts, note))
    made = judged(outcome(), quality)
    lines = verdict_lines(made, PLAIN, 120, 5)
    assert lines[1:] == [f"! DOUBT: reason {i}" for i in range(4)]
    assert len(verdict_lines(made, PLAIN, 120, 4)) == 4
    assert verdict_lines(made, PLAIN, 120, 4)[-1] == "  ... 2 more lines: Tab to Findings"
    notes = judged(outcome(), replace(quality, findings=(note,)))
    assert verdict_lines(notes, PLAIN, 120, 5)[1:] == ["+ note: began late"]
