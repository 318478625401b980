"""The screen of the bumps as text: every phase, size and set of characters, and no colour."""

from __future__ import annotations

import unicodedata
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
from rich.cells import cell_len
from textual.color import Color
from textual.content import Content
from textual.pilot import Pilot
from textual.theme import Theme

from daq.bench.campaign import Origin
from daq.bench.config import default_bench_text
from daq.control.messages import (
    Alarm,
    BusState,
    BusStatus,
    Choose,
    Phase,
    SessionState,
    SessionStatus,
)
from daq.runs import Excitation, Losses
from tui.terminal.app import BenchApp
from tui.terminal.campaign import BenchStep, next_action
from tui.terminal.device import THEMES
from tui.terminal.feed import STARTING, Lost
from tui.terminal.screens.base import step_line, top_line

from ...flow.display_campaign import contrast
from .conftest import SIZES, Snapshot, at_every_size, screen_text
from .fake_recorder import DOUBLE_BUMP, FakeRecorder, ready
from .operated import PLAIN, Make, playing
from .test_steps import NOISY, UPSIDE_DOWN


def _before(recorder: FakeRecorder) -> None:
    """One run accepted, one rejected, the third is due."""
    recorder.mark("vehicle", "check")
    recorder.bump()
    recorder.judge()
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)


def _waiting(recorder: FakeRecorder) -> None:
    recorder.publish(not_at_rest=("hub_acc_fl", "hub_acc_rr"))
    recorder.turn(Phase.WAITING)


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


def _complete(recorder: FakeRecorder) -> None:
    recorder.finish("baseline")
    recorder.mark("masses")
    recorder.finish("added")


def _lost(recorder: FakeRecorder) -> None:
    recorder.turn(Phase.ARMED)
    recorder.post(Lost("the recorder has ended", "all up to then is on the disk"))


STATES: dict[str, Callable[[FakeRecorder], object]] = {
    "idle": partial(FakeRecorder.turn, phase=Phase.IDLE),
    "waiting": _waiting,
    "armed": partial(FakeRecorder.turn, phase=Phase.ARMED),
    "triggered": FakeRecorder.bump,
    "decay": _decay,
    "accepted": _accepted,
    "rejected": _rejected,
    "paused": partial(FakeRecorder.turn, phase=Phase.PAUSED),
    "complete": _complete,
    "lost": _lost,
}


def with_every_bump() -> str:
    """Return a bench.toml that plans every kind of bump."""
    usual = default_bench_text()
    text = usual.replace('["bounce", "pitch", "roll"]', str([kind.value for kind in Excitation]))
    assert text != usual
    return text


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
    make_app: Make, size: str = "80x24", glyphs: str = "braille"
) -> AsyncIterator[tuple[BenchApp, Pilot[None]]]:
    """Run an app on the screen of the bumps."""
    recorder = FakeRecorder()
    _before(recorder)
    app = make_app(recorder, glyphs)
    async with app.run_test(size=SIZES[size]) as pilot:
        await pilot.pause()
        await app.open("home")
        await pilot.pause()
        yield app, pilot


async def test_home(make_app: Make, snapshot: Snapshot) -> None:
    recorder = FakeRecorder()
    _before(recorder)
    recorder.turn(Phase.IDLE)
    app = make_app(recorder)
    async with playing(app, (100, 30)) as pilot:
        recorder.post(recorder.live())
        await at_every_size(pilot, snapshot, "home")
        await pilot.resize_terminal(80, 24)
        await pilot.press("v")
        await pilot.pause()
        snapshot(app, "home_runs_80x24")


ALSO_WIDE = ("idle", "decay", "rejected")
"""States that differ where there is room for lists beside the chart."""


async def test_run(make_app: Make, snapshot: Snapshot) -> None:
    async with _running(make_app) as (app, pilot):
        for state in STATES:
            await _turn_to(app, pilot, state)
            snapshot(app, f"run_{state}_80x24")
        await pilot.resize_terminal(140, 40)
        for state in ALSO_WIDE:
            await _turn_to(app, pilot, state)
            snapshot(app, f"run_{state}_140x40")


async def test_at_every_size_and_without_colour_words_say_the_state_and_what_space_does(
    make_app: Make, monkeypatch: pytest.MonkeyPatch, snapshot: Snapshot
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with _running(make_app, glyphs="blocks") as (app, pilot):
        assert app.no_color
        text = await _turn_to(app, pilot, "decay")
        snapshot(app, "run_decay_80x24_blocks")
        assert not any("\u2800" < char <= "\u28ff" for char in text)
        await pilot.resize_terminal(40, 12)
        for state in STATES:
            first_line = (await _turn_to(app, pilot, state)).splitlines()[2]
            assert ("RECORDER LOST" if state == "lost" else state.upper()) in first_line
            words = "X = start it again" if state == "lost" else next_action(app.status).words
            assert words in first_line
        recorder = FakeRecorder(with_every_bump())
        recorder.finish("baseline")
        recorder.mark("masses")
        await recorder.ask(Choose("baseline", Excitation.REAR_PITCH))
        recorder.turn(Phase.COMPLETE)
        recorder.start(app.post)
        await pilot.pause()
        assert "SPACE = one more rear pitch" in screen_text(app)


async def test_five_kinds_of_bump_find_room(make_app: Make, snapshot: Snapshot) -> None:
    recorder = FakeRecorder(with_every_bump())
    _before(recorder)
    await recorder.ask(Choose("baseline", Excitation.REAR_PITCH))
    recorder.turn(Phase.ARMED)
    app = make_app(recorder)
    async with playing(app) as pilot:
        await pilot.pause()
        snapshot(app, "run_rear_pitch_80x24")
        assert "rear pitch 1 of 2" in screen_text(app)
        recorder.turn(Phase.IDLE)
        await pilot.pause()
        await pilot.pause()
        snapshot(app, "home_rear_pitch_80x24")
        assert "next: baseline rear pitch" in screen_text(app)


FOREIGN = {
    "acts": "[/x] [@click=app.quit]q[/]\x1b[31m\x1b]0;x\x07b\r\n\tc\x9b31m\x00 \u202e\u05e9\u05dc",
    "is wide": "日本語の車両番号👩\u200d🔧🚗🇩🇪e\u0301" * 8 + "W" * 200,
}
_INVISIBLE = {"Cc", "Cf", "Cs"}


def _bad_lines(app: BenchApp, columns: int) -> list[str]:
    """Return lines that are wider than the terminal or would act on it."""
    return [
        line
        for line in screen_text(app).splitlines()
        if cell_len(line) > columns or any(unicodedata.category(c) in _INVISIBLE for c in line)
    ]


def _reported_by(recorder: FakeRecorder, text: str) -> None:
    recorder.mark("vehicle", "check")
    recorder.bump()
    recorder.judge(replace(DOUBLE_BUMP, text=text, advice=text))
    due = recorder.status.due
    assert due is not None
    recorder.phase = Phase.IDLE
    recorder.changes |= {
        "vehicle": text,
        "alarms": tuple(Alarm("bus_off", text, text, text, 0) for _ in range(5)),
        "overloaded": (text, text),
        "not_at_rest": (text,),
        "buses": (BusStatus(text, BusState.BUS_OFF, 0.3, 1.0, 1, 1, 1),),
        "due": replace(due, instruction=text),
        "session": SessionStatus(SessionState.FAILED, text, text),
        "disk": replace(recorder.status.disk, failed=text, warning=text),
    }


@pytest.mark.parametrize("name", FOREIGN)
async def test_foreign_text_only_shows(name: str, make_app: Make) -> None:
    text = FOREIGN[name]
    warned = replace(NOISY, subject=f"channel {text}", text=text, advice=text)
    recorder = FakeRecorder(check=(warned, replace(UPSIDE_DOWN, text=text, advice=text)))
    _reported_by(recorder, text)
    app = make_app(recorder)
    app.operator = text
    async with playing(app, (60, 20)) as pilot:
        for screen in ("home", "check", "identify", "report"):
            await app.open(screen)
            await pilot.pause()
            await pilot.pause()
            assert _bad_lines(app, 60) == [], screen
        await pilot.press("t")
        await pilot.pause()
        assert _bad_lines(app, 60) == []
        await pilot.press("escape")
        app.warn(text)
        recorder.post(Lost(text, text))
        await pilot.pause()
        assert _bad_lines(app, 60) == []


@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
def test_every_colour_of_words_stands_out_from_every_ground(theme: Theme) -> None:
    words = ("foreground", "primary", "warning", "error", "success", "accent")
    for word in words:
        for ground in ("background", "surface", "panel"):
            one, other = (Color.parse(getattr(theme, name)).rgb for name in (word, ground))
            assert contrast(str(one), str(other)) >= 4.5, (word, ground)


STATUS = FakeRecorder().status


def context(**changes: Any) -> Any:
    plain = {
        "status": STATUS, "glyphs": PLAIN, "lost": None, "operator": "MK", "in_control": True,
    }  # fmt: skip
    return SimpleNamespace(**plain | changes)


def top(width: int, app: Any = None, **changes: Any) -> str:
    return top_line(app or context(status=replace(STATUS, **changes)), width).plain


def style(content: Content, words: str) -> str:
    """Return how the first of these words are shown."""
    at = content.plain.index(words)
    return " ".join(str(span.style) for span in content.spans if span.start <= at < span.end)


def test_the_top_line_of_a_narrow_terminal() -> None:
    plain = top(119)
    assert plain.startswith(" Ford Granada · 2026-11-21 · op. MK  ")
    assert plain.endswith("   │ can0 * 38%  4/4 alive  disk 81 GB")
    assert len(plain) == 119, "both ends of the line"
    assert top(119, losses=Losses(bus_dropped=2, counter_gaps=1)).endswith("lost 3  disk 81 GB")
    assert top(119, sensors_alive=3).endswith("3/4 alive  disk 81 GB")
    for free_bytes, words in ((999_999_999, "disk 1000 MB"), (1_000_000_000, "disk 1 GB")):
        assert top(119, disk=replace(STATUS.disk, free_bytes=free_bytes)).endswith(words)
    assert " VIEWER, MK in control " in top(119, context(in_control=False))
    free = replace(STATUS, controller="")
    assert "VIEWER, no terminal in control" in top(119, context(in_control=False, status=free))
    over = top(119, overloaded=("hub_acc_fl", "hub_acc_fr", "hub_acc_rl"))
    assert "│ ^ OVERLOAD hub_acc_fl, hub_acc_f" in over
    buses = (
        BusStatus("socketcan can1", BusState.OK, 0.384, 4e3, 10, 0, 0),
        BusStatus("vector 12345", BusState.BUS_OFF, 0.0, 0.0, 0, 9, 0),
    )
    assert "can1 * 38%  12345 x BUS-OFF  4/4" in top(119, buses=buses)
    assert "socketcan can1 * 38%" in top(120, buses=buses)
    assert "lost 0  disk 81 GB" in top(120)
    marked = top(119, origin=Origin.SIMULATED)
    assert marked.startswith(" SIMULATED  Ford Granada · 2026-11-21 · op. MK")


def test_a_top_line_without_room_leaves_out_the_day_then_the_words() -> None:
    assert top(74).startswith(" Ford Granada · 2026-11-21 · op. MK")
    assert top(74, origin=Origin.REPLAYED).startswith(" REPLAYED  Ford Granada · op. MK")
    assert "2026" not in top(74, vehicle="x" * 30)


def test_a_top_line_without_a_recorder_says_what_to_press() -> None:
    assert top(100, context(status=None)) == " BUMP  waiting for the recorder"
    assert top(100, context(lost=STARTING)) == " STARTING  the recorder is being started"
    lost = context(lost=Lost("it has ended", "see its log"))
    said = " RECORDER LOST: X = start it again (in a field Esc, then X)  it has ended"
    assert top(100, lost) == said


def test_the_steps_are_marked_as_done_here_or_to_come() -> None:
    recorder = ready()
    steps = step_line(recorder.status, BenchStep.BASELINE, "+")
    words = "+ 1 Vehicle + 2 Check [3 Baseline]   4 Masses   5 Added   6 Identify   7 Report"
    assert steps.plain.rstrip() == words
    assert style(steps, "2 Check") == "bold $success"
    assert style(steps, "[3 Baseline]") == "bold reverse"
    steps = step_line(recorder.status, None, "+")
    assert style(steps, "3 Baseline") == "bold", "it is reached"
    assert style(steps, "4 Masses") == "$foreground"
    assert step_line(None, BenchStep.VEHICLE, "+").plain.startswith("[1 Vehicle]   2 Check")
