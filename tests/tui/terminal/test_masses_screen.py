"""The masses: weight after weight by SPACE alone, typed, undone, and what they bring."""

import json
from collections.abc import Callable
from dataclasses import replace

import pytest

from daq.control.orders import Mark, Note, OverrideWarning
from daq.vehicle import BodyWeight, Corner, HubWeight
from tui.jobs.gain import Gain, Shift
from tui.terminal.app import BenchApp
from tui.terminal.screens.masses import MassesScreen

from .conftest import at_every_size, screen_text
from .fake_recorder import FakeRecorder
from .operated import Make, bench_of, check_items, orders_of, reach, until

GAIN = Gain(
    (Shift("bounce", 1.05, 1.00), Shift("pitch", 1.31, 1.25), Shift("roll", 1.65, 1.64)),
    0.0073,
    0.0055,
    "m_ur",
)


OUTLOOK = MassesScreen._compute
"""As it is; other tests have none."""

# Masses -----------------------------------------------------------------------------------------


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    async def compute(self: MassesScreen, text: str) -> None:
        self._gain = GAIN
        self._show_outlook()

    monkeypatch.setattr(MassesScreen, "_compute", compute)


def _loaded() -> FakeRecorder:
    recorder = FakeRecorder(check=check_items())
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    return recorder


@pytest.mark.usefixtures("_quick")
async def test_the_masses_look_as_before(make_app: Make, snapshot: Callable[..., None]) -> None:
    app = make_app(_loaded())
    async with app.run_test(size=(100, 30)) as pilot:
        await reach(pilot, MassesScreen)
        await until(pilot, lambda: "m_ur" in screen_text(app))
        await pilot.press("b", "down")
        await pilot.pause()
        await at_every_size(pilot, snapshot, "masses")


@pytest.mark.usefixtures("_quick")
async def test_weights_are_added_changed_removed_and_undone(make_app: Make) -> None:
    recorder = _loaded()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        await pilot.press("delete", "delete", "u", "a")
        await pilot.press(*"W-1", "enter", *"2,5", "enter", "enter", "right", "ctrl+s")
        await pilot.pause()
        assert "✗ NO   FL    W-1     2.50" in screen_text(app)
        await pilot.press("b", "space")
        for _ in range(8):
            await pilot.press("space")
        await pilot.pause()
        await pilot.press("space")
        await until(pilot, lambda: Mark("step masses done") in recorder.orders)
    weights = bench_of(recorder).mass_states[1].added.weights
    assert len(weights) == 8
    assert weights[-1] == HubWeight(2.5, Corner.FRONT_LEFT, 0.01)
    assert weights[0] == BodyWeight(32.5, 0.14, -0.55)
    (note,) = orders_of(recorder, Note)
    assert note == Note("weights: 8 W-1")
    assert not (app.folder / "draft_masses.json").exists()


@pytest.mark.usefixtures("_quick")
async def test_a_weight_half_typed_survives_esc_and_a_crash(make_app: Make) -> None:
    app = make_app(_loaded())
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        await pilot.press("b", "a", *"M-9", "enter", *"2x", "ctrl+s")
        await pilot.pause()
        assert "Mass: '2x' is not a number (limit: 0.1 to 500 kg)" in screen_text(app)
        await pilot.press("escape", "a")
        await pilot.pause()
        assert "!Mass      [2x" in screen_text(app)
        await until(pilot, (app.folder / "draft_masses.json").exists)
        await pilot.pause(0.1)
    after = make_app(_loaded())
    async with after.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        assert " 1 ✓ yes  body" in screen_text(after)
        await pilot.press("a")
        await pilot.pause()
        assert "!Mass      [2x" in screen_text(after)


async def test_the_outlook_comes_from_a_process_of_its_own(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(MassesScreen, "_compute", OUTLOOK)
    recorder = _loaded()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        assert "computing" in screen_text(app)
        await until(pilot, lambda: "bounce 1.05 -> 1.00 Hz" in screen_text(app))


@pytest.mark.usefixtures("_quick")
async def test_the_body_that_sank_tells_the_springs(make_app: Make) -> None:
    recorder = _loaded()
    app = make_app(recorder)
    (app.folder / "rest.json").write_text('{"travel_fl": 0.0, "travel_fr": 0.0, '
                                          '"travel_rl": 0.0, "travel_rr": 0.0}')  # fmt: skip
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        await until(pilot, lambda: "has not sunk" in screen_text(app))
        down = {f"travel_{c.lower()}": 0.0205 if c.front else 0.0131 for c in Corner}
        recorder.check = tuple(
            replace(item, figures={"level": down.get(item.subject[8:], 9.81)})
            for item in recorder.check
        )
        await pilot.press("r")
        await until(pilot, lambda: "spring front 17.0 kN/m" in screen_text(app))


@pytest.mark.usefixtures("_quick")
async def test_a_weight_that_the_sag_contradicts_stops_space(make_app: Make) -> None:
    """A weight typed as 325 instead of 32.5 kg is named before any run with it."""
    recorder = _loaded()
    app = make_app(recorder)
    rest = {f"travel_{c.lower()}": 0.0 for c in Corner}
    (app.folder / "rest.json").write_text(json.dumps(rest))
    down = {f"travel_{c.lower()}": 0.0191 if c.front else 0.0144 for c in Corner}
    recorder.check = tuple(
        replace(item, figures={"level": down.get(item.subject[8:], 9.81)})
        for item in recorder.check
    )
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        await pilot.press("e", "tab", *["backspace"] * 8, *"325", "ctrl+s")
        await until(pilot, lambda: "325.00" in screen_text(app))
        for _ in range(10):
            await pilot.press("space")
        await until(pilot, lambda: "FAIL weight 1 says 325 kg; the body sank as for 3" in text(app))
        await pilot.press("space")
        await pilot.pause()
        assert Mark("step masses done") not in recorder.orders
        assert "SPACE Next" not in screen_text(app)
        await pilot.press("o", *"scale", "enter")
        await until(pilot, lambda: Mark("step masses done") in recorder.orders)
    (override,) = orders_of(recorder, OverrideWarning)
    assert isinstance(override, OverrideWarning)
    assert override.reason.startswith("weight 1 says 325 kg; the body sank as for 3")
    assert override.reason.endswith(": scale")


def text(app: BenchApp) -> str:
    """Return what the screen shows, each run of blanks as one."""
    return " ".join(screen_text(app).split())
