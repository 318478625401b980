"""The bell, the big letters, and that both choices are remembered."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from daq.control.messages import Alarm, Phase
from tui.terminal.app import BenchApp
from tui.terminal.screens.bumping import RunScreen
from tui.terminal.state.campaign import BenchStep
from tui.terminal.state.feed import STARTING, Lost
from tui.terminal.state.signals import Signal, Signals, choices_path, signal_of
from tui.terminal.widgets.banner import big_word

from .conftest import screen_text
from .fake_recorder import DOUBLE_BUMP, FakeRecorder

MakeApp = Callable[..., BenchApp]
STATES = (
    "WAITING", "ARMED", "TRIGGERED", "DECAY", "ACCEPTED", "REJECTED", "PAUSED", "COMPLETE",
    "STOPPED", "DONE", "IDLE", "CONNECTING", "STARTING", "RECORDER LOST",
)  # fmt: skip


def _alarm(code: str) -> Alarm:
    return Alarm(code, "can0", "text", "advice", 0)


@pytest.mark.parametrize(
    ("phase", "after", "alarms", "signal"),
    [
        (Phase.WAITING, Phase.ARMED, (), Signal.ARMED),
        (Phase.DECAY, Phase.ACCEPTED, (), Signal.ACCEPTED),
        (Phase.DECAY, Phase.REJECTED, (), Signal.REJECTED),
        (Phase.ARMED, Phase.TRIGGERED, (), None),
        (Phase.ARMED, Phase.ARMED, (), None),
        (Phase.ARMED, Phase.ARMED, ("stale",), Signal.ALARM),
        (Phase.WAITING, Phase.ARMED, ("stale",), Signal.ALARM),
        (Phase.DECAY, Phase.REJECTED, ("bus_silent",), Signal.REJECTED),
        (Phase.ARMED, Phase.ARMED, ("clock_step",), None),
    ],
)
def test_what_is_signalled(
    phase: Phase, after: Phase, alarms: tuple[str, ...], signal: Signal | None
) -> None:
    before = replace(FakeRecorder().status, phase=phase, alarms=(_alarm("counter_gap"),))
    raised = (*before.alarms, *map(_alarm, alarms))
    assert signal_of(before, replace(before, phase=after, alarms=raised)) is signal


def test_every_signal_has_a_rhythm_of_its_own() -> None:
    rhythms = [signal.value for signal in Signal]
    assert len(set(rhythms)) == len(rhythms) == 5
    later: list[float] = []
    rung: list[int] = []
    signals = Signals(None, lambda: rung.append(1), lambda at_s, _: later.append(at_s))
    for signal, after in (
        (Signal.ARMED, []),
        (Signal.ACCEPTED, [0.2]),
        (Signal.ALARM, [0.2, 0.8, 1.0]),
        (Signal.LOST, [0.2, 0.4, 1.0, 1.2, 1.4]),
        (Signal.REJECTED, [0.2, 0.4]),
    ):
        rung.clear()
        later.clear()
        signals.play(signal)
        assert (rung, later) == ([1], after), signal
    signals.toggle_sound()
    signals.play(Signal.LOST)
    assert (rung, later) == ([1], [0.2, 0.4])


def test_the_choices_are_remembered(tmp_path: Path) -> None:
    path = choices_path({"XDG_CONFIG_HOME": str(tmp_path)}, Path("/nowhere"))
    assert path == tmp_path / "bumpbench" / "terminal.json"
    assert choices_path({}, tmp_path) == tmp_path / ".config" / "bumpbench" / "terminal.json"
    first = Signals(path, lambda: None, lambda *_: None)
    assert (first.sound, first.big) == (True, False)
    assert first.toggle_sound() == first.toggle_big() == ""
    assert json.loads(path.read_text()) == {"sound": False, "big": True}
    second = Signals(path, lambda: None, lambda *_: None)
    assert (second.sound, second.big) == (False, True)


def test_a_choice_that_cannot_be_kept_holds_and_says_why(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    signals = Signals(tmp_path / "file" / "terminal.json", lambda: None, lambda *_: None)
    assert "cannot be written" in signals.toggle_sound()
    assert not signals.sound


@pytest.mark.parametrize("word", STATES)
def test_every_state_fits_in_five_rows_of_eighty_columns(word: str) -> None:
    rows = big_word(word, 79, 8, "#")
    assert len(rows) == 5
    assert len({len(row) for row in rows}) == 1
    assert len(rows[0]) <= 79


def test_letters_grow_with_the_room_and_are_left_out_without() -> None:
    assert len(big_word("ARMED", 139, 13, "#")) == 10
    assert len(big_word("ARMED", 199, 16, "#")) == 15
    assert len(big_word("ARMED", 57, 13, "#")) == 5  # twice as wide it has 58 columns
    assert len(big_word("ARMED", 58, 13, "#")) == 10
    assert big_word("ARMED", 28, 8, "#") == []
    assert big_word("ARMED", 29, 8, "#") != []


async def test_bell_and_letters_at_the_terminal(
    make_app: MakeApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    played: list[Signal | None] = []
    async with app.run_test(size=(80, 24)) as pilot:
        monkeypatch.setattr(app.signals, "play", played.append)
        await pilot.pause()
        await pilot.press("space")
        recorder.turn(Phase.ARMED)
        await pilot.pause()
        assert isinstance(app.screen, RunScreen)
        assert "█████" not in screen_text(app)
        await pilot.press("g", "b")
        await pilot.pause()
        rows = screen_text(app).splitlines()
        assert [row.count("█") > 3 for row in rows[3:8]] == [True] * 5
        assert "muted" in rows[0]
        recorder.bump()
        recorder.judge(DOUBLE_BUMP)
        await pilot.pause()
        recorder.post(Lost("the recorder has ended", "restart"))
        recorder.post(Lost("the recorder has ended", "restart"))
        await pilot.pause()
    assert [signal for signal in played if signal] == [
        Signal.ARMED,
        Signal.REJECTED,
        Signal.LOST,
    ]


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
            assert "X Start recorder" in rows[-1], name
            await pilot.press("x")
            await pilot.pause()
            assert recorder.restarts == number, name
            recorder.post(STARTING)
            await pilot.pause()
            rows = screen_text(app).splitlines()
            assert rows[0].startswith(" STARTING"), name
            assert "X Start recorder" not in rows[-1], name
            recorder.publish()
            await pilot.pause()
        await app.go_to(BenchStep.BASELINE)
        assert "STARTING" not in screen_text(app)


async def test_a_message_has_a_row_of_its_own_and_covers_nothing(make_app: MakeApp) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        before = screen_text(app).splitlines()
        app.warn("a refusal that is long enough for two rows " + "and goes on " * 5)
        await pilot.pause()
        rows = screen_text(app).splitlines()
        assert rows[-1] == before[-1]
        assert rows[-3].startswith(" a refusal that is long enough")
        assert rows[:9] == before[:9]  # the next action and what SPACE does
        assert all("a refusal" not in row for row in rows[:-3])
