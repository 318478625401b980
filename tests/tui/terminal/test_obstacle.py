"""Faults for which a bump would be lost: cause and advice come first, on terminal and display."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from daq.alarms import EXPLAINED
from daq.control.messages import Alarm, Phase, Status
from tui.display.view import headline
from tui.terminal.app import BenchApp
from tui.terminal.screens.help import HelpScreen
from tui.terminal.state.campaign import first_obstacle, next_action, obstacle
from tui.terminal.state.feed import Lost
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.state.words import banner

from .conftest import screen_text
from .fake_recorder import DOUBLE_BUMP, WALL_NS, FakeRecorder

MakeApp = Callable[..., BenchApp]
ASCII = choose_glyphs(GlyphSet.ASCII, {}, "ascii")
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
        app.show_help("run")
        await pilot.pause()
        recorder.post(Lost("the recorder has ended", "all up to then is on the disk"))
        await pilot.pause()
        assert not isinstance(app.screen, HelpScreen)
        lines = screen_text(app).splitlines()
        assert lines[0].startswith(" RECORDER LOST: X = start it again")
        assert "STALE" not in "\n".join(lines)
        assert "X Start recorder" in lines[-1]
        assert not any(word in lines[-1] for word in ("Bksp", "Undo", "SPACE", "Esc"))
