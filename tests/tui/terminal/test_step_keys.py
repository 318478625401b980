"""Keys of the steps off the straight way: check, weights and the vehicle's form."""

from __future__ import annotations

import json

import pytest
from textual.pilot import Pilot
from textual.widgets import Input

from daq.control.messages import CheckItem
from daq.control.orders import AskCheck, Configure, Mark, Note
from daq.vehicle import BodyWeight
from tui.terminal.app import BenchApp
from tui.terminal.screens.check import CheckScreen
from tui.terminal.screens.masses import MassesScreen
from tui.terminal.screens.vehicle import VehicleScreen
from tui.terminal.screens.weights import WeightScreen
from tui.terminal.widgets.table import Table

from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .operated import Make, check_items, orders_of, reach, until
from .test_bench_screens import NOISY


def seen(app: BenchApp) -> str:
    return " ".join(screen_text(app).split())


async def pressed(pilot: Pilot[None], *keys: str) -> str:
    """Press keys and return what is on the screen then."""
    await pilot.press(*keys)
    await pilot.pause()
    await pilot.pause()  # what the first drawing has asked for
    assert isinstance(pilot.app, BenchApp)
    return seen(pilot.app)


def front(app: BenchApp) -> object:
    return app.screen


def cursor(app: BenchApp) -> int:
    return app.screen.query_one(Table).cursor_row


# Check ------------------------------------------------------------------------------------------


@pytest.fixture
def by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the check ask again only where a test says so, not each second."""
    monkeypatch.setattr(CheckScreen, "on_mount", lambda _: None)


@pytest.mark.usefixtures("by_hand")
async def test_keys_of_the_check_act_on_the_marked_line_alone(make_app: Make) -> None:
    recorder = FakeRecorder(check=(*check_items(), NOISY))
    recorder.mark("vehicle")
    app = make_app(recorder)
    async with app.run_test(size=(80, 30)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        screen = app.screen
        assert isinstance(screen, CheckScreen)
        assert screen.ready
        assert cursor(app) == 0
        assert "bus can0" in await pressed(pilot, "up")
        assert cursor(app) == 0
        await pressed(pilot, "down", "down")
        assert cursor(app) == 2
        assert "clock" in screen_text(app)
        assert "O overrides a line that says WARN" in await pressed(pilot, "o")
        assert "I inverts the sign of a channel whose line says FAIL" in await pressed(pilot, "i")
        assert "S skips a corner of the push test" in await pressed(pilot, "s")
        assert orders_of(recorder, Configure) == []
        asked = len(orders_of(recorder, AskCheck))
        await pressed(pilot, "r")
        assert len(orders_of(recorder, AskCheck)) == asked + 1
        assert orders_of(recorder, AskCheck)[-1] == AskCheck(3.0)
        await pressed(pilot, *["down"] * 20)
        assert "hands off the car: 5 s more" in await pressed(pilot, "r")
        assert not screen.acts
        await pressed(pilot, "up")
        recorder.refuse = "JL is in control"
        await pressed(pilot, "r")
        assert "Push the car down" not in seen(app), "the recorder refused its mark"
        recorder.refuse = ""
        assert "Push the car down at the corner marked NOW." in await pressed(pilot, "r")
        assert recorder.orders[-1] == Mark("push RR")


@pytest.mark.usefixtures("by_hand")
async def test_the_mark_of_the_check_stays_on_its_line_when_lines_come_before_it(
    make_app: Make,
) -> None:
    recorder = FakeRecorder(check=check_items())
    recorder.mark("vehicle")
    app = make_app(recorder)
    async with app.run_test(size=(80, 30)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        await pressed(pilot, *["down"] * 5)
        assert cursor(app) == 5
        before = screen_text(app).splitlines()[-7:]
        late = CheckItem("OK", "message IMU_Gyro", "500.0 Hz", "", {})
        recorder.check = (check_items()[0], late, *check_items()[1:])
        await pressed(pilot, "r")
        assert cursor(app) == 6
        assert screen_text(app).splitlines()[-7:] == before, "the same line is explained"


@pytest.mark.usefixtures("by_hand")
async def test_the_zero_is_measured_for_five_seconds_and_a_later_one_waits(make_app: Make) -> None:
    recorder = FakeRecorder(check=check_items(travel_fl=0.0035))
    recorder.mark("vehicle")
    app = make_app(recorder)
    async with app.run_test(size=(80, 30)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        screen = app.screen
        assert isinstance(screen, CheckScreen)
        for left in (5, 4, 3, 2, 1):
            if left == 5:
                await pressed(pilot, "z")
            else:
                await screen._tick()
                await pilot.pause()
            assert f"hands off the car: {left} s more" in seen(app)
        await screen._tick()
        await pilot.pause()
        assert recorder.orders[-1] == AskCheck(5.0)
        assert "travel_fl +3.5 mm" in seen(app)
        assert "Z takes this as zero" in await pressed(pilot, *["down"] * 20)
        recorder.check = check_items()
        await pressed(pilot, "z")
        assert "listening" in seen(app), "what was read before is void"
        asked = len(orders_of(recorder, AskCheck))
        for _ in range(3):
            await screen._tick()
        assert len(orders_of(recorder, AskCheck)) == asked
        await screen._tick()
        assert len(orders_of(recorder, AskCheck)) == asked + 1
        await until(pilot, lambda: "travels and rates read zero at rest" in screen_text(app))
        assert {c.name: c.tare for c in recorder.bench.channels}["travel_fl"] == 0.0035


# Masses -----------------------------------------------------------------------------------------


def weighed() -> FakeRecorder:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    return recorder


async def test_a_weight_is_added_edited_taken_off_and_put_back(make_app: Make) -> None:
    recorder = weighed()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        screen = app.screen
        assert isinstance(screen, MassesScreen)
        count = len(screen._weights)
        await pressed(pilot, "a", *"M-9", "tab", *"12.5")
        await pressed(pilot, "escape")
        await pressed(pilot, "a")
        assert "12.5" in seen(app), "text of a cancelled weight is kept"
        fields = app.screen.query(Input)
        assert [field.value for field in fields][:2] == ["M-9", "12.5"]
        await pressed(pilot, "ctrl+s")
        assert isinstance(app.screen, WeightScreen), "its place is missing"
        assert "needs its place" in seen(app)
        await pressed(pilot, *"-1.25", "tab", *"0.5", "tab", "tab", "enter")
        assert front(app) is screen
        assert screen._weights[count] == BodyWeight(12.5, -1.25, 0.5, 0.0, 0.01, 0.005)
        assert cursor(app) == count
        await pressed(pilot, "e")
        assert f"Weight {count + 1}" in seen(app)
        await pressed(pilot, "tab", "ctrl+u", *"13", "ctrl+s")
        assert screen._weights[count].mass_kg == 13.0
        await pressed(pilot, "b")
        assert "13.00" in seen(app)
        assert screen._entries[count].bolted
        await pressed(pilot, "b")
        assert not screen._entries[count].bolted
        await pressed(pilot, "delete")
        assert len(screen._weights) == count
        await pressed(pilot, "u")
        assert len(screen._weights) == count + 1
        await pressed(pilot, *["u"] * 20)
        assert len(screen._weights) == count
        await pressed(pilot, *["delete"] * (count + 2))
        assert screen._weights == ()
        assert "no weight: A adds one" in seen(app)
        assert "there is no weight" in seen(app)
        assert not screen.ready
        assert not screen.acts
        await pressed(pilot, "e", "b")
        assert front(app) is screen
        await screen.action_next()
        await pilot.pause()
        assert "one weight at least" in seen(app)
        assert not orders_of(recorder, Configure)


async def test_space_bolts_one_weight_after_the_other_and_goes_on(make_app: Make) -> None:
    recorder = weighed()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        screen = app.screen
        assert isinstance(screen, MassesScreen)
        count = len(screen._weights)
        assert "SPACE = weight 1 is bolted" in seen(app)
        assert "SPACE = look at 1" in await pressed(pilot, "down")
        assert "SPACE = weight 1 is bolted" in await pressed(pilot, "space")
        for number in range(2, count + 1):
            assert f"SPACE = weight {number} is bolted" in await pressed(pilot, "space")
        assert "all are bolted" in await pressed(pilot, "space")
        recorder.refuse = "a run is being recorded"
        await pressed(pilot, "space")
        assert front(app) is screen
        recorder.refuse = ""
        await pressed(pilot, "space")
        assert front(app) is not screen
        assert Mark("step masses done") in recorder.orders
        assert orders_of(recorder, Configure) == []
        assert not (app.folder / "draft_masses.json").exists()


# Vehicle ----------------------------------------------------------------------------------------


async def test_the_form_waits_for_the_bench_and_a_note_is_sent_once(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        screen, bench = app.screen, app.bench
        assert isinstance(screen, VehicleScreen)
        assert screen.ready
        app.bench = None
        assert "has not sent its bench.toml yet" in await pressed(pilot, "space")
        app.bench = bench
        notes = list(screen.query(Input))[-1]
        notes.focus()
        await pressed(pilot, *"wet")
        recorder.refuse = "JL is in control"
        await pressed(pilot, "ctrl+s")
        assert front(app) is screen
        recorder.refuse = ""
        await pressed(pilot, "ctrl+s")
        assert front(app) is not screen
        await pressed(pilot, "1", "ctrl+s")
        assert orders_of(recorder, Note) == [Note("wet"), Note("wet")], "the first was refused"
        assert json.loads((app.folder / "vehicle.json").read_text())["notes"] == "wet"
