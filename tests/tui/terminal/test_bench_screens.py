"""Steps 1 and 2 as a person uses them: vehicle and check."""

from collections.abc import Callable
from functools import partial

import numpy as np
from textual.pilot import Pilot
from textual.widgets import Input

from daq.control.messages import CheckItem, Lane, Live
from daq.control.orders import Configure, Hello, Mark, OverrideWarning
from daq.vehicle import Corner
from tui.terminal.app import BenchApp
from tui.terminal.screens.check import CheckScreen
from tui.terminal.screens.vehicle import VehicleScreen

from .conftest import at_every_size, screen_text
from .fake_recorder import BIN_S, FakeRecorder
from .operated import Make, bench_of, check_items, orders_of, reach, until

UPSIDE_DOWN = CheckItem(
    "FAIL", "channel hub_acc_fl", "reads -9.79 m/s2 at rest: upside down", "set sign = -1", {}
)
NOISY = CheckItem(
    "WARN", "channel hub_acc_rr", "noise 2.4 m/s2 is more than the usual 2", "stop the engine", {}
)


# Vehicle ----------------------------------------------------------------------------------------


async def test_the_vehicle_form_looks_as_before(
    make_app: Make, snapshot: Callable[..., None]
) -> None:
    app = make_app(FakeRecorder())
    async with app.run_test(size=(100, 30)) as pilot:
        await reach(pilot, VehicleScreen)
        await at_every_size(pilot, snapshot, "vehicle")


async def test_space_alone_takes_the_car_as_the_bench_describes_it(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        await pilot.press("space")
        await reach(pilot, CheckScreen)
        await pilot.pause(0.1)
    assert orders_of(recorder, Configure) == []
    assert Mark("step vehicle done") in recorder.orders


async def test_what_is_typed_goes_to_the_recorder(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        await pilot.press("tab", "ctrl+u", *"T5 A1", "enter", "end", *"2")
        await pilot.press("enter", *"1552", "ctrl+s")
        await reach(pilot, CheckScreen)
        assert app.operator == "MK2"
        await pilot.pause(0.1)
    bench = bench_of(recorder)
    assert bench.vehicle.name == "T5 A1"
    assert [(f.quantity, f.value, f.sigma) for f in bench.vehicle.facts] == [
        ("total_mass_kg", 1552.0, 1.0)
    ]
    assert Hello("MK2", True) in recorder.orders
    assert (app.folder / "vehicle.json").exists()
    assert not (app.folder / "draft_vehicle.json").exists()


async def test_an_error_stays_in_its_field_and_says_what_is_wrong(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        await pilot.press("tab", "enter", "enter", *"15x2")
        assert "'15x2' is not a number" in screen_text(app)  # while it is typed
        await pilot.press("escape", "space")
        await pilot.pause()
        shown = screen_text(app)
        assert "!Total mass    [15x2" in shown
        assert "✗ Total mass: '15x2' is not a number (limit: 100 to 10000 kg)" in shown
        assert isinstance(app.screen, VehicleScreen)
        assert isinstance(app.screen.focused, Input)
        assert orders_of(recorder, Mark) == []
        await pilot.press("escape", "f1")
        await pilot.pause()
    assert "15x2" not in recorder.bench_text


async def test_what_was_typed_survives_a_crash_of_the_terminal(make_app: Make) -> None:
    app = make_app(FakeRecorder())
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        await pilot.press("tab", "enter", "enter", *"15x2")
        await until(pilot, (app.folder / "draft_vehicle.json").exists)
    after = make_app(FakeRecorder())
    async with after.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        assert "!Total mass    [15x2" in screen_text(after)


async def test_a_refused_order_keeps_the_form(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, VehicleScreen)
        await pilot.press("tab", "end", *"X")
        recorder.refuse = "a run is being recorded"
        await pilot.press("ctrl+s")
        await pilot.pause()
        assert isinstance(app.screen, VehicleScreen)
        assert "Ford GranadaX" in screen_text(app)


# Check ------------------------------------------------------------------------------------------


def _checked(*items: CheckItem, **levels: float) -> FakeRecorder:
    recorder = FakeRecorder(check=(*check_items(**levels), *items))
    recorder.mark("vehicle")
    return recorder


async def test_the_check_looks_as_before(make_app: Make, snapshot: Callable[..., None]) -> None:
    app = make_app(_checked(NOISY, UPSIDE_DOWN))
    async with app.run_test(size=(100, 30)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "upside down" in screen_text(app))
        await pilot.press("space")
        await pilot.pause()
        await at_every_size(pilot, snapshot, "check")


async def test_a_failure_blocks_and_its_sign_can_be_turned(make_app: Make) -> None:
    recorder = _checked(UPSIDE_DOWN)
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "upside down" in screen_text(app))
        await pilot.press("space")
        await pilot.pause()
        assert "1 FAIL: correct it, then SPACE goes on" in screen_text(app)
        assert "SPACE Next" not in screen_text(app)
        assert orders_of(recorder, Mark) == []
        await pilot.press("i")
        await until(pilot, lambda: orders_of(recorder, Configure))
    signs = {c.name: c.sign for c in bench_of(recorder).channels}
    assert (signs["hub_acc_fl"], signs["hub_acc_fr"]) == (-1, 1)


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
    first, bins = app.lanes.end, round((11.5 + after_s) / BIN_S)
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
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, CheckScreen)
        screen = app.screen
        assert isinstance(screen, CheckScreen)
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        recorder.post(Live(0, BIN_S, ()))
        await pilot.press("space")
        for corner in Corner:
            await until(pilot, partial(recorder.orders.__contains__, Mark(f"push {corner}")))
            await _push(pilot, recorder, corner, 1.0)
        await until(pilot, lambda: "SPACE = zero" in screen_text(app))
        assert "rear RIGHT seen: travel_rr moved +14 mm, sign right" in screen_text(app)
        await pilot.press("space")
        await pilot.pause()
        assert "hands off the car" in screen_text(app)
        for _ in range(5):
            await screen._tick()
        await pilot.pause()
        assert "travel_fl +3.5 mm" in screen_text(app)
        recorder.check = (*check_items(), NOISY)
        await pilot.press("space")
        await until(pilot, lambda: orders_of(recorder, Configure))
        for _ in range(6):
            await screen._tick()
        await until(pilot, lambda: "SPACE = override 1 WARN" in screen_text(app))
        await pilot.press("space", *"old sensor", "enter")
        await until(pilot, lambda: "go on to step 3" in screen_text(app))
        await pilot.press("space")
        await until(pilot, lambda: not isinstance(app.screen, CheckScreen))
    tares = {c.name: c.tare for c in bench_of(recorder).channels}
    assert tares["travel_fl"] == 0.0035
    assert not any(tare for name, tare in tares.items() if name != "travel_fl")
    assert OverrideWarning("channel hub_acc_rr", "old sensor") in recorder.orders
    assert Mark("step check done") in recorder.orders


def _asked(recorder: FakeRecorder, times: int) -> bool:
    return recorder.orders.count(Mark("push FL")) == times


async def test_a_push_that_nobody_saw_is_asked_for_again(make_app: Make) -> None:
    recorder = _checked()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        recorder.post(Live(0, BIN_S, ()))
        await pilot.press("space")
        await until(pilot, lambda: Mark("push FL") in recorder.orders)
        names = [c.name for c in recorder.bench.channels]
        for seconds, asked in ((14.9, 1), (0.2, 2), (29.8, 2), (0.4, 3)):
            still = (0.0,) * round(seconds / BIN_S)
            lanes = tuple(Lane(name, still, still) for name in names)
            recorder.post(Live(app.lanes.end, BIN_S, lanes))
            await pilot.pause()
            await until(pilot, partial(_asked, recorder, asked))
        asked_again = "front LEFT not seen yet: push DOWN at the front LEFT, let go"
        assert asked_again in screen_text(app)
        await _push(pilot, recorder, Corner.FRONT_LEFT, 1.0, after_s=25.0)  # a screen that lagged
        await until(pilot, lambda: Mark("push FR") in recorder.orders)


async def test_a_push_the_wrong_way_is_a_failure_that_i_corrects(make_app: Make) -> None:
    recorder = _checked()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, CheckScreen)
        await until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        await pilot.press("space")
        await _push(pilot, recorder, Corner.FRONT_LEFT, -1.0)
        await until(pilot, lambda: "travel_fl moved the wrong way" in screen_text(app))
        assert "1 FAIL: correct it, then SPACE goes on" in screen_text(app)
        assert "SPACE Next" not in screen_text(app)
        await pilot.press("i")
        await until(pilot, lambda: orders_of(recorder, Configure))
        assert {c.name: c.sign for c in bench_of(recorder).channels}["travel_fl"] == -1
        await until(pilot, lambda: recorder.orders.count(Mark("push FL")) == 2)
        await pilot.press("s", *"wall", "enter")
        await until(pilot, lambda: Mark("push FR") in recorder.orders)
        assert "skipped: wall (MK)" in screen_text(app)
