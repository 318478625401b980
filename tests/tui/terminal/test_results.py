"""The results screen: verdict first, every page, and what X does."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest
from textual.app import App
from textual.pilot import Pilot

from daq.control.orders import Accept, Build, Mark, Reject
from tui.jobs.lines import Outcome
from tui.terminal.app import BenchApp
from tui.terminal.screens.results import ResultsScreen
from tui.terminal.screens.work import IdentifyScreen, ReportScreen
from tui.terminal.state.glyphs import GlyphSet

from ...identify.results import forces
from .conftest import at_every_size, screen_text
from .fake_recorder import FakeRecorder
from .outcomes import doubtful, outcome, refused

MakeApp = Callable[..., BenchApp]
Snapshot = Callable[[App[None], str], None]
Play = Callable[[Pilot[None]], Awaitable[None]]
PATH = "/bench/session_0001.h5"


def measured() -> FakeRecorder:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check", "masses")
    recorder.finish("baseline")
    recorder.finish("added")
    recorder.changes["session"] = recorder.built(PATH)
    return recorder


def results_of(app: BenchApp) -> ResultsScreen:
    screen = app.get_screen("results")
    assert isinstance(screen, ResultsScreen)
    return screen


def in_front(app: BenchApp, size: tuple[int, int], play: Play, shown: Outcome) -> None:
    """Show an outcome on the results screen, and play upon it."""

    async def act() -> None:
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            results_of(app).show_outcome(shown)
            await app.open("results")
            await pilot.pause()
            await play(pilot)

    asyncio.run(act())


def test_every_page(make_app: MakeApp, snapshot: Snapshot) -> None:
    app = make_app(measured())

    async def play(pilot: Pilot[None]) -> None:
        for page in ("parameters", "modes", "matrices", "decays", "findings"):
            await at_every_size(pilot, snapshot, f"results_{page}")
            await pilot.press("tab")
            await pilot.pause()

    in_front(app, (100, 30), play, outcome())


@pytest.mark.parametrize(("name", "made"), [("doubtful", doubtful), ("refused", refused)])
def test_a_verdict_that_is_not_ok_says_why_and_what_to_do(
    name: str, made: Callable[[], Outcome], make_app: MakeApp, snapshot: Snapshot
) -> None:
    app = make_app(measured(), glyphs=GlyphSet.ASCII)

    async def play(pilot: Pilot[None]) -> None:
        seen = screen_text(app)
        assert name.upper() in seen
        snapshot(app, f"results_{name}_80x24")

    in_front(app, (80, 24), play, made())


def test_the_whole_table_is_seen_without_scrolling_at_80x24(make_app: MakeApp) -> None:
    app = make_app(measured())

    async def play(pilot: Pilot[None]) -> None:
        seen = screen_text(app)
        for name in ("OK", "m_s", "I_yy", "k_sf", "c_sr", "t_r", "SPACE"):
            assert name in seen, name

    in_front(app, (80, 24), play, outcome())


def test_x_rejects_the_chosen_run_and_builds_again(make_app: MakeApp) -> None:
    recorder = measured()
    app = make_app(recorder)

    async def play(pilot: Pilot[None]) -> None:
        await pilot.press("x")
        assert not [o for o in recorder.orders if isinstance(o, Reject)], "no run was in sight"
        await pilot.press("p", "down", "down", "x")
        await pilot.pause()
        rejects = [o for o in recorder.orders if isinstance(o, Reject)]
        assert [r.label for r in rejects] == ["baseline_pitch_1"]
        assert isinstance(recorder.orders[-1], Build)
        assert app.screen is app.get_screen("identify")
        # The same key takes it back.
        await app.open("results")
        await pilot.press("x")
        await pilot.pause()
        accepts = [o for o in recorder.orders if isinstance(o, Accept)]
        assert [a.label for a in accepts] == ["baseline_pitch_1"]
        assert all(a.reason for a in accepts)

    in_front(app, (140, 40), play, outcome())


def test_x_on_a_session_of_the_past_only_tries(
    make_app: MakeApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = measured()
    app = make_app(recorder)
    tried: list[tuple[str, tuple[str, ...]]] = []
    identify = app.get_screen("identify")
    assert isinstance(identify, IdentifyScreen)
    monkeypatch.setattr(identify, "begin", lambda path, without=(): tried.append((path, without)))

    async def play(pilot: Pilot[None]) -> None:
        await pilot.press("p", "x")
        await pilot.pause()
        assert tried == [("/old/session_0009.h5", ("baseline_bounce_1",))]
        assert not [o for o in recorder.orders if isinstance(o, Reject | Build)]

    in_front(app, (80, 24), play, outcome("/old/session_0009.h5"))


def test_space_goes_on_to_the_report_of_this_session(make_app: MakeApp) -> None:
    recorder = measured()
    app = make_app(recorder)

    async def play(pilot: Pilot[None]) -> None:
        await pilot.press("space")
        await pilot.pause()
        report = app.screen
        assert isinstance(report, ReportScreen)
        assert "session_0001.h5" in screen_text(app)
        assert Mark("step identify done") in recorder.orders

    in_front(app, (80, 24), play, outcome())


def test_a_car_with_damper_curves_has_a_page_of_them(make_app: MakeApp) -> None:
    app = make_app(measured())
    shown = outcome()
    shown = replace(shown, result=replace(shown.result, forces=forces()))

    async def play(pilot: Pilot[None]) -> None:
        assert "Dampers" in screen_text(app)
        await pilot.press("shift+tab")
        await pilot.pause()
        assert " Dampers " in screen_text(app)
        assert " +0.05        50.0 ± 9.8" in screen_text(app)
        await pilot.press("tab")
        await pilot.pause()
        assert "sprung mass" in screen_text(app)

    in_front(app, (80, 24), play, shown)


def test_a_linear_car_has_no_page_of_dampers(make_app: MakeApp) -> None:
    app = make_app(measured())

    async def play(pilot: Pilot[None]) -> None:
        assert "Dampers" not in screen_text(app)
        await pilot.pause()

    in_front(app, (80, 24), play, outcome())


def test_findings_say_which_parameters_can_be_used(make_app: MakeApp) -> None:
    app = make_app(measured())

    async def play(pilot: Pilot[None]) -> None:
        for _ in range(4):
            await pilot.press("tab")
        await pilot.pause()
        text = screen_text(app)
        assert "usable, moved by no cause that was sized: I_xx" in text
        assert "lost, run baseline_bounce_2: m_s +4.0 %" in text

    in_front(app, (140, 40), play, doubtful())
