"""The identify screen beside other screens, kept results, and screens without a recorder."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from pathlib import Path

import pytest

from daq.control.client import OrderRefusedError
from daq.control.messages import Reply, SessionStatus
from daq.control.orders import Order
from tui.jobs.lines import Done, IdentifyTask, Line, Progress, Task
from tui.terminal.screens import work
from tui.terminal.screens.work import IdentifyScreen, Stage
from tui.terminal.state.campaign import BenchStep
from tui.terminal.state.feed import Lost

from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .operated import Make, shows, until
from .outcomes import outcome
from .test_results import PATH, measured, results_of
from .test_step_keys import front, pressed, seen


@pytest.fixture
def tasks(monkeypatch: pytest.MonkeyPatch) -> list[Task]:
    """Return the tasks that are given to workers, which answer each at once."""
    given: list[Task] = []

    async def lines_of(task: Task, where: str) -> AsyncGenerator[Line, None]:
        given.append(task)
        assert isinstance(task, IdentifyTask)
        yield Progress(0.4, "fitting")
        yield Done(outcome(task.session))

    monkeypatch.setattr(work, "lines_of", lines_of)
    return given


async def test_a_result_is_kept_until_its_file_changes(
    make_app: Make, tasks: list[Task], tmp_path: Path
) -> None:
    app = make_app(measured())
    path = tmp_path / "s.h5"
    path.write_text("one")
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        for _ in range(2):
            await app.open_identify(str(path))
            await until(pilot, lambda: front(app) is results_of(app))
        assert tasks == [IdentifyTask(str(path))]
        await app.open_identify(str(path), ("baseline_roll_1",))
        await until(pilot, lambda: front(app) is results_of(app))
        path.unlink()
        await app.open_identify(str(path))
        await until(pilot, lambda: front(app) is results_of(app))
        assert len(tasks) == 3
        assert results_of(app).step_shown is None
        screen = app.get_screen("identify")
        assert isinstance(screen, IdentifyScreen)
        assert screen.step_shown is None, "a session of the past"
        assert screen.work.share == 1.0
        await app.open("identify")
        assert "Session s.h5" in seen(app)
        await pressed(pilot, "space")
        assert front(app) is results_of(app), "SPACE shows the results again"
        assert len(tasks) == 3


async def test_an_identification_that_ends_behind_another_screen_says_so(
    make_app: Make, tasks: list[Task]
) -> None:
    app = make_app(measured())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        screen = app.get_screen("identify")
        assert isinstance(screen, IdentifyScreen)
        await app.open("home")
        screen.begin(PATH)
        await until(pilot, lambda: shows(app, "identified: step 6 shows the results"))
        assert front(app) is app.get_screen("home")
        assert screen.step_shown is BenchStep.IDENTIFY


async def test_a_session_file_that_is_older_than_the_order_is_not_taken(
    make_app: Make, tasks: list[Task]
) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        screen = front(app)
        assert isinstance(screen, IdentifyScreen)
        await pressed(pilot, "space")
        assert screen.work.stage is Stage.BUILDING
        assert not screen.acts
        now_ns = recorder.status.wall_ns
        recorder.publish(session=recorder.built(PATH), wall_ns=now_ns - 1)
        await pilot.pause()
        assert tasks == []
        recorder.publish(wall_ns=now_ns)
        await until(pilot, lambda: bool(tasks))
        await until(pilot, lambda: front(app) is results_of(app))


async def test_the_screen_says_what_was_recorded_and_when_it_is_outdated(
    make_app: Make, tasks: list[Task]
) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        said = screen_text(app)
        assert "12 runs accepted, 0 rejected (kept)" in said
        assert "✓ baseline bounce      2 of 2 accepted" in said
        assert f"session file: {PATH}" in said
        await app.open_identify(PATH)
        await until(pilot, lambda: front(app) is results_of(app))
        recorder.mark("masses")
        recorder.choose("added", recorder.status.tallies[0].excitation)
        recorder.bump()
        recorder.publish()
        await app.open("identify")
        await until(pilot, lambda: shows(app, "have changed since the session file was built"))
        assert "SPACE = build the session file anew" in seen(app)
        recorder.publish(session=SessionStatus())
        await pilot.pause()
        assert "session file:" not in screen_text(app)


async def test_a_screen_without_any_status_says_that_the_recorder_is_lost(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = FakeRecorder()
    monkeypatch.setattr(recorder, "start", lambda post: None)
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        app.post(Lost("no recorder is running there", "start one"))
        await until(pilot, lambda: shows(app, "RECORDER LOST: X = start it again"))
        assert "X Start recorder" in screen_text(app)
        await app.open("check")
        await pilot.pause()
        assert "RECORDER LOST" in screen_text(app).splitlines()[0]
        await app.open("identify")
        await until(pilot, lambda: shows(app, "waiting for the recorder"))

        def refused() -> None:
            raise OrderRefusedError("the recorder there has not ended")

        monkeypatch.setattr(recorder, "restart", refused)
        await pilot.press("x")
        await until(pilot, lambda: shows(app, "the recorder there has not ended"))


async def test_a_bench_that_the_recorder_refuses_is_asked_for_again(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = FakeRecorder()
    asked: list[Order] = []
    app = make_app(recorder)
    ask = recorder.ask

    async def late(order: Order) -> Reply:
        asked.append(order)
        if len(asked) < 3:
            raise OrderRefusedError("not yet")
        return await ask(order)

    monkeypatch.setattr(recorder, "ask", late)
    async with app.run_test(size=(80, 24)) as pilot:
        await until(pilot, lambda: len(asked) >= 2)
        assert app.bench is None
        recorder.publish()
        await until(pilot, lambda: app.bench is not None)
        assert app.bench_text == recorder.bench_text
