"""Home and run screen as text, in every phase and size, and without colour."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest
from textual.app import App
from textual.pilot import Pilot

from daq.bench.config import default_bench_text
from daq.control.messages import (
    Alarm,
    BusState,
    BusStatus,
    Choose,
    Phase,
)
from daq.runs import Excitation
from tui.terminal.app import BenchApp
from tui.terminal.chart import LaneChart
from tui.terminal.feed import Lost
from tui.terminal.screens.bumping import HomeScreen

from .conftest import SIZES, at_every_size, screen_text
from .fake_recorder import DOUBLE_BUMP, WALL_NS, FakeRecorder

MakeApp = Callable[..., BenchApp]
Snapshot = Callable[[App[None], str], None]


def _before(recorder: FakeRecorder) -> None:
    """One run accepted, one rejected, the third is due."""
    recorder.mark("vehicle", "check")
    recorder.bump()
    recorder.judge()
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)


def _idle(recorder: FakeRecorder) -> None:
    recorder.turn(Phase.IDLE)


def _waiting(recorder: FakeRecorder) -> None:
    recorder.publish(not_at_rest=("hub_acc_fl", "hub_acc_rr"))
    recorder.turn(Phase.WAITING)


def _armed(recorder: FakeRecorder) -> None:
    recorder.turn(Phase.ARMED)


def _triggered(recorder: FakeRecorder) -> None:
    recorder.bump()


def _decay(recorder: FakeRecorder) -> None:
    recorder.bump()
    recorder.t_ns += 1_400_000_000
    recorder.turn(Phase.DECAY)


def _accepted(recorder: FakeRecorder) -> None:
    recorder.bump()
    recorder.judge()


def _rejected(recorder: FakeRecorder) -> None:
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)


def _paused(recorder: FakeRecorder) -> None:
    recorder.turn(Phase.PAUSED)


def _complete(recorder: FakeRecorder) -> None:
    recorder.finish("baseline")
    recorder.mark("masses")
    recorder.finish("added")


def _lost(recorder: FakeRecorder) -> None:
    recorder.turn(Phase.ARMED)
    recorder.post(Lost("the recorder has ended", "all up to then is on the disk"))


STATES = {
    "idle": _idle,
    "waiting": _waiting,
    "armed": _armed,
    "triggered": _triggered,
    "decay": _decay,
    "accepted": _accepted,
    "rejected": _rejected,
    "paused": _paused,
    "complete": _complete,
    "lost": _lost,
}


async def _turn_to(app: BenchApp, pilot: Pilot[None], state: str) -> str:
    """Show a state that a recorder of its own publishes; return the screen as text."""
    recorder = FakeRecorder()
    recorder.start(app.post)
    _before(recorder)
    STATES[state](recorder)
    app.lanes.clear()
    recorder.post(recorder.live())
    await pilot.pause()
    await pilot.pause()
    return screen_text(app)


@asynccontextmanager
async def _running(
    make_app: MakeApp, size: str = "80x24", glyphs: str = "braille"
) -> AsyncIterator[tuple[BenchApp, Pilot[None]]]:
    """Run an app on the run screen."""
    recorder = FakeRecorder()
    _before(recorder)
    app = make_app(recorder, glyphs)
    async with app.run_test(size=SIZES[size]) as pilot:
        await pilot.pause()
        await app.open("run")
        await pilot.pause()
        yield app, pilot


async def test_home(make_app: MakeApp, snapshot: Snapshot) -> None:
    recorder = FakeRecorder()
    _before(recorder)
    recorder.turn(Phase.IDLE)
    app = make_app(recorder)
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        recorder.post(recorder.live())
        await at_every_size(pilot, snapshot, "home")
        await pilot.resize_terminal(80, 24)
        await pilot.press("v")
        await pilot.pause()
        snapshot(app, "home_runs_80x24")


@pytest.mark.parametrize("size", SIZES)
async def test_run(make_app: MakeApp, snapshot: Snapshot, size: str) -> None:
    async with _running(make_app, size) as (app, pilot):
        for state in STATES:
            await _turn_to(app, pilot, state)
            snapshot(app, f"run_{state}_{size}")


async def test_every_state_says_in_words_what_it_is_without_colour(
    make_app: MakeApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    banners = set()
    async with _running(make_app, glyphs="ascii") as (app, pilot):
        assert app.no_color
        for state in STATES:
            lines = (await _turn_to(app, pilot, state)).splitlines()[2:5]
            word = "RECORDER LOST" if state == "lost" else state.upper()
            assert word in lines[0]
            banners.add("\n".join(lines))
    assert len(banners) == len(STATES)


@pytest.mark.parametrize("glyphs", ["blocks", "ascii"])
async def test_other_characters(make_app: MakeApp, snapshot: Snapshot, glyphs: str) -> None:
    async with _running(make_app, glyphs=glyphs) as (app, pilot):
        text = await _turn_to(app, pilot, "decay")
        snapshot(app, f"run_decay_80x24_{glyphs}")
    lanes = "\n".join(text.splitlines()[5:21])
    assert lanes.isascii() is (glyphs == "ascii")
    assert not any("\u2800" < char <= "\u28ff" for char in text)


async def test_four_lanes_in_80x24_and_eight_from_40_rows(make_app: MakeApp) -> None:
    for size, most in (("80x24", 4), ("140x40", 8)):
        async with _running(make_app, size) as (app, _):
            assert app.screen.query_one(LaneChart).room == most


async def test_a_bad_bus_and_alarms_are_said_with_advice(make_app: MakeApp) -> None:
    recorder = FakeRecorder()
    _before(recorder)
    recorder.turn(Phase.IDLE)
    app = make_app(recorder)
    async with app.run_test(size=(140, 40)) as pilot:
        await pilot.pause()
        alarm = Alarm("bus_off", "can0", "off after 256 errors", "check termination", WALL_NS)
        recorder.publish(
            alarms=(alarm,),
            buses=(BusStatus("can0", BusState.BUS_OFF, 0.0, 0.0, 10, 3, 0),),
            sensors_alive=2,
        )
        await pilot.pause()
        text = screen_text(app)
        assert isinstance(app.screen, HomeScreen)
        assert "BUS-OFF" in text.splitlines()[0]
        assert "2/4 alive" in text.splitlines()[0]
        assert "BUS OFF can0: off after 256 errors: check termination" in text


@pytest.mark.parametrize("size", ["80x24", "140x40"])
async def test_five_kinds_of_bump_find_room(
    make_app: MakeApp, snapshot: Snapshot, size: str
) -> None:
    usual = default_bench_text()
    text = usual.replace('["bounce", "pitch", "roll"]', str([kind.value for kind in Excitation]))
    assert text != usual
    recorder = FakeRecorder(text)
    _before(recorder)
    await recorder.ask(Choose("baseline", Excitation.REAR_PITCH))
    recorder.turn(Phase.ARMED)
    app = make_app(recorder)
    async with app.run_test(size=SIZES[size]) as pilot:
        await pilot.pause()
        await app.open("run")
        await pilot.pause()
        await pilot.pause()
        snapshot(app, f"run_rear_pitch_{size}")
        assert "rear pitch 1 of 2" in screen_text(app)
        recorder.turn(Phase.IDLE)
        await app.open("home")
        await pilot.pause()
        await pilot.pause()
        snapshot(app, f"home_rear_pitch_{size}")
        assert "REAR PITCH" in screen_text(app)
