"""The screen keeps its promises: its step, what SPACE does, what to do if all is not well."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from textual.pilot import Pilot

from daq.alarms.texts import EXPLAINED
from daq.control.messages import (
    Alarm,
    Phase,
    Status,
)
from dbc.finding import Finding, Severity
from tui.display.view import headline
from tui.terminal.app import BenchApp
from tui.terminal.campaign import (
    BenchStep,
    first_obstacle,
    next_action,
    obstacle,
)
from tui.terminal.feed import STARTING, Lost
from tui.terminal.screens.bumping import HomeScreen, RunScreen
from tui.terminal.widgets import HelpScreen
from tui.terminal.words import (
    Signal,
    banner,
    choose_glyphs,
)

from .conftest import screen_text
from .fake_recorder import DOUBLE_BUMP, WALL_NS, FakeRecorder
from .operated import until

MakeApp = Callable[..., BenchApp]
SMALL = (80, 24)
MOTION = Finding("motion", Severity.NOTE, "f 1.15 Hz", "", "", 1.15, 0.0, "Hz")
LONG = replace(
    DOUBLE_BUMP,
    text="second bump at +0.85 s: hub_acc_fr with 100% of the first (limit 25%)",
    advice="bump once, then keep off the car until the run has ended",
)


def _bench(*steps: str) -> FakeRecorder:
    recorder = FakeRecorder()
    recorder.mark(*(steps or ("vehicle", "check")))
    return recorder


def _line(app: BenchApp, number: int) -> str:
    return screen_text(app).splitlines()[number]


async def _settle(pilot: Pilot[None]) -> None:
    for _ in range(3):
        await pilot.pause()


async def test_the_step_bar_is_of_what_the_screen_shows(make_app: MakeApp) -> None:
    recorder = _bench()
    recorder.finish("baseline")
    recorder.mark("masses")
    app = make_app(recorder)
    async with app.run_test(size=SMALL) as pilot:
        await _settle(pilot)
        await pilot.press("3")  # its bumps are done: home shows those with weights
        assert "Added" in _line(app, 3)
        assert "[5 Added]" in _line(app, 1)
        await pilot.press("4")
        assert "[4 Masses]" in _line(app, 1)
        await pilot.press("s")
        assert "[" not in _line(app, 1)


async def test_a_small_terminal_shows_what_to_do_after_a_reject(make_app: MakeApp) -> None:
    recorder = _bench()
    app = make_app(recorder)
    async with app.run_test(size=SMALL) as pilot:
        await _settle(pilot)
        await pilot.press("space")
        recorder.bump()
        recorder.judge(LONG)
        await _settle(pilot)
        said = screen_text(app)
        assert "DOUBLE BUMP: second bump at +0.85 s" in said
        assert "Bump once, then keep off the car until the run has ended." in said
        assert "SPACE = again" in said


async def test_the_key_of_a_lost_recorder_is_told_apart_from_typing(make_app: MakeApp) -> None:
    recorder = FakeRecorder()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.press("tab")
        recorder.post(Lost("the recorder has ended", "all up to then is on the disk"))
        await pilot.pause()
        assert "RECORDER LOST: Esc, then X = start it again" in screen_text(app).splitlines()[0]
        await pilot.press("escape")
        await pilot.pause()
        assert "RECORDER LOST: X = start it again" in screen_text(app).splitlines()[0]
        await pilot.press("x")
        await app.workers.wait_for_complete()
        assert recorder.restarts == 1


@pytest.mark.parametrize("in_control", [True, False])
async def test_home_gives_way_to_a_run_that_somebody_else_has_armed(
    make_app: MakeApp, in_control: bool
) -> None:
    recorder = FakeRecorder(in_control=in_control)
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert isinstance(app.screen, HomeScreen)
        recorder.turn(Phase.ARMED)
        await until(pilot, lambda: isinstance(app.screen, RunScreen))
        assert "ARMED" in screen_text(app)


async def test_who_goes_back_to_the_check_during_a_pause_stays_there(make_app: MakeApp) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        recorder.turn(Phase.ARMED)
        await until(pilot, lambda: isinstance(app.screen, RunScreen))
        await pilot.press("escape")
        await until(pilot, lambda: app.status is not None and app.status.phase is Phase.PAUSED)
        await pilot.press("2")
        await pilot.pause()
        assert app.screen is app.get_screen("check")
        recorder.publish()
        await pilot.pause()
        assert app.screen is app.get_screen("check")


ASCII = choose_glyphs("ascii", {}, "ascii")
S = 1_000_000_000


def _status(code: str, phase: Phase = Phase.ARMED, alive: int = 4, age_s: float = 10.0) -> Status:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    recorder.phase = phase
    alarm = Alarm(code, "can0", "what was seen", EXPLAINED[code].advice, WALL_NS - int(age_s * S))
    recorder.changes = {"alarms": (alarm,), "sensors_alive": alive}
    return recorder.status


@pytest.mark.parametrize(
    ("code", "alive", "name", "advice"),
    [
        ("disconnected", 0, "BUS DISCONNECTED", "Check plug and power of the adapter."),
        ("bus_silent", 0, "BUS SILENT", "Check cable, power of the sensors and bit rate."),
        ("stale", 3, "SENSOR SILENT", "Check plug and power of this sensor."),
        ("bus_full", 4, "BUS OVERLOADED", "Take other devices off this bus"),
        ("counter_gap", 4, "FRAMES MISSING", "Check the load of the bus"),
        ("journal_failed", 4, "THE DISK REFUSES", "Make room on the disk"),
        ("not_recording", 4, "NOT RECORDING", "See the other alarms"),
    ],
)
@pytest.mark.parametrize("phase", [Phase.IDLE, Phase.WAITING, Phase.ARMED, Phase.PAUSED])
def test_the_first_line_is_the_cause_and_the_next_its_advice(
    code: str, alive: int, name: str, advice: str, phase: Phase
) -> None:
    status = _status(code, phase, alive)
    shown = banner(status, None, next_action(status), ASCII)
    assert (shown.word, shown.title) == ("STOP", f"{name}  can0")
    assert shown.first.startswith(advice)
    assert shown.second == "what was seen"
    page = headline(status)
    assert (page.word, page.why) == (("STOP",), f"{name}  can0")
    assert page.advice.startswith(advice)


def test_a_run_and_its_verdict_are_shown_before() -> None:
    for phase in (Phase.TRIGGERED, Phase.DECAY):
        assert obstacle(_status("stale", phase, alive=3)) is None
    for phase in (Phase.ACCEPTED, Phase.REJECTED):
        assert first_obstacle(_status("stale", phase, alive=3)) is None
        assert obstacle(_status("stale", phase, alive=3)) is not None
    assert first_obstacle(_status("disconnected", Phase.ACCEPTED, alive=0)) is not None


def test_without_frames_no_countdown_is_shown() -> None:
    recorder = FakeRecorder()
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    status = recorder.status
    assert "in 3 s" in banner(status, None, next_action(status), ASCII).title
    recorder.changes = {"sensors_alive": 0}
    still = banner(recorder.status, None, next_action(recorder.status), ASCII)
    assert (still.digits, "in 3 s" in still.title) == ("", False)
    assert headline(recorder.status).digits == ""


async def test_the_advice_of_the_gravest_alarm_is_never_cut(make_app: MakeApp) -> None:
    status = _status("bus_full")
    long = Alarm("bus_full", "can0 at the front", "frames " * 14, EXPLAINED["bus_full"].advice, 0)
    recorder = FakeRecorder()
    recorder.changes = {"alarms": (long, *status.alarms)}
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        text = " ".join(screen_text(app).replace("│", " ").split())
        assert "STOP BUS OVERLOADED can0 at the front" in text
        assert text.count("or raise the bit rate") == 2  # in the next action, and below
        assert "and 1 more" in text


async def test_a_lost_recorder_is_the_only_cause_and_x_the_only_order(make_app: MakeApp) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    recorder.changes = {"alarms": _status("stale").alarms, "sensors_alive": 3}
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert "STALE" in screen_text(app)
        app.push_screen(HelpScreen("run"))
        await pilot.pause()
        recorder.post(Lost("the recorder has ended", "all up to then is on the disk"))
        await pilot.pause()
        assert not isinstance(app.screen, HelpScreen)
        lines = screen_text(app).splitlines()
        assert lines[0].startswith(" RECORDER LOST: X = start it again")
        assert "STALE" not in "\n".join(lines)
        assert "X Start recorder" in lines[-1]
        assert not any(word in lines[-1] for word in ("Bksp", "Undo", "SPACE", "Esc"))


async def test_the_bell_rings_in_the_rhythm_of_the_event_unless_it_is_muted(
    make_app: MakeApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len({signal.value for signal in Signal}) == len(Signal)
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    rung: list[float] = []
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        monkeypatch.setattr(app, "bell", lambda: rung.append(0.0))
        monkeypatch.setattr(app, "set_timer", lambda at_s, _: rung.append(at_s))
        recorder.turn(Phase.ARMED)
        await pilot.pause()
        recorder.bump()
        recorder.judge(DOUBLE_BUMP)
        await pilot.pause()
        recorder.post(Lost("the recorder has ended", "restart"))
        recorder.post(Lost("the recorder has ended", "restart"))
        await pilot.pause()
        assert rung == [*Signal.ARMED.value, *Signal.REJECTED.value, *Signal.LOST.value]
        recorder.publish()
        app.action_sound()
        await pilot.pause()
        assert "muted" in screen_text(app)
        recorder.post(Lost("the recorder has ended", "restart"))
        await pilot.pause()
        assert len(rung) == 10


async def test_a_lost_recorder_has_its_key_on_every_screen(make_app: MakeApp) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        names = ("home", "run", "check", "sessions", "results", "report", "identify", "masses")
        for number, name in enumerate(names, 1):
            await app.open(name)
            recorder.post(Lost("the recorder has ended", "restart"))
            await pilot.pause()
            rows = screen_text(app).splitlines()
            assert rows[0].startswith(" RECORDER LOST: X = start it again"), name
            await until(pilot, lambda: "X Start recorder" in screen_text(app).splitlines()[-1])
            await pilot.press("x")
            await pilot.pause()
            assert recorder.restarts == number, name
            recorder.post(STARTING)
            await pilot.pause()
            rows = screen_text(app).splitlines()
            assert rows[0].startswith(" STARTING"), name
            await until(pilot, lambda: "X Start recorder" not in screen_text(app))
            recorder.publish()
            await pilot.pause()
        await app.go_to(BenchStep.BASELINE)
        assert "STARTING" not in screen_text(app)
