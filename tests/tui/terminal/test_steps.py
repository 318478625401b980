"""Steps 1 and 2 as a person uses them: vehicle and check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from textual.pilot import Pilot
from textual.widgets import Input

from daq.control.messages import (
    AskCheck,
    Configure,
    Hello,
    Lane,
    Live,
    Mark,
    OverrideWarning,
    Phase,
)
from daq.vehicle import Corner
from dbc.words import Finding
from tui.terminal.app import BenchApp
from tui.terminal.feed import STARTING, Lost
from tui.terminal.form import Form
from tui.terminal.screens.check import CheckScreen
from tui.terminal.screens.vehicle import VehicleScreen

from .conftest import screen_text
from .fake_recorder import BIN_S, FakeRecorder
from .operated import (
    Make,
    check_items,
    check_line,
    cursor,
    on_screen,
    orders_of,
    pressed,
    reach,
    seen,
    until,
)

UPSIDE_DOWN = check_line(
    "FAIL", "channel hub_acc_fl", "reads -9.79 m/s2 at rest: upside down", "set sign = -1", {}
)
NOISY = check_line(
    "WARN", "channel hub_acc_rr", "noise 2.4 m/s2 is more than the usual 2", "stop the engine", {}
)


async def test_what_is_typed_goes_to_the_recorder_once_it_has_sent_its_bench(
    make_app: Make,
) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with on_screen(app, VehicleScreen) as (pilot, _):
        bench, app.bench = app.bench, None
        assert "has not sent its bench.toml yet" in await pressed(pilot, "space")
        app.bench = bench
        recorder.refuse = "JL is in control"
        await pressed(pilot, "ctrl+s")
        assert isinstance(app.screen, VehicleScreen)
        recorder.refuse = ""
        await pilot.press("tab", "ctrl+u", *"T5 A1", "enter", "end", *"2")
        await pilot.press("enter", *"1552", "ctrl+s")
        await reach(pilot, CheckScreen)
        assert app.operator == "MK2"
    bench = recorder.bench
    assert bench.vehicle.name == "T5 A1"
    assert [(f.quantity, f.value, f.sigma) for f in bench.vehicle.facts] == [
        ("total_mass_kg", 1552.0, 1.0)
    ]
    assert Hello("MK2", True) in recorder.orders
    assert (app.folder / "vehicle.json").exists()
    assert not (app.folder / "draft_vehicle.json").exists()


async def test_an_error_stays_in_its_field_says_what_is_wrong_and_survives(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with on_screen(app, VehicleScreen) as (pilot, _):
        await pilot.press("tab", "enter", "enter", *"15x2")
        assert "'15x2' is not a number" in screen_text(app)  # while it is typed
        await pilot.press("escape", "space")
        await pilot.pause()
        shown = screen_text(app)
        assert "!Total mass, kg  15x2" in shown
        assert "✗ Total mass: '15x2' is not a number (limit: 100 to 10000 kg)" in shown
        assert isinstance(app.screen, VehicleScreen)
        assert isinstance(app.screen.focused, Input)
        assert orders_of(recorder, Mark) == []
        await until(pilot, (app.folder / "draft_vehicle.json").exists)
    assert "15x2" not in recorder.bench_text
    after = make_app(FakeRecorder())  # as after a crash of the terminal
    async with on_screen(after, VehicleScreen) as (pilot, _):
        assert "!Total mass, kg  15x2" in screen_text(after)


def _checked(*items: Finding, **levels: float) -> FakeRecorder:
    recorder = FakeRecorder(check=(*check_items(**levels), *items))
    recorder.mark("vehicle")
    return recorder


async def test_a_failure_blocks_and_its_sign_can_be_turned(
    make_app: Make, snapshot: Callable[..., None]
) -> None:
    recorder = _checked(NOISY, UPSIDE_DOWN)
    app = make_app(recorder)
    async with on_screen(app, CheckScreen, (140, 40)) as (pilot, _):
        await until(pilot, lambda: "upside down" in screen_text(app))
        await pilot.press("space")
        await pilot.pause()
        snapshot(app, "check_140x40")
        await pilot.resize_terminal(80, 24)
        await pilot.pause()
        snapshot(app, "check_80x24")
        assert "1 FAIL: correct it, then SPACE goes on" in screen_text(app)
        assert "SPACE Next" not in screen_text(app)
        assert orders_of(recorder, Mark) == []
        await pilot.press("i")
        await until(pilot, lambda: orders_of(recorder, Configure))
    signs = {c.name: c.sign for c in recorder.bench.channels}
    assert (signs["hub_acc_fl"], signs["hub_acc_fr"]) == (-1, 1)


async def _checked_again(pilot: Pilot[None], screen: CheckScreen, times: int = 1) -> None:
    """Let so many periods of the check pass."""
    for _ in range(times):
        await screen._check_again()
    await pilot.pause()


async def _push(
    pilot: Pilot[None],
    recorder: FakeRecorder,
    corner: Corner,
    sign: float,
    after_s: float = 2.0,
) -> None:
    """Push a corner for half a second between 11 s and `after_s` of rest, all in live samples."""
    app = pilot.app
    assert isinstance(app, BenchApp)
    first, bins = app.lanes.end_bin, round((11.5 + after_s) / BIN_S)
    time = np.arange(bins) * BIN_S - 11.0
    hump = np.where((time > 0) & (time < 0.5), np.sin(np.pi * time / 0.5) ** 2, 0.0)
    pitch = np.where((time > 0) & (time < 0.5), np.sin(2 * np.pi * time / 0.5), 0.0)
    size = {f"travel_{corner.lower()}": sign * 0.014 * hump,
            "pitch_rate": (1 if corner.front else -1) * 0.06 * pitch,
            "roll_rate": -corner.side * 0.08 * pitch}  # fmt: skip
    lanes = []
    for channel in recorder.bench.channels:
        value = size.get(channel.name, np.zeros(bins))
        lanes.append(Lane(channel.name, tuple((value - 1e-4).tolist()),
                          tuple((value + 1e-4).tolist())))  # fmt: skip
    recorder.post(Live(first, BIN_S, tuple(lanes)))
    await pilot.pause()


async def test_corners_zero_and_warnings_lead_to_the_baseline(make_app: Make) -> None:
    recorder = _checked(NOISY, travel_fl=0.0035)
    app = make_app(recorder)
    async with on_screen(app, CheckScreen) as (pilot, screen):
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        recorder.post(Live(0, BIN_S, ()))
        await pilot.press("space")
        for corner in Corner:
            await until(pilot, partial(recorder.orders.__contains__, Mark(f"push {corner}")))
            if corner is Corner.FRONT_RIGHT:  # acknowledged, and one sentence on what is due
                shown = screen_text(app)
                assert "front LEFT seen: travel_fl moved +14 mm, sign right" in shown
                assert "Push DOWN at the front RIGHT, let go, 15 s left" in shown
                assert "let it come to rest" not in shown
            await _push(pilot, recorder, corner, 1.0)
        await until(pilot, lambda: "SPACE = zero" in screen_text(app))
        assert "travel_rr moved +14 mm, sign right" in screen_text(app)
        await pilot.press("space")
        await pilot.pause()
        assert "hands off the car" in screen_text(app)
        await _checked_again(pilot, screen, 5)
        assert "travel_fl +3.5 mm" in screen_text(app)
        recorder.check = (*check_items(), NOISY)
        await pilot.press("space")
        await until(pilot, lambda: orders_of(recorder, Configure))
        await _checked_again(pilot, screen, 6)
        await until(pilot, lambda: "SPACE = override 1 WARN" in screen_text(app))
        await pilot.press("space", *"old sensor", "enter")
        await until(pilot, lambda: "go on to step 3" in screen_text(app))
        await pilot.press("space")
        await until(pilot, lambda: not isinstance(app.screen, CheckScreen))
    tares = {c.name: c.tare for c in recorder.bench.channels}
    assert tares["travel_fl"] == 0.0035
    assert not any(tare for name, tare in tares.items() if name != "travel_fl")
    assert OverrideWarning("channel hub_acc_rr", "old sensor") in recorder.orders
    assert Mark("step check done") in recorder.orders


def _asked(recorder: FakeRecorder, times: int) -> bool:
    return recorder.orders.count(Mark("push FL")) == times


async def test_a_push_is_asked_for_again_and_i_corrects_its_sign(
    make_app: Make,
) -> None:
    recorder = _checked()
    app = make_app(recorder)
    async with on_screen(app, CheckScreen) as (pilot, _):
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        recorder.post(Live(0, BIN_S, ()))
        await pilot.press("space")
        await until(pilot, lambda: Mark("push FL") in recorder.orders)
        names = [c.name for c in recorder.bench.channels]
        for seconds, asked in ((14.9, 1), (0.2, 2), (14.8, 2), (0.4, 3)):
            still = (0.0,) * round(seconds / BIN_S)
            lanes = tuple(Lane(name, still, still) for name in names)
            recorder.post(Live(app.lanes.end_bin, BIN_S, lanes))
            await pilot.pause()
            await until(pilot, partial(_asked, recorder, asked))
        assert "front LEFT not seen yet" in screen_text(app)
        assert "Push DOWN at the front LEFT, let go, 15 s left" in screen_text(app)
        await _push(pilot, recorder, Corner.FRONT_LEFT, 1.0, after_s=25.0)  # a screen that lagged
        await until(pilot, lambda: Mark("push FR") in recorder.orders)
        await _push(pilot, recorder, Corner.FRONT_RIGHT, -1.0)
        await until(pilot, lambda: "travel_fr moved the wrong way" in screen_text(app))
        assert "1 FAIL: correct it, then SPACE goes on" in screen_text(app)
        assert "SPACE Next" not in screen_text(app)
        await pilot.press("i")
        await until(pilot, lambda: orders_of(recorder, Configure))
        assert {c.name: c.sign for c in recorder.bench.channels}["travel_fr"] == -1
        await until(pilot, lambda: recorder.orders.count(Mark("push FR")) == 2)
        await pilot.press("s", *"wall", "enter")
        await until(pilot, lambda: Mark("push RL") in recorder.orders)
        assert "skipped: wall (MK)" in screen_text(app)


@pytest.fixture
def by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the check ask again only where a test says so, not each second."""

    def ask_once(screen: CheckScreen) -> None:
        screen.run_worker(screen._request_check(3.0))

    monkeypatch.setattr(CheckScreen, "on_mount", ask_once)


@pytest.mark.usefixtures("by_hand")
async def test_keys_of_the_check_act_on_the_marked_line_alone(make_app: Make) -> None:
    recorder = _checked(NOISY, replace(NOISY, text="calibrated on 2020-01-01"))
    app = make_app(recorder)
    async with on_screen(app, CheckScreen, (80, 30)) as (pilot, screen):
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        assert screen.ready
        assert cursor(app) == 0
        assert "about 38 % of the bit rate" in await pressed(pilot, "up")
        assert cursor(app) == 0
        await pressed(pilot, "down", "down")
        assert cursor(app) == 2
        assert "O overrides a line that says WARN" in await pressed(pilot, "o")
        assert "I inverts the sign of a channel whose line says FAIL" in await pressed(pilot, "i")
        assert "S skips a corner of the push test" in await pressed(pilot, "s")
        assert orders_of(recorder, Configure) == []
        await _to_line(pilot, screen, NOISY.subject)
        asked = await pressed(pilot, "o")
        assert "usual 2; calibrated on 2020-01-01. Why" in asked.replace("│ ", "")
        await pressed(pilot, "escape", *["down"] * 20)
        assert "hands off the car: 5 s more" in await pressed(pilot, "r")
        assert not screen.next_enabled
        await pressed(pilot, "up")
        recorder.refuse = "JL is in control"
        await pressed(pilot, "r")
        assert "Push DOWN" not in seen(app), "the recorder refused its mark"
        recorder.refuse = ""
        recorder.turn(Phase.ARMED)
        await pilot.pause()
        assert "a run is armed: pause it first" in await pressed(pilot, "2", "r")
        recorder.turn(Phase.PAUSED)
        assert "Push DOWN at the rear RIGHT, let go" in await pressed(pilot, "r")
        assert recorder.orders[-1] == Mark("push RR")
        assert "hands off for 5 s" in seen(app), "the zero is not measured while the car is pushed"


@pytest.mark.usefixtures("by_hand")
async def test_a_skipped_corner_that_is_pushed_after_all_counts(make_app: Make) -> None:
    recorder = _checked()
    for corner in Corner:
        await recorder.ask(OverrideWarning(f"push {corner}", "no room"))
    app = make_app(recorder)
    async with on_screen(app, CheckScreen, (80, 30)) as (pilot, screen):
        await until(pilot, lambda: "SPACE = zero" in screen_text(app))
        recorder.post(Live(0, BIN_S, ()))
        await _to_line(pilot, screen, "push FR")
        assert "NOW push FR push DOWN at the front RIGHT" in await pressed(pilot, "r")
        await _push(pilot, recorder, Corner.FRONT_RIGHT, -1.0)
        assert "FAIL push FR travel_fr moved the wrong way" in seen(app)
        assert "1 FAIL: correct it, then SPACE goes on" in seen(app)
        assert screen._rows[cursor(app)].subject == "push FR"
        recorder.check = (*check_items(), UPSIDE_DOWN)
        await _checked_again(pilot, screen, 5)
        assert screen._rows[cursor(app)].subject == "channel hub_acc_fl", "the one that is new"
        recorder.check = check_items()
        recorder.publish(recording="1f" * 16, overrides=())  # the next vehicle
        await _checked_again(pilot, screen)
        assert "wait push FR front RIGHT" in seen(app)
        assert "SPACE = push the corners" in seen(app)


@pytest.mark.usefixtures("by_hand")
async def test_the_zero_is_measured_for_five_seconds_and_a_later_one_waits(make_app: Make) -> None:
    recorder = _checked(travel_fl=0.0035)
    app = make_app(recorder)
    async with on_screen(app, CheckScreen, (80, 30)) as (pilot, screen):
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        for left in (5, 4, 3, 2, 1):
            if left == 5:
                await pressed(pilot, *["down"] * 20, "r")
            else:
                await _checked_again(pilot, screen)
            assert f"hands off the car: {left} s more" in seen(app)
        await _checked_again(pilot, screen)
        assert recorder.orders[-1] == AskCheck(4.0), "without the part of a second before SPACE"
        recorder.check = check_items(travel_fl=0.02)  # later, a person leans on the car
        await _checked_again(pilot, screen)
        assert "travel_fl +3.5 mm" in seen(app)
        for corner in Corner:
            await recorder.ask(OverrideWarning(f"push {corner}", "no room"))
        recorder.publish()
        await pilot.pause()
        assert "SPACE = take this as zero" in seen(app)
        await pressed(pilot, "space")
        assert {c.name: c.tare for c in recorder.bench.channels}["travel_fl"] == 0.0035
        assert "listening" in seen(app), "what was read before is void"
        assert "hands off the car: 5 s more" in seen(app), "the new zero is measured"
        recorder.check = check_items()[:-1]
        await _checked_again(pilot, screen, 5)
        assert "zero hands off for 5 s" in seen(app), "roll_rate had no reading"
        recorder.check = check_items()
        await pressed(pilot, "space")
        await _checked_again(pilot, screen, 5)
        assert "travels and rates read zero at rest" in seen(app)


GONE = Lost("the recorder has ended", "all frames up to then are on the disk")


async def test_the_form_says_what_to_press_while_no_recorder_answers(
    make_app: Make, snapshot: Callable[..., None]
) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with on_screen(app, VehicleScreen, (140, 40)) as (pilot, _):
        snapshot(app, "vehicle_140x40")
        await pilot.resize_terminal(80, 24)
        await pilot.pause()
        snapshot(app, "vehicle_80x24")
        screen = app.screen
        assert isinstance(screen, VehicleScreen)
        assert "this is the car: go on to step 2 Check" in seen(app)
        assert "Tab or Enter edits." in seen(app)
        recorder.post(GONE)
        await pilot.pause()
        assert "X = start the recorder again What is typed is kept." in seen(app).replace("│ ", "")
        assert not screen.next_enabled
        recorder.post(STARTING)
        await pilot.pause()
        assert "The recorder is being started." in seen(app)
        recorder.publish()
        await pilot.pause()
        assert "this is the car: go on to step 2 Check" in seen(app)
        assert screen.next_enabled
        assert "Tab: next field." in await pressed(pilot, "tab")
        said = await pressed(pilot, "tab", "tab", *"x", "tab", *"x", "escape")
        assert "; 1 more" in said
        assert "Total mass: 'x' is not a number" in said
        assert app.focused is None
        await pressed(pilot, "tab")
        assert screen.query_one(Form).current is not None
        assert "Total mass" in str(screen.query_one("#help").border_title)


async def _to_line(pilot: Pilot[None], screen: CheckScreen, subject: str) -> None:
    """Move the cursor to the line on a subject."""
    lines = [row.subject for row in screen._rows].index(subject) - cursor(screen.bench_app)
    await pressed(pilot, *abs(lines) * ["down" if lines > 0 else "up"])
    assert screen._rows[cursor(screen.bench_app)].subject == subject


@pytest.mark.usefixtures("by_hand")
async def test_the_check_asks_nothing_of_a_recorder_that_is_lost(make_app: Make) -> None:
    recorder = _checked(NOISY, UPSIDE_DOWN)
    app = make_app(recorder)
    async with on_screen(app, CheckScreen, (80, 40)) as (pilot, screen):
        await until(pilot, lambda: "upside down" in seen(app))
        assert screen._rows[cursor(app)].subject == "channel hub_acc_fl", "the first that fails"
        asked = len(orders_of(recorder, AskCheck))
        recorder.post(GONE)
        await pilot.pause()
        await screen._check_again()
        assert "X = start the recorder again" in await pressed(pilot, "up")
        assert (screen.next_enabled, screen.ready) == (False, False)
        assert len(orders_of(recorder, AskCheck)) == asked
        recorder.publish()
        await pilot.pause()
        recorder.refuse = "JL is in control"
        await _checked_again(pilot, screen)
        assert "JL is in control" in seen(app)
        assert "upside down" in seen(app), "the last answer stays"
        recorder.refuse = ""
        app.bench_text = "this is no bench"
        await _to_line(pilot, screen, "channel hub_acc_fl")
        await pressed(pilot, "i")
        assert orders_of(recorder, Configure) == []
        recorder.check = (*check_items(), NOISY)
        await screen._check_again()
        await recorder.ask(OverrideWarning("channel hub_acc_rr", "old"))
        recorder.publish()
        await pilot.pause()
        await _to_line(pilot, screen, "channel hub_acc_rr")
        assert "overridden: old (MK)" in seen(app)
        assert "O overrides a line that says WARN" in await pressed(pilot, "o"), "once is enough"
