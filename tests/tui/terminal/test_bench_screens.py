"""Steps 1, 2 and 4 as a person uses them: vehicle, check, masses."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from textual.pilot import Pilot
from textual.widgets import Input

from daq.bench.config import parse_bench
from daq.control.messages import CheckItem, Lane, Live
from daq.control.orders import Configure, Hello, Mark, Note, OverrideWarning
from daq.vehicle import BodyWeight, Corner, HubWeight
from tui.jobs.gain import Gain, Shift
from tui.terminal.app import BenchApp
from tui.terminal.screens.check import CheckScreen
from tui.terminal.screens.masses import MassesScreen
from tui.terminal.screens.vehicle import VehicleScreen

from .conftest import at_every_size, screen_text
from .fake_recorder import BIN_S, FakeRecorder

Make = Callable[..., BenchApp]
GAIN = Gain(
    (Shift("bounce", 1.05, 1.00), Shift("pitch", 1.31, 1.25), Shift("roll", 1.65, 1.64)),
    0.0073,
    0.0055,
    "m_ur",
)


def _items(**levels: float) -> tuple[CheckItem, ...]:
    rest = {f"travel_{c.lower()}": 0.0001 for c in Corner} | levels
    return (
        CheckItem("OK", "bus", "12000 frames in 3.00 s, about 38 % of the bit rate", "", {}),
        CheckItem("OK", "message IMU_Accel", "500.0 Hz, jitter 0.20 ms", "", {}),
        CheckItem("OK", "channel body_acc_z", "9.81 m/s2 at rest, +1 g", "", {"level": 9.81}),
        *(
            CheckItem("OK", f"channel {name}", f"{level:.4g} m at rest", "", {"level": level})
            for name, level in rest.items()
        ),
    )


UPSIDE_DOWN = CheckItem(
    "FAIL", "channel hub_acc_fl", "reads -9.79 m/s2 at rest: upside down", "set sign = -1", {}
)
NOISY = CheckItem(
    "WARN", "channel hub_acc_rr", "noise 2.4 m/s2 is more than the usual 2", "stop the engine", {}
)


async def _until(pilot: Pilot[None], condition: Callable[[], object]) -> None:
    """Wait until something is so; 30 s at most."""
    clock = asyncio.get_running_loop().time
    end_s = clock() + 30.0
    while not condition():
        assert clock() < end_s, screen_text(pilot.app)
        await pilot.pause(0.02)


def _shows(app: BenchApp, text: str) -> bool:
    return text in screen_text(app)


async def _screen(pilot: Pilot[None], kind: type) -> None:
    app = pilot.app
    assert isinstance(app, BenchApp)
    await _until(pilot, lambda: isinstance(app.screen, kind) and app.bench is not None)
    await pilot.pause()


def _bench(recorder: FakeRecorder):  # type: ignore[no-untyped-def]
    return parse_bench(recorder.bench_text, "bench.toml", None, dbc_text="")  # type: ignore[arg-type]


def _order(recorder: FakeRecorder, kind: type) -> list[object]:
    return [order for order in recorder.orders if isinstance(order, kind)]


# Vehicle ----------------------------------------------------------------------------------------


async def test_the_vehicle_form_looks_as_before(
    make_app: Make, snapshot: Callable[..., None]
) -> None:
    app = make_app(FakeRecorder())
    async with app.run_test(size=(100, 30)) as pilot:
        await _screen(pilot, VehicleScreen)
        await at_every_size(pilot, snapshot, "vehicle")


async def test_space_alone_takes_the_car_as_the_bench_describes_it(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, VehicleScreen)
        await pilot.press("space")
        await _screen(pilot, CheckScreen)
        await pilot.pause(0.1)
    assert _order(recorder, Configure) == []
    assert Mark("step vehicle done") in recorder.orders


async def test_what_is_typed_goes_to_the_recorder(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, VehicleScreen)
        await pilot.press("tab", "ctrl+u", *"T5 A1", "enter", "end", *"2")
        await pilot.press("enter", *"1552", "ctrl+s")
        await _screen(pilot, CheckScreen)
        assert app.operator == "MK2"
        await pilot.pause(0.1)
    bench = _bench(recorder)
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
        await _screen(pilot, VehicleScreen)
        await pilot.press("tab", "enter", "enter", *"15x2", "escape", "space")
        await pilot.pause()
        shown = screen_text(app)
        assert "!Total mass    [15x2" in shown
        assert "✗ Total mass: '15x2' is not a number (limit: 100 to 10000 kg)" in shown
        assert isinstance(app.screen, VehicleScreen)
        assert isinstance(app.screen.focused, Input)
        assert _order(recorder, Mark) == []
        await pilot.press("escape", "f1")
        await pilot.pause()
    assert "15x2" not in recorder.bench_text


async def test_what_was_typed_survives_a_crash_of_the_terminal(make_app: Make) -> None:
    app = make_app(FakeRecorder())
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, VehicleScreen)
        await pilot.press("tab", "enter", "enter", *"15x2")
        await _until(pilot, (app.folder / "draft_vehicle.json").exists)
    after = make_app(FakeRecorder())
    async with after.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, VehicleScreen)
        assert "!Total mass    [15x2" in screen_text(after)


async def test_a_refused_order_keeps_the_form(make_app: Make) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, VehicleScreen)
        await pilot.press("tab", "end", *"X")
        recorder.refuse = "a run is being recorded"
        await pilot.press("ctrl+s")
        await pilot.pause()
        assert isinstance(app.screen, VehicleScreen)
        assert "Ford GranadaX" in screen_text(app)


# Check ------------------------------------------------------------------------------------------


def _checked(*items: CheckItem, **levels: float) -> FakeRecorder:
    recorder = FakeRecorder(check=(*_items(**levels), *items))
    recorder.mark("vehicle")
    return recorder


async def test_the_check_looks_as_before(make_app: Make, snapshot: Callable[..., None]) -> None:
    app = make_app(_checked(NOISY, UPSIDE_DOWN))
    async with app.run_test(size=(100, 30)) as pilot:
        await _screen(pilot, CheckScreen)
        await _until(pilot, lambda: "upside down" in screen_text(app))
        await pilot.press("space")
        await pilot.pause()
        app.clear_notifications()
        await pilot.pause()
        await at_every_size(pilot, snapshot, "check")


async def test_a_failure_blocks_and_its_sign_can_be_turned(make_app: Make) -> None:
    recorder = _checked(UPSIDE_DOWN)
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, CheckScreen)
        await _until(pilot, lambda: "upside down" in screen_text(app))
        await pilot.press("space")
        await pilot.pause()
        assert "SPACE is blocked: 1 FAIL" in screen_text(app)
        assert _order(recorder, Mark) == []
        await pilot.press("i")
        await _until(pilot, lambda: _order(recorder, Configure))
    signs = {c.name: c.sign for c in _bench(recorder).channels}
    assert (signs["hub_acc_fl"], signs["hub_acc_fr"]) == (-1, 1)


async def _push(pilot: Pilot[None], recorder: FakeRecorder, corner: Corner, sign: float) -> None:
    """Push a corner for half a second between 11 s and 2 s of rest, all in live samples."""
    app = pilot.app
    assert isinstance(app, BenchApp)
    first, bins = app.lanes.end, round(13.5 / BIN_S)
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
        await _screen(pilot, CheckScreen)
        screen = app.screen
        assert isinstance(screen, CheckScreen)
        await _until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        recorder.post(Live(0, BIN_S, ()))
        await pilot.press("space")
        for corner in Corner:
            await _until(pilot, partial(recorder.orders.__contains__, Mark(f"wiggle {corner}")))
            await _push(pilot, recorder, corner, 1.0)
        await _until(pilot, lambda: "SPACE = zero" in screen_text(app))
        assert "travel_rr moved +14 mm, sign right" in screen_text(app)
        await pilot.press("space")
        await pilot.pause()
        assert "hands off the car" in screen_text(app)
        for _ in range(5):
            await screen._tick()
        await pilot.pause()
        assert "travel_fl +3.5 mm" in screen_text(app)
        recorder.check = (*_items(), NOISY)
        await pilot.press("space")
        await _until(pilot, lambda: _order(recorder, Configure))
        for _ in range(6):
            await screen._tick()
        await _until(pilot, lambda: "SPACE = override 1 WARN" in screen_text(app))
        await pilot.press("space", *"old sensor", "enter")
        await _until(pilot, lambda: "go on to step 3" in screen_text(app))
        await pilot.press("space")
        await _until(pilot, lambda: not isinstance(app.screen, CheckScreen))
    tares = {c.name: c.tare for c in _bench(recorder).channels}
    assert tares["travel_fl"] == 0.0035
    assert not any(tare for name, tare in tares.items() if name != "travel_fl")
    assert OverrideWarning("channel hub_acc_rr", "old sensor") in recorder.orders
    assert Mark("step check done") in recorder.orders


async def test_a_push_the_wrong_way_is_a_failure_that_i_mends(make_app: Make) -> None:
    recorder = _checked()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, CheckScreen)
        await _until(pilot, lambda: "SPACE = push the corners" in screen_text(app))
        await pilot.press("space")
        await _push(pilot, recorder, Corner.FRONT_LEFT, -1.0)
        await _until(pilot, lambda: "travel_fl moved the wrong way" in screen_text(app))
        assert "SPACE is blocked: 1 FAIL" in screen_text(app)
        await pilot.press("i")
        await _until(pilot, lambda: _order(recorder, Configure))
        assert {c.name: c.sign for c in _bench(recorder).channels}["travel_fl"] == -1
        await _until(pilot, lambda: recorder.orders.count(Mark("wiggle FL")) == 2)
        await pilot.press("s", *"wall", "enter")
        await _until(pilot, lambda: Mark("wiggle FR") in recorder.orders)
        assert "skipped: wall (MK)" in screen_text(app)


# Masses -----------------------------------------------------------------------------------------


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    async def compute(self: MassesScreen, text: str) -> None:
        self._gain = GAIN
        self._show_outlook()

    monkeypatch.setattr(MassesScreen, "_compute", compute)


def _loaded() -> FakeRecorder:
    recorder = FakeRecorder(check=_items())
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    return recorder


@pytest.mark.usefixtures("_quick")
async def test_the_masses_look_as_before(make_app: Make, snapshot: Callable[..., None]) -> None:
    app = make_app(_loaded())
    async with app.run_test(size=(100, 30)) as pilot:
        await _screen(pilot, MassesScreen)
        await _until(pilot, lambda: "m_ur" in screen_text(app))
        await pilot.press("b", "down")
        await pilot.pause()
        await at_every_size(pilot, snapshot, "masses")


@pytest.mark.usefixtures("_quick")
async def test_space_goes_from_weight_to_weight_and_then_on(make_app: Make) -> None:
    recorder = _loaded()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, MassesScreen)
        for number in range(1, 9):
            await _until(pilot, partial(_shows, app, f"weight {number} is bolted"))
            assert Mark("step masses done") not in recorder.orders
            await pilot.press("space")
        await _until(pilot, lambda: "all are bolted" in screen_text(app))
        await pilot.press("space")
        await _until(pilot, lambda: Mark("step masses done") in recorder.orders)
    assert _order(recorder, Configure) == []  # as the bench has them


@pytest.mark.usefixtures("_quick")
async def test_weights_are_added_changed_removed_and_undone(make_app: Make) -> None:
    recorder = _loaded()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, MassesScreen)
        await pilot.press("delete", "delete", "u", "a")
        await pilot.press("right", "enter", *"W-1", "enter", *"2,5", "ctrl+s")
        await pilot.pause()
        assert "✗ NO   FL    W-1       2.50" in screen_text(app)
        await pilot.press("b", "space")
        for _ in range(8):
            await pilot.press("space")
        await pilot.pause()
        await pilot.press("space")
        await _until(pilot, lambda: Mark("step masses done") in recorder.orders)
    weights = _bench(recorder).mass_states[1].added.weights
    assert len(weights) == 8
    assert weights[-1] == HubWeight(2.5, Corner.FRONT_LEFT, 0.01)
    assert weights[0] == BodyWeight(32.5, 0.14, -0.55)
    (note,) = _order(recorder, Note)
    assert note == Note("weights: 8 W-1")
    assert not (app.folder / "draft_masses.json").exists()


@pytest.mark.usefixtures("_quick")
async def test_a_weight_half_typed_survives_esc_and_a_crash(make_app: Make) -> None:
    app = make_app(_loaded())
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, MassesScreen)
        await pilot.press("b", "a", "enter", *"M-9", "enter", *"2x", "ctrl+s")
        await pilot.pause()
        assert "Mass: '2x' is not a number (limit: 0.1 to 500 kg)" in screen_text(app)
        await pilot.press("escape", "a")
        await pilot.pause()
        assert "!Mass      [2x" in screen_text(app)
        await _until(pilot, (app.folder / "draft_masses.json").exists)
        await pilot.pause(0.1)
    after = make_app(_loaded())
    async with after.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, MassesScreen)
        assert " 1 ✓ yes  body" in screen_text(after)
        await pilot.press("a")
        await pilot.pause()
        assert "!Mass      [2x" in screen_text(after)


async def test_the_outlook_comes_from_a_process_of_its_own(make_app: Make) -> None:
    recorder = _loaded()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, MassesScreen)
        assert "computing" in screen_text(app)
        await _until(pilot, lambda: "bounce 1.05 -> 1.00 Hz" in screen_text(app))


@pytest.mark.usefixtures("_quick")
async def test_the_body_that_sank_tells_the_springs(make_app: Make) -> None:
    recorder = _loaded()
    app = make_app(recorder)
    (app.folder / "rest.json").write_text('{"travel_fl": 0.0, "travel_fr": 0.0, '
                                          '"travel_rl": 0.0, "travel_rr": 0.0}')  # fmt: skip
    async with app.run_test(size=(80, 24)) as pilot:
        await _screen(pilot, MassesScreen)
        await _until(pilot, lambda: "has not sunk" in screen_text(app))
        down = {f"travel_{c.lower()}": 0.0205 if c.front else 0.0131 for c in Corner}
        recorder.check = tuple(
            replace(item, figures={"level": down.get(item.subject[8:], 9.81)})
            for item in recorder.check
        )
        await pilot.press("r")
        await _until(pilot, lambda: "spring front 17.0 kN/m" in screen_text(app))
