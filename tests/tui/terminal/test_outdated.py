"""Results and report of a recording that has changed since: the old ones are marked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from textual.pilot import Pilot

from daq.control.orders import Build, Mark, Reject, Undo
from tui.terminal.app import BenchApp
from tui.terminal.screens.results import ResultsScreen
from tui.terminal.screens.work import OUTDATED, IdentifyScreen, LongWork, ReportScreen, Stage
from tui.terminal.state.campaign import BenchStep, progress

from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .outcomes import outcome

MakeApp = Callable[..., BenchApp]
SMALL = (80, 24)


def _done() -> FakeRecorder:
    """Return a recorder whose campaign is complete, with the session file of it."""
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    recorder.mark("masses")
    recorder.finish("added")
    recorder.changes["session"] = recorder.built(outcome().session)
    return recorder


async def _settle(pilot: Pilot[None]) -> None:
    for _ in range(3):
        await pilot.pause()


def _footer(app: BenchApp) -> str:
    return screen_text(app).splitlines()[-1]


def test_a_step_that_was_done_is_due_again_until_that_is_undone() -> None:
    recorder = _done()
    recorder.mark("identify", "report")
    assert progress(recorder.status).due is BenchStep.REPORT
    label = recorder.run_log.runs[-1].label
    recorder._carry_out(Reject(label, "door slammed"))
    reported = progress(recorder.status)
    assert not reported.done & {BenchStep.IDENTIFY, BenchStep.REPORT}
    recorder._carry_out(Undo())  # two changes, not none: what was identified may be either
    assert BenchStep.IDENTIFY not in progress(recorder.status).done
    recorder.mark("identify")
    assert BenchStep.IDENTIFY in progress(recorder.status).done


async def test_a_report_of_runs_that_have_changed_leads_to_step_6(make_app: MakeApp) -> None:
    recorder = _done()
    recorder.mark("identify")
    app = make_app(recorder)
    async with app.run_test(size=SMALL) as pilot:
        await _settle(pilot)
        assert isinstance(app.screen, ReportScreen)
        assert "SPACE = write the report" in screen_text(app)
        assert "Write again" not in _footer(app)  # nothing was written yet
        recorder._carry_out(Reject(recorder.run_log.runs[-1].label, "door slammed"))
        recorder.publish()
        await _settle(pilot)
        assert OUTDATED in screen_text(app)
        await pilot.press("space")
        await _settle(pilot)
        assert isinstance(app.screen, IdentifyScreen)
        assert not [order for order in recorder.orders if isinstance(order, Mark)]


async def test_results_that_are_behind_are_built_anew(make_app: MakeApp) -> None:
    recorder = _done()
    app = make_app(recorder)
    async with app.run_test(size=SMALL) as pilot:
        await _settle(pilot)
        screen = app.screen
        assert isinstance(screen, IdentifyScreen)
        screen.outcome = outcome()
        screen.work = replace(LongWork(Stage.DONE, outcome().session), share=1.0)
        screen.draw()
        assert "SPACE = results" in screen_text(app)
        recorder._carry_out(Reject(recorder.run_log.runs[-1].label, "door slammed"))
        recorder.publish()
        await _settle(pilot)
        assert OUTDATED in screen_text(app)
        assert "SPACE = results" not in screen_text(app)
        await pilot.press("space")
        await _settle(pilot)
        assert isinstance(recorder.orders[-1], Build)


async def test_results_that_are_behind_say_so_and_end_no_step(make_app: MakeApp) -> None:
    recorder = _done()
    app = make_app(recorder)
    async with app.run_test(size=SMALL) as pilot:
        await _settle(pilot)
        screen = app.screen
        assert isinstance(screen, IdentifyScreen)
        screen.outcome = outcome()
        await app.open_results(screen.outcome)
        await _settle(pilot)
        assert isinstance(app.screen, ResultsScreen)
        assert "SPACE = step 7 Report" in screen_text(app)
        recorder._carry_out(Reject(recorder.run_log.runs[-1].label, "door slammed"))
        recorder.publish()
        await _settle(pilot)
        assert OUTDATED in screen_text(app)
        assert "SPACE = step 6 Identify" in screen_text(app)
        await pilot.press("space")
        await _settle(pilot)
        assert isinstance(app.screen, IdentifyScreen)
        assert not [order for order in recorder.orders if isinstance(order, Mark)]
