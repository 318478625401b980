"""The app: sizes at which screens change, its start, and another recorder than the wanted one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from textual.widgets import Input, Static

from daq.alarms.texts import EXPLAINED
from daq.bench.campaign import Origin
from daq.bench.edit import with_channel
from daq.control.messages import Alarm, Arm, Hello, Phase, Setup, ShutDown, Stop, differences
from tui.display.link import Served
from tui.terminal.feed import STARTING, Lost, News, Role
from tui.terminal.screens.bumping import HomeScreen, alarms_text
from tui.terminal.widgets import HelpScreen
from tui.terminal.words import DisplayLink, Signal

from .conftest import screen_text
from .fake_recorder import DOUBLE_BUMP, FakeRecorder, ready
from .operated import PLAIN, Make, commands, playing, pressed, seen, until
from .test_words import alarmed

SIZES = (
    (80, 24, "-narrow"),
    (119, 35, "-narrow"),
    (120, 36, "-wide"),
    (179, 35, "-wide"),
    (180, 36, "-huge"),
)


async def test_screens_change_at_120_and_180_columns(make_app: Make) -> None:
    recorder = ready()
    app = make_app(recorder)
    async with playing(app, (100, 30)) as pilot:
        for columns, rows, wide in SIZES:
            await pilot.resize_terminal(columns, rows)
            await pilot.pause()
            found = {c for c in app.screen.classes if c in ("-narrow", "-wide", "-huge")}
            assert found == {wide}, columns
        for columns, rows, small in ((80, 24, False), (79, 24, True), (80, 23, True)):
            await pilot.resize_terminal(columns, rows)
            await pilot.pause()
            words = f"{columns}x{rows} is too small: make it 80x24, or the font smaller"
            assert (words in seen(app)) is small


async def test_keys_of_every_screen(make_app: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = ready()
    said: list[str | None] = []
    app = make_app(recorder)
    async with playing(app, (100, 30)) as pilot:
        await pressed(pilot, "c")
        assert recorder.takes_over == 0, "it has control"
        status = recorder.status
        for _ in range(1300):
            app.post(status)
        assert len(app._news) == 1200, "news of a minute, twenty a second"
        await pilot.pause()
        assert app.screen.query(Static)
        monkeypatch.setattr(app, "exit", lambda message: said.append(message))
        await pilot.press("ctrl+q")
        app.lost = Lost("the recorder has ended", "press X")
        await pilot.press("ctrl+q")
    goes_on, lost = said
    assert goes_on is not None
    assert "The same command brings you back" in goes_on
    assert "recorder: shut down" in goes_on
    assert lost is None, "no recorder goes on"


async def test_the_name_is_asked_for_once_if_nobody_has_said_it(
    make_app: Make,
) -> None:
    recorder = ready()
    app = make_app(recorder)
    app.operator = ""

    async with playing(app) as pilot:
        assert "Your name or initials" in screen_text(app)
        await pilot.press(*"Anna", "enter")
        await pilot.pause()
        assert app.operator == "Anna"
        assert Hello("Anna", control=True) in recorder.orders
        assert "op. Anna" in screen_text(app)


class SlowRecorder(FakeRecorder):
    """One that is connected, and publishes nothing before it is turned."""

    def start(self, post: Callable[[News], None]) -> None:
        super().start(lambda news: post(news) if isinstance(news, Role) else None)
        self._post = post


async def test_before_the_first_status_keys_act_on_what_is_there(make_app: Make) -> None:
    recorder = SlowRecorder()
    recorder.mark("vehicle")
    app = make_app(recorder)
    assert app.bench_text == ""
    async with playing(app) as pilot:
        rows = screen_text(app).splitlines()
        assert rows[0] == " BUMP  waiting for the recorder"
        assert "X " not in rows[-1]
        recorder.post(Lost("the recorder has ended", "all up to then is on the disk"))
        await pilot.pause()
        rows = screen_text(app).splitlines()
        assert rows[0].startswith(" RECORDER LOST: X = start it again")
        assert "X " in rows[-1]
        await pilot.press("n", *"we")
        recorder.publish()
        await pilot.press("t", "x")
        assert app.screen.query_one(Input).value == "wetx", "it stays where it was meant"
        await pilot.press("escape")
        recorder.publish()
        await pilot.pause()
        assert app.screen is app.get_screen("check"), "the step that is due"
        assert not [order for order in recorder.orders if isinstance(order, Arm)]


RUNNING = Setup(Origin.SIMULATED, 1)
MENU = "SPACE = attach to it as it is"


@pytest.mark.parametrize(("key", "attached"), [("space", True), ("escape", False)])
async def test_another_recorder_is_attached_to_or_left_as_the_operator_says(
    make_app: Make, key: str, attached: bool
) -> None:
    recorder = FakeRecorder()
    recorder.setup = RUNNING
    recorder.changes["origin"] = Origin.SIMULATED
    app = make_app(recorder, wanted=Setup(Origin.REAL))
    async with playing(app, (100, 30)) as pilot:
        asked = " ".join(screen_text(app).replace("│", " ").split())
        assert "it records a simulated car, not a real bus" in asked
        await pilot.press(key)
        await pilot.pause()
        assert app.is_running is attached
        if attached:
            recorder.publish()
            await pilot.pause()
            assert MENU not in screen_text(app)
            assert app.screen is app.get_screen("vehicle")
    assert not {Stop(), ShutDown()} & set(recorder.orders)


SAME = replace(RUNNING, origin=Origin.REAL)


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (Setup(Origin.REAL), ""),
        (SAME, ""),
        (replace(SAME, bench_crc32=3), "another bench.toml or DBC"),
        (Setup(Origin.REPLAYED), "a real bus, not a replayed recording"),
    ],
)
def test_what_differs_is_named_and_what_was_not_asked_for_is_not(wanted: Setup, words: str) -> None:
    assert words in " ".join(differences(SAME, wanted))
    assert bool(differences(SAME, wanted)) is bool(words)


LINK = "http://192.0.2.7:8010/Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmF/"


async def test_the_terminal_shows_link_and_code(make_app: Make) -> None:
    recorder = ready()
    app = make_app(recorder)
    code = Served(LINK, "192.0.2.7", "").code
    words = (f"display: open {LINK}", "warning: ...", "control: type 1")
    app.display_link = DisplayLink(words, code)
    async with playing(app) as pilot:
        shown = screen_text(app)
        assert all(line.strip() in shown for line in code), "the whole code fits"
        assert "control: type 1" in shown
        await pilot.press("escape")
        await pilot.pause()
        assert "control: type" not in screen_text(app)
        assert "display: link" in commands(app)
        app.display_link = None
        assert "display: link" not in commands(app)


async def test_the_step_bar_is_of_what_the_screen_shows(make_app: Make) -> None:
    recorder = ready()
    recorder.finish("baseline")
    recorder.mark("masses")
    app = make_app(recorder)
    async with playing(app) as pilot:
        await pilot.press("3")  # its bumps are done: home shows those with weights
        assert "next: added bounce 1 of 2" in screen_text(app).splitlines()[2]
        assert "[5 Added]" in screen_text(app).splitlines()[1]
        await pilot.press("4")
        assert "[4 Masses]" in screen_text(app).splitlines()[1]


@pytest.mark.parametrize("in_control", [True, False])
async def test_home_gives_way_to_a_run_that_somebody_else_has_armed(
    make_app: Make, in_control: bool
) -> None:
    recorder = ready(in_control)
    app = make_app(recorder)
    async with playing(app) as pilot:
        assert isinstance(app.screen, HomeScreen)
        recorder.turn(Phase.ARMED)
        await until(pilot, lambda: app.screen.has_class("-run"))
        assert "ARMED" in screen_text(app)
        if in_control:  # who goes back to the check during a pause stays there
            await pilot.press("escape")
            await until(pilot, lambda: app.status is not None and app.status.phase is Phase.PAUSED)
            await pilot.press("2")
            await pilot.pause()
            assert app.screen is app.get_screen("check")
            recorder.publish()
            await pilot.pause()
            assert app.screen is app.get_screen("check")


async def test_the_gravest_alarm_is_shown_unless_the_recorder_is_lost(
    make_app: Make,
) -> None:
    recorder = ready()
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    recorder.phase = Phase.IDLE
    long = Alarm("bus_full", "can0 at the front", "frames " * 14, EXPLAINED["bus_full"].advice, 0)
    recorder.changes = {"alarms": (long, *alarmed("stale").alarms), "sensors_alive": 3}
    app = make_app(recorder)
    async with playing(app) as pilot:
        shown = " ".join(screen_text(app).replace("│", " ").split())
        assert "STOP BUS OVERLOADED can0 at the front" in shown
        assert shown.count("or raise the bit rate") == 2, "the advice of the gravest is never cut"
        assert "and 1 more" in shown
        narrow = alarms_text(app.status or recorder.status, PLAIN, 40).plain.splitlines()
        assert narrow[0].startswith("! BUS FULL can0 at the front: frames")
        assert narrow[2:] == ["  frames frames frames frames frames ...", "! and 1 more"]
        assert alarms_text(recorder.status, PLAIN, 9).plain.count("FULL") == 1
        await app.configure(lambda text: with_channel(text, "travel_fl", sign=-1))
        await app.configure(lambda text: with_channel(text, "travel_fr", sign=-1))
        turned = [c.name for c in recorder.bench.channels if c.sign < 0]
        assert turned == ["travel_fl", "travel_fr"], "an edit begins with the one before"
        app.push_screen(HelpScreen("home"))
        await pilot.pause()
        recorder.post(Lost("the recorder has ended", "all up to then is on the disk"))
        await pilot.pause()
        assert not isinstance(app.screen, HelpScreen)
        lines = screen_text(app).splitlines()
        assert lines[0].startswith(" RECORDER LOST: X = start it again")
        assert "OVERLOADED" not in "\n".join(lines)
        assert "X Start recorder" in lines[-1]
        assert not any(word in lines[-1] for word in ("Bksp", "Undo", "SPACE", "Esc"))


async def test_the_bell_rings_in_the_rhythm_of_the_event(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len({signal.value for signal in Signal}) == len(Signal)
    recorder = ready()
    app = make_app(recorder)
    rung: list[float] = []
    async with playing(app) as pilot:
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


async def test_a_lost_recorder_has_its_key_on_every_screen(make_app: Make) -> None:
    recorder = ready()
    app = make_app(recorder)
    async with playing(app) as pilot:
        for number, name in enumerate(("vehicle", "results"), start=1):
            await app.open(name)
            if name == "vehicle":
                await pilot.press("tab", "x", "escape")  # in a field it is a letter
            recorder.post(Lost("the recorder has ended", "restart"))
            await pilot.pause()
            assert screen_text(app).startswith(" RECORDER LOST: X = start it again (in a field Esc")
            await until(pilot, lambda: "X Start recorder" in screen_text(app).splitlines()[-1])
            assert recorder.restarts == number - 1
            await pilot.press("x")
            await app.workers.wait_for_complete()
            assert recorder.restarts == number
            recorder.post(STARTING)
            await pilot.pause()
            assert screen_text(app).startswith(" STARTING")
            await until(pilot, lambda: "X Start recorder" not in screen_text(app))
