"""The masses: weight after weight by SPACE alone, typed, undone, and what they bring."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import pytest
from textual.pilot import Pilot

from daq.bench.campaign import Method
from daq.bench.config import default_bench_text, load_bench
from daq.bench.edit import with_campaign
from daq.control.messages import Configure, Mark, OverrideWarning
from daq.loading import loading
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, BodyWeight, Corner, HubWeight
from tui.jobs.planning import Gain, Shift, measured_spread
from tui.terminal.app import BenchApp
from tui.terminal.screens.check import (
    CheckScreen,
)
from tui.terminal.screens.masses import MassesScreen
from tui.terminal.screens.weights import (
    Entry,
    WeightScreen,
    axle_loads_with,
    baseline_hz,
    entries_of,
    entry_values,
    gain_line,
    shift_line,
    sketch,
)
from tui.terminal.widgets import Table

from .conftest import at_every_size, screen_text
from .fake_recorder import DOUBLE_BUMP, GOOD, FakeRecorder
from .operated import Make, check_items, orders_of, reach, until

GAIN = Gain(
    (Shift("bounce", 1.05, 1.00), Shift("pitch", 1.31, 1.25), Shift("roll", 1.65, 1.64)),
    0.0073,
    0.0055,
    "m_ur",
)
OUTLOOK = MassesScreen._compute
"""As it is; other tests have none."""


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


def text(app: BenchApp) -> str:
    """Return what the screen shows, each run of blanks as one."""
    return " ".join(screen_text(app).split())


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


@pytest.fixture
def by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the check ask again only where a test says so, not each second."""
    monkeypatch.setattr(CheckScreen, "on_mount", lambda _: None)


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
        assert front(app) is screen
        assert orders_of(recorder, Mark) == []
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


async def test_a_weight_that_the_sag_contradicts_stops_space(make_app: Make) -> None:
    """A weight typed as 325 instead of 32.5 kg is named before any run with it."""
    sunk = {f"travel_{c.lower()}": 0.0191 if c.front else 0.0144 for c in Corner}
    recorder = FakeRecorder(check=check_items(**sunk))
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    app = make_app(recorder)
    (app.folder / "rest.json").write_text(json.dumps(dict.fromkeys(sunk, 0.0)))
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        await pressed(pilot, "e", "tab", "ctrl+u", *"325", "ctrl+s")
        await until(pilot, lambda: "325.00" in seen(app))
        await pressed(pilot, *["space"] * 10)
        await until(pilot, lambda: "FAIL weight 1 says 325 kg; the body sank as for 3" in text(app))
        await pressed(pilot, "space")
        assert Mark("step masses done") not in recorder.orders
        assert "SPACE =" not in seen(app)
        await pressed(pilot, "o", *"scale", "enter")
        await until(pilot, lambda: Mark("step masses done") in recorder.orders)
    (override,) = orders_of(recorder, OverrideWarning)
    assert isinstance(override, OverrideWarning)
    assert override.reason.startswith("weight 1 says 325 kg; the body sank as for 3")
    assert override.reason.endswith(": scale")


async def test_weights_that_the_sag_confirms_go_on(make_app: Make) -> None:
    sunk = {f"travel_{c.lower()}": 0.0191 if c.front else 0.0144 for c in Corner}
    recorder = FakeRecorder(check=check_items(**sunk))
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    app = make_app(recorder)
    (app.folder / "rest.json").write_text(json.dumps(dict.fromkeys(sunk, 0.0)))
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        await pressed(pilot, *["space"] * 10)
        await until(pilot, lambda: Mark("step masses done") in recorder.orders)
    assert orders_of(recorder, OverrideWarning) == []


BENCH = load_bench(None)
ENTRIES = (
    Entry(BodyWeight(20.0, 0.0, 0.6), "M-07"),
    Entry(BodyWeight(20.0, -2.76, -0.6, 0.1, 0.01), "M-08", True),
    Entry(HubWeight(4.0, Corner.FRONT_LEFT)),
)


def test_a_draft_of_the_weights_is_read_back() -> None:
    reported = json.loads(json.dumps({"entries": entry_values(ENTRIES)}))
    assert entries_of((), reported) == ENTRIES
    weights = tuple(e.weight for e in ENTRIES)
    assert entries_of(weights, {}) == tuple(Entry(w) for w in weights)
    assert entries_of(weights, {"entries": [{"mass_kg": "much"}, 3]}) == ()


def test_the_sketch_shows_each_weight_where_it_is() -> None:
    load = loading([entry.weight for entry in ENTRIES], FORD_GRANADA)
    lines = sketch(ENTRIES, FORD_GRANADA, load, wide=False)
    at = {c: (r, line.index(c)) for r, line in enumerate(lines) for c in "12" if c in line}
    assert at["1"][0] < at["2"][0]  # the front is at the top
    assert at["1"][1] < at["2"][1]  # left is left
    assert lines[1].startswith("   3+")  # on the front left hub
    assert "RR" in lines[-1]
    total_kg, (front_kg, rear_kg) = axle_loads_with(load, FORD_GRANADA)
    drawing = "\n".join(sketch(ENTRIES, FORD_GRANADA, load, wide=True))
    for text in (
        f"axle {front_kg:.0f} kg",
        f"axle {rear_kg:.0f} kg",
        f"car alone {total_kg:.0f} kg",
    ):
        assert text in drawing


def test_the_outlook_says_what_stays_unknown() -> None:
    assert gain_line(Gain(worst=0.02, mean=0.01, widest="m_ur")) == (
        "parameters ± 1.0% in the mean, m_ur ± 2.0% at worst", ""
    )  # fmt: skip
    lost = Gain(undetermined=("m_s", "k_sf"), remedies=("weigh each axle to 1 kg",))
    assert gain_line(lost)[1] == "WEAK, not determined: m_s, k_sf; add: weigh each axle to 1 kg"
    assert "no outlook: oh" in gain_line(Gain(error="oh"))[1]


def test_a_shift_of_three_spreads_is_enough_and_a_weaker_one_says_what_to_add() -> None:
    shift = Shift("pitch", 1.0, 1.25)
    assert shift_line(shift, 0.0625) == ("pitch  1.00 -> 1.25 Hz +25.0%  4x spread: good", "")
    assert shift_line(Shift("pitch", 1.0, 1.1875), 0.0625)[1] == ""
    weak = shift_line(Shift("pitch", 1.0, 1.18), 0.0625)
    assert weak[1] == "WEAK 3x, want 3x: more kg at an end of the car"
    assert shift_line(Shift("roll", 1.0, 1.016), None)[0].endswith("3x usual spread: good")
    assert shift_line(Shift("roll", 1.0, 1.014), None)[1].endswith("more kg at the sides")
    assert shift_line(Shift("bounce", 1.0, 1.0), 0.0)[1].endswith("more kg on the body")


def test_the_spread_is_that_of_the_accepted_baseline_runs() -> None:
    text = with_campaign(default_bench_text(), (Excitation.BOUNCE,), 3, Method.DROP, 0.04, 3.0)
    recorder = FakeRecorder(text)
    for hertz in (1.40, 1.41, 1.42):
        recorder.bump()
        recorder.judge(DOUBLE_BUMP, replace(GOOD, code="motion", unit="Hz", value=9.0))
        recorder.bump()
        recorder.judge(GOOD, replace(GOOD, code="motion", unit="Hz", value=hertz))
    assert baseline_hz(recorder.status, "bounce") == [1.40, 1.41, 1.42]
    assert baseline_hz(recorder.status, "pitch") == baseline_hz(None, "bounce") == []
    assert measured_spread([1.40, 1.41, 1.42]) == pytest.approx(0.01 / 1.41)
    assert measured_spread([1.40, 1.41]) is None


@pytest.mark.usefixtures("_quick")
async def test_weights_survive_a_crash_and_esc_discards_what_is_typed(make_app: Make) -> None:
    app = make_app(_loaded())
    async with app.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        await pilot.press("b", "a", *"M-9", "enter", *"2x", "ctrl+s")
        await pilot.pause()
        assert "Mass: '2x' is not a number (limit: 0.1 to 500 kg)" in text(app)
        await pilot.press("escape", "a")
        await pilot.pause()
        assert "2x" not in text(app)
    after = make_app(_loaded())
    async with after.run_test(size=(80, 24)) as pilot:
        await reach(pilot, MassesScreen)
        assert " 1 ✓ yes  body" in screen_text(after)
