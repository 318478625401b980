"""Input in the order in which it came: bursts as of a bar-code scanner or a line that lags."""

from __future__ import annotations

import pytest
from textual.widgets import Input

from daq.control.messages import Accept, Note, Phase
from tui.terminal.app import BenchApp
from tui.terminal.form import Form
from tui.terminal.screens.bumping import HomeScreen
from tui.terminal.screens.masses import MassesScreen
from tui.terminal.screens.results import SessionsScreen
from tui.terminal.screens.vehicle import VehicleScreen
from tui.terminal.widgets import Confirm

from .bursts import burst
from .fake_recorder import DOUBLE_BUMP, FakeRecorder
from .operated import Make, check_items, orders_of, reach


def _typed(app: BenchApp) -> dict[str, str]:
    return app.screen.query_one(Form).values


async def test_a_tab_in_a_burst_parts_two_fields(make_app: Make) -> None:
    app = make_app(FakeRecorder())
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        await burst(pilot, "tab", "tab", "tab", *"1551", "tab", *"2")
        assert _typed(app)["total_mass_kg"] == "1551"
        assert _typed(app)["total_mass_kg.sigma"] == "2"


async def test_a_whole_form_in_one_burst(make_app: Make) -> None:
    app = make_app(FakeRecorder())
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        keys = ["tab", *"T5 A1", "enter", *"JL", "tab", *"1552", "tab", *"1.5"]
        keys += ["enter", *"800x", "backspace", "down", *"2", "up", "home", *"1", "delete"]
        await burst(pilot, *keys)
        typed = _typed(app)
        assert typed["name"] == "T5 A1"
        assert typed["operator"] == "JL"
        assert (typed["total_mass_kg"], typed["total_mass_kg.sigma"]) == ("1552", "1.5")
        assert (typed["front_axle_kg"], typed["front_axle_kg.sigma"]) == ("100", "2")


async def test_an_answer_in_one_burst_with_its_question(make_app: Make) -> None:
    recorder = FakeRecorder()
    label = recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    recorder.phase = Phase.IDLE
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await burst(pilot, "t", *"a door", "enter", "n", *"2nd door")
        assert orders_of(recorder, Accept) == [Accept(label, "a door")]
        assert app.screen.query_one(Input).value == "2nd door"


async def test_with_caps_lock_each_key_does_what_the_footer_says_and_a_text_keeps_its_capitals(
    make_app: Make,
) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, HomeScreen)
        await burst(pilot, "N", *"RL WET", "enter")
        assert orders_of(recorder, Note) == [Note("RL WET")]
        await burst(pilot, "S")
        assert isinstance(app.screen, SessionsScreen)


def _masses() -> FakeRecorder:
    recorder = FakeRecorder(check=check_items())
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    recorder.phase = Phase.IDLE
    return recorder


async def test_a_bar_code_line_fills_a_row_of_weights(make_app: Make) -> None:
    app = make_app(_masses())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await app.open("masses")
        await reach(pilot, MassesScreen)
        await burst(
            pilot, "a", *"M-07", "tab", *"20.00", "tab", *"0.02", "enter", "enter", "down", "enter"
        )
        typed = _typed(app)
        assert (typed["serial"], typed["mass_kg"], typed["sigma_kg"]) == ("M-07", "20.00", "0.02")
        assert typed["place"] == "FL"
        await burst(pilot, "ctrl+s")
        assert isinstance(app.screen, MassesScreen)
        assert app.screen._entries[-1].serial == "M-07"


@pytest.mark.parametrize(
    ("times_s", "answered"),
    [([0.299], False), ([0.3], True), ([0.2, 0.4], False), ([0.2, 0.6], True)],
)
async def test_a_key_that_was_up_for_three_tenths_of_a_second_is_an_answer(
    make_app: Make, times_s: list[float], answered: bool
) -> None:
    now_s = [0.0]
    app = make_app(FakeRecorder(), clock=lambda: now_s[0])
    given: list[bool | None] = []
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("space")
        await app.push_screen(Confirm("start?", "yes", "no"), given.append)
        for now_s[0] in times_s:
            await pilot.press("space")
        await pilot.pause()
    assert bool(given) is answered
