"""The app: sizes at which screens change, its start, and another recorder than the wanted one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest
from textual.widgets import Input, Static

from daq.bench.campaign import Origin
from daq.control import address
from daq.control.messages import Arm, Hello, Setup, ShutDown, Stop
from daq.errors import InputError
from tui.cli import run
from tui.commands.tui import check_fault
from tui.diagnostics import ExitCode
from tui.display.link import Served
from tui.terminal.app import BenchApp
from tui.terminal.feed import Lost, News, Role
from tui.terminal.form import Form
from tui.terminal.widgets import HelpScreen
from tui.terminal.words import DisplayLink, choose_glyphs

from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .operated import Make, commands, pressed, seen

SIZES = (
    (80, 24, "-narrow", "-low"),
    (119, 35, "-narrow", "-low"),
    (120, 36, "-wide", "-tall"),
    (179, 35, "-wide", "-low"),
    (180, 36, "-huge", "-tall"),
)


async def test_screens_change_at_120_and_180_columns_and_at_36_rows(make_app: Make) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        for columns, rows, wide, tall in SIZES:
            await pilot.resize_terminal(columns, rows)
            await pilot.pause()
            found = {c for c in app.screen.classes if c in ("-narrow", "-wide", "-huge")}
            assert found == {wide}, columns
            assert {c for c in app.screen.classes if c in ("-low", "-tall")} == {tall}, rows
        for columns, rows, small in ((80, 24, False), (79, 24, True), (80, 23, True)):
            await pilot.resize_terminal(columns, rows)
            await pilot.pause()
            words = f"{columns}x{rows} is too small: make it 80x24, or the font smaller"
            assert (words in seen(app)) is small


async def test_keys_of_every_screen(make_app: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    taken: list[int] = []
    said: list[str | None] = []
    monkeypatch.setattr(recorder, "take_over", lambda: taken.append(1))
    app = make_app(recorder)
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        await pressed(pilot, "c")
        assert taken == [], "it has control"
        recorder.post(Role(False, "JL is in control"))
        recorder.publish()
        await pilot.pause()
        await pressed(pilot, "c")
        assert taken == [1]
        assert "muted" in await pressed(pilot, "b")
        assert "muted" not in (await pressed(pilot, "b")).partition("[")[0]
        await pressed(pilot, "f1")
        assert isinstance(app.screen, HelpScreen)
        await pressed(pilot, "f1")
        assert not isinstance(app.screen, HelpScreen)
        assert "Ctrl+Q closes the terminal" in await pressed(pilot, "ctrl+c")
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


def test_without_a_terminal_nothing_is_started(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["tui", "--demo", "--out", str(tmp_path / "demo")]) == ExitCode.BAD_INPUT
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "is not a terminal" in said
    assert not (tmp_path / "demo").exists()


@pytest.mark.parametrize(("fault", "runs", "refused"), [
    ("unplug", True, True), ("unplug", False, False), (None, True, False),
])  # fmt: skip
def test_a_fault_needs_a_recorder_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str | None, runs: bool, refused: bool
) -> None:
    monkeypatch.setattr(address, "is_running", lambda _: runs)
    with pytest.raises(InputError, match="already") if refused else nullcontext():
        check_fault(tmp_path, fault)


async def test_the_name_is_asked_for_once_if_nobody_has_said_it(
    make_app: Callable[..., BenchApp],
) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    app.operator = ""

    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.pause()
        assert "Your name or initials" in screen_text(app)
        await pilot.press(*"Anna", "enter")
        await pilot.pause()
        assert app.operator == "Anna"
        assert Hello("Anna", control=True) in recorder.orders
        assert "op. Anna" in screen_text(app)


async def test_the_form_proposes_the_name_of_the_login(
    make_app: Callable[..., BenchApp], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("USER", "anna")
    app = make_app(FakeRecorder())
    app.operator = ""

    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.pause()
        assert app.screen.query_one(Form).values["operator"] == "anna"


class SlowRecorder(FakeRecorder):
    """One that is connected, and publishes nothing before it is turned."""

    def start(self, post: Callable[[News], None]) -> None:
        super().start(lambda news: post(news) if isinstance(news, Role) else None)
        self._post = post


async def test_what_is_typed_before_the_first_status_stays_where_it_was_meant(
    make_app: Callable[[FakeRecorder], BenchApp],
) -> None:
    recorder = SlowRecorder()
    recorder.mark("vehicle")
    app = make_app(recorder)
    async with app.run_test() as pilot:
        await pilot.press("n", *"we")
        recorder.publish()
        await pilot.press("t", "x")
        assert app.screen.query_one(Input).value == "wetx"
        await pilot.press("escape")
        recorder.publish()
        await pilot.pause()
        assert app.screen is app.get_screen("check"), "the step that is due"
        assert not [order for order in recorder.orders if isinstance(order, Arm)]


class Starting(FakeRecorder):
    """A recorder that has not sent a status yet."""

    def start(self, post: Callable[[News], None]) -> None:
        """Say who is in control, and no more."""
        self._post = post
        post(Role(True))


async def test_before_the_first_status_a_lost_recorder_has_its_key(
    make_app: Callable[..., BenchApp],
) -> None:
    recorder = Starting()
    app = make_app(recorder)
    assert app.bench_text == ""
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        rows = screen_text(app).splitlines()
        assert rows[0] == " BUMP  waiting for the recorder"
        await app.open("sessions")
        await pilot.pause()
        rows = screen_text(app).splitlines()
        assert rows[0] == " BUMP  waiting for the recorder"
        assert "X " not in rows[-1]
        recorder.post(Lost("the recorder has ended", "all up to then is on the disk"))
        await pilot.pause()
        rows = screen_text(app).splitlines()
        assert rows[0].startswith(" RECORDER LOST: X = start it again")
        assert "X " in rows[-1]


RUNNING = Setup(Origin.SIMULATED, "Granada", 1, 2, ("virtual demo",))
MENU = "attach to it: it goes on as it is"


def _app(recorder: FakeRecorder, folder: Path, wanted: Setup | None) -> BenchApp:
    glyphs = choose_glyphs("braille", {}, "utf-8")
    return BenchApp(recorder, folder, glyphs, "MK", wanted=wanted)


async def _answered(recorder: FakeRecorder, folder: Path, *keys: str) -> tuple[BenchApp, str, str]:
    """Return the app, what it asks, and what it shows after the keys."""
    app = _app(recorder, folder, Setup(Origin.REAL))
    shown: list[str] = []

    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        shown.append(screen_text(app))
        await pilot.press(*keys)
        await pilot.pause()
        if app.is_running and app.screen_stack:
            recorder.publish()
            await pilot.pause()
            shown.append(screen_text(app))
    return app, shown[0], shown[-1]


def _recorder() -> FakeRecorder:
    recorder = FakeRecorder()
    recorder.setup = RUNNING
    recorder.changes["origin"] = Origin.SIMULATED
    return recorder


async def test_it_is_attached_to_when_the_operator_says_so(tmp_path: Path) -> None:
    recorder = _recorder()
    app, asked, then = await _answered(recorder, tmp_path, "enter")
    assert "it records a simulated car, not a real bus" in " ".join(asked.replace("│", " ").split())
    assert MENU in asked
    assert MENU not in then
    assert "SIMULATED" in then.splitlines()[0]
    assert app.return_code in (None, 0)
    assert not {Stop(), ShutDown()} & set(recorder.orders)


async def test_a_new_recording_ends_the_old_one_first(tmp_path: Path) -> None:
    recorder = _recorder()
    _, _, then = await _answered(recorder, tmp_path, "down", "enter")
    assert [o for o in recorder.orders if isinstance(o, Stop | ShutDown)] == [Stop(), ShutDown()]
    assert recorder.restarts == 1
    assert MENU not in then


@pytest.mark.parametrize(
    ("keys", "ended"), [(("down", "down", "enter"), True), (("escape",), False)]
)
async def test_the_terminal_ends_with_the_recorder_or_leaves_it(
    tmp_path: Path, keys: tuple[str, ...], ended: bool
) -> None:
    recorder = _recorder()
    app, *_ = await _answered(recorder, tmp_path, *keys)
    assert not app.is_running
    assert (ShutDown() in recorder.orders) is ended
    assert recorder.restarts == 0


SAME = replace(RUNNING, origin=Origin.REAL)


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (None, ""),
        (Setup(Origin.REAL), ""),
        (SAME, ""),
        (replace(SAME, bench_crc32=3), "another bench.toml (vehicle Granada)"),
        (replace(SAME, dbc_crc32=3), "another DBC"),
        (replace(SAME, buses=("socketcan can0",)), "it records virtual demo, not socketcan can0"),
        (Setup(Origin.REPLAYED), "a real bus, not a replayed recording"),
    ],
)
async def test_what_differs_is_named_and_what_was_not_asked_for_is_not(
    tmp_path: Path, wanted: Setup | None, words: str
) -> None:
    recorder = FakeRecorder()
    recorder.setup = SAME
    app = _app(recorder, tmp_path, wanted)

    async with app.run_test(size=(120, 30)) as pilot:
        await pilot.pause()
        shown = " ".join(screen_text(app).replace("│", " ").split())
        assert (MENU in shown) is bool(words)
        assert words in shown


@pytest.mark.parametrize(("width", "origin"), [(80, Origin.SIMULATED), (140, Origin.REPLAYED)])
async def test_no_screen_hides_that_nothing_is_measured(
    make_app: Callable[..., BenchApp], width: int, origin: Origin
) -> None:
    recorder = FakeRecorder()
    recorder.changes["origin"] = origin
    app = make_app(recorder)

    async with app.run_test(size=(width, 30)) as pilot:
        await pilot.pause()
        for name in app.SCREENS:
            await app.open(name)
            await pilot.pause()
            recorder.publish()
            await pilot.pause()
            assert f" {origin.upper()} " in screen_text(app).splitlines()[0], name


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--demo", "--replay", "x.h5"], "cannot be combined"),
        (["--demo", "--fault", "nonsense"], "is not a fault"),
        (["--fault", "unplug"], "works on simulated runs only"),
        (["BENCH"], "bench.toml"),
        (["--demo", "BENCH"], "bench.toml"),
        (["--web", "BENCH"], "bench.toml"),
        (["--interface", "virtual", "--channel", "x"], "does not reach other processes"),
    ],
)
def test_a_bad_bench_or_option_starts_no_recorder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    bad = tmp_path / "bench.toml"
    bad.write_text("[vehicle]\nwheels = 5\n")
    given = [str(bad) if option == "BENCH" else option for option in options]
    code = run(["tui", *given, "--out", str(tmp_path / "out")])
    assert code == ExitCode.BAD_INPUT
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


LINK = "http://192.0.2.7:8010/Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmF/"


async def test_the_terminal_shows_link_and_code(make_app: Callable[..., BenchApp]) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    code = Served(LINK, "192.0.2.7", "").code
    words = (f"display: open {LINK}", "warning: ...", "control: type 1")
    app.display_link = DisplayLink(words, code)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.pause()
        shown = screen_text(app)
        assert all(line.strip() in shown for line in code), "the whole code fits"
        assert "control: type 1" in shown
        await pilot.press("escape")
        await pilot.pause()
        assert "control: type" not in screen_text(app)
        assert "display: link" in commands(app)
        app.display_link = None
        assert "display: link" not in commands(app)
