"""Steps while no recorder answers or an order is refused, and dialogs that are overtaken."""

from __future__ import annotations

import json
import subprocess
from typing import Any, ClassVar

import pytest

from daq.control.orders import AskCheck, Configure, Mark, Note, OverrideWarning
from tui.jobs.gain import GAIN, Gain
from tui.terminal.screens import masses
from tui.terminal.screens.check import CheckScreen
from tui.terminal.screens.masses import MassesScreen
from tui.terminal.screens.vehicle import VehicleScreen
from tui.terminal.state.feed import STARTING, Lost
from tui.terminal.widgets.form import Form

from .fake_recorder import FakeRecorder
from .operated import Make, check_items, orders_of, reach, until
from .test_bench_screens import NOISY, UPSIDE_DOWN
from .test_masses_screen import OUTLOOK
from .test_step_keys import by_hand as by_hand
from .test_step_keys import cursor, front, pressed, seen, weighed

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


async def test_the_last_form_of_a_vehicle_fills_what_was_not_typed(make_app: Make) -> None:
    app = make_app(FakeRecorder())
    folder = app.folder.parent / "last_week"
    folder.mkdir()
    last = {"name": "T5", "total_mass_kg": "1600", "wheelbase_m": "2.9", "notes": "wet"}
    (folder / "vehicle.json").write_text(json.dumps(last | {"operator": "JL"}))
    try:
        async with app.run_test(size=(80, 24)) as pilot:
            await reach(pilot, VehicleScreen)
            form = app.screen.query_one(Form)
            before = form.values
            await pressed(pilot, "tab", "tab", "tab", *"1552", "escape")
            form.enter("name")
            await pressed(pilot, "ctrl+u", *"T5")
            values = form.values
        assert (values["name"], values["total_mass_kg"]) == ("T5", "1552"), "what was typed stays"
        assert values["wheelbase_m"] == "2.9"
        assert (values["operator"], values["notes"]) == (before["operator"], before["notes"])
    finally:
        (folder / "vehicle.json").unlink()
        folder.rmdir()


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


async def test_a_planner_that_does_not_answer_is_said_so(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(MassesScreen, "_compute", OUTLOOK)
    monkeypatch.setattr(masses, "_QUIET_S", 0.0)
    monkeypatch.setattr("tui.terminal.screens.masses.subprocess.Popen", Planner)
    monkeypatch.setattr(Planner, "asked", [])
    recorder = weighed()
    app = make_app(recorder)
    async with app.run_test(size=(100, 30)) as pilot:
        await reach(pilot, MassesScreen)
        await until(pilot, lambda: "the planner did not answer" in seen(app))
        (command, question, killed) = Planner.asked
        assert command == (["-m", "tui.jobs.gain"], subprocess.DEVNULL)
        assert question[0]["folder"] == str(app.folder)
        assert question[1] == 60.0
        assert "[[weight]]" in question[0]["bench"]
        assert killed == "killed"
        monkeypatch.setattr(Planner, "answer", b"no JSON")
        await pressed(pilot, "delete")
        await until(pilot, lambda: len(Planner.asked) == 6)
        assert "the planner did not answer" in seen(app)
        better = Gain(worst=0.0073, mean=0.0055, widest="m_ur")
        monkeypatch.setattr(Planner, "answer", GAIN.dump_json(better))
        await pressed(pilot, "u")
        await until(pilot, lambda: "m_ur" in seen(app))
        asked = len(Planner.asked)
        await pressed(pilot, "b", "b")
        assert len(Planner.asked) == asked, "the same weights, the same answer"


async def test_weights_that_the_bench_cannot_take_are_said_so(make_app: Make) -> None:
    recorder = weighed()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        screen = app.screen
        assert isinstance(screen, MassesScreen)
        await pressed(pilot, *["space"] * 8)
        assert "all are bolted" in seen(app)
        recorder.post(GONE)
        await pilot.pause()
        assert "X = start the recorder again" in seen(app)
        assert (screen.ready, screen.acts) == (True, False)
        recorder.publish()
        await pilot.pause()
        text, app.bench_text = app.bench_text, "[[weight]"
        await pressed(pilot, "space")
        assert front(app) is screen
        assert not [
            order for order in recorder.orders if isinstance(order, Mark | Configure | Note)
        ]
        app.bench_text = text
        await pressed(pilot, "e", *"W-7", "ctrl+s")
        assert "weight 8 is bolted" in seen(app), "a weight that was changed is loose"
        await pressed(pilot, "space")
        recorder.refuse = "a run is being recorded"
        await pressed(pilot, "space")
        assert front(app) is screen
        assert orders_of(recorder, Mark) == []
        recorder.refuse = ""
        await pressed(pilot, "space")
        assert front(app) is not screen
        notes = orders_of(recorder, Note)
        assert notes == [Note("weights: 8 W-7")] * 2, "the first was refused"
