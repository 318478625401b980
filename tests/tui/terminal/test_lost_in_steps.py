"""Steps while no recorder answers or an order is refused, and dialogs that are overtaken."""

from __future__ import annotations

import json
import subprocess
from typing import Any, ClassVar

import pytest

from daq.control.orders import AskCheck, Configure, Mark, OverrideWarning
from tui.terminal.screens.check import CheckScreen
from tui.terminal.screens.vehicle import VehicleScreen
from tui.terminal.state.feed import STARTING, Lost
from tui.terminal.widgets.form import Form

from .fake_recorder import FakeRecorder
from .operated import Make, check_items, orders_of, reach, until
from .test_bench_screens import NOISY, UPSIDE_DOWN
from .test_step_keys import by_hand as by_hand
from .test_step_keys import cursor, pressed, seen

GONE = Lost("the recorder has ended", "all frames up to then are on the disk")


async def test_the_form_says_what_to_press_while_no_recorder_answers(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        screen = app.screen
        assert isinstance(screen, VehicleScreen)
        assert "this is the car: go on to step 2 Check" in seen(app)
        assert "Tab or Enter edits." in seen(app)
        recorder.post(GONE)
        await pilot.pause()
        assert "X = start the recorder again What is typed is kept." in seen(app).replace("│ ", "")
        assert not screen.acts
        recorder.post(STARTING)
        await pilot.pause()
        assert "The recorder is being started." in seen(app)
        recorder.publish()
        await pilot.pause()
        assert "this is the car: go on to step 2 Check" in seen(app)
        assert screen.acts
        assert "Enter or Tab: next field." in await pressed(pilot, "tab")
        said = await pressed(pilot, "tab", "tab", *"x", "tab", *"x", "escape")
        assert "; 1 more" in said
        assert "Total mass: 'x' is not a number" in said
        assert app.focused is None
        await pressed(pilot, "tab")
        assert screen.query_one(Form).current is not None
        assert "Total mass" in str(screen.query_one("#help").border_title)


@pytest.mark.usefixtures("by_hand")
async def test_the_check_asks_nothing_of_a_recorder_that_is_lost(make_app: Make) -> None:
    recorder = FakeRecorder(check=(*check_items(), NOISY, UPSIDE_DOWN))
    recorder.mark("vehicle")
    app = make_app(recorder)
    async with app.run_test(size=(80, 40)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "upside down" in seen(app))
        screen = app.screen
        assert isinstance(screen, CheckScreen)
        assert "bus can0" not in str(screen.query_one("#explained").border_title)
        assert screen._rows[cursor(app)].subject == "channel hub_acc_fl", "the first that fails"
        asked = len(orders_of(recorder, AskCheck))
        recorder.post(GONE)
        await pilot.pause()
        await screen._tick()
        assert "X = start the recorder again" in await pressed(pilot, "up")
        assert (screen.acts, screen.ready) == (False, False)
        assert len(orders_of(recorder, AskCheck)) == asked
        recorder.publish()
        await pilot.pause()
        recorder.refuse = "JL is in control"
        assert "JL is in control" in await pressed(pilot, "r")
        assert "upside down" in seen(app), "the last answer stays"
        recorder.refuse = ""
        app.bench_text = "this is no bench"
        while screen._rows[cursor(app)].subject != "channel hub_acc_fl":
            await pressed(pilot, "down")
        await pressed(pilot, "i")
        assert orders_of(recorder, Configure) == []
        recorder.check = (*check_items(), NOISY)
        await pressed(pilot, "r")
        await recorder.ask(OverrideWarning("channel hub_acc_rr", "old"))
        recorder.publish()
        await pilot.pause()
        while screen._rows[cursor(app)].subject != "channel hub_acc_rr":
            await pressed(pilot, "up")
        assert "overridden: old (MK)" in seen(app)
        assert "O overrides a line that says WARN" in await pressed(pilot, "o"), "once is enough"


@pytest.mark.usefixtures("by_hand")
async def test_a_corner_that_is_skipped_leads_to_the_next(make_app: Make) -> None:
    recorder = FakeRecorder(check=check_items())
    recorder.mark("vehicle")
    app = make_app(recorder)
    async with app.run_test(size=(80, 30)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "SPACE = push the corners" in seen(app))
        screen = app.screen
        assert isinstance(screen, CheckScreen)
        await pressed(pilot, "space")
        assert not screen.acts
        await pressed(pilot, "s", *"wall", "enter")
        assert OverrideWarning("push FL", "wall") in recorder.orders
        assert recorder.orders[-1] == Mark("push FR")
        await pressed(pilot, "s", "escape")
        assert "Push the car down" in seen(app), "no reason, no skip"
        recorder.refuse = "JL is in control"
        await pressed(pilot, "s", *"post", "enter")
        assert orders_of(recorder, OverrideWarning)[-1] == OverrideWarning("push FR", "post")
        assert "push FR" in str(screen.query_one("#explained").border_title), "it is still due"
        recorder.refuse = ""
        await pressed(pilot, "s", "enter")
        assert recorder.orders[-1] == Mark("push RL"), "the reason was kept"


# Masses -------------------------------------------------------------------------------------------


class Planner:
    """The planner's process: answers, or does not."""

    answer: ClassVar[bytes | None] = None
    asked: ClassVar[list[Any]] = []

    def __init__(self, command: list[str], **options: Any) -> None:
        Planner.asked.append((command[1:], options["stderr"]))

    def communicate(self, question: bytes, patience_s: float) -> tuple[bytes, None]:
        """Answer."""
        Planner.asked.append((json.loads(question), patience_s))
        if Planner.answer is None:
            raise subprocess.TimeoutExpired("planner", patience_s)
        return Planner.answer, None

    def kill(self) -> None:
        """Note it."""
        Planner.asked.append("killed")
