"""Help, notes, messages and the command palette; what a key of the run loop says."""

from __future__ import annotations

from collections.abc import Awaitable
from functools import partial

from daq.alarms import EXPLAINED
from daq.control.messages import (
    Arm,
    AskCheck,
    Build,
    Note,
    Pause,
    Phase,
    Redo,
    ShutDown,
    Stop,
    Undo,
)
from daq.verdict import WORDS
from tui.terminal.screens.base import BenchScreen
from tui.terminal.widgets import SCREEN_PAGES, HelpScreen, page_of

from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .operated import (
    FakeWorker,
    Make,
    Snapshot,
    at_every_size,
    commands,
    measured,
    orders_of,
    playing,
    pressed,
    seen,
    shows,
    until,
)

SMALL = (80, 24)


def test_there_is_help_for_every_screen_reason_and_alarm(make_app: Make) -> None:
    for name in (*SCREEN_PAGES, *WORDS, *EXPLAINED):
        page = page_of(name)
        assert page.startswith("# "), name
        assert len(page) > 80, name
        assert "no page for this" not in page, name
        for table in (WORDS, EXPLAINED):
            if name in table:
                assert table[name].advice.rstrip(".")[1:] in page
    assert "bumped twice" in page_of("double_bump")
    both = page_of("stale")
    assert both.index("# Rejected") < both.index("# Alarm")
    assert "There is no page for this" in page_of("nonsense")
    app = make_app(FakeRecorder())
    for name in app.SCREENS:
        screen = app.get_screen(name)
        assert isinstance(screen, BenchScreen)
        assert screen.HELP_PAGE in SCREEN_PAGES


async def test_help_shows_the_keys_of_the_screen(make_app: Make, snapshot: Snapshot) -> None:
    app = make_app(measured())
    async with playing(app, (100, 30)) as pilot:
        await pressed(pilot, "f1")
        assert isinstance(app.screen, HelpScreen)
        await at_every_size(pilot, snapshot, "help_identify")
        await pressed(pilot, "f1")
        assert not isinstance(app.screen, HelpScreen)


async def test_a_note_outlives_the_dialog_and_a_refusal(make_app: Make) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with playing(app, SMALL) as pilot:
        await pressed(pilot, "n", *"wet [b] 7", "escape")
        assert "wet [b] 7" in await pressed(pilot, "n")
        recorder.refuse = "JL is in control"
        await pressed(pilot, "enter")
        recorder.refuse = ""
        assert "wet [b] 7" in await pressed(pilot, "n"), "it was refused"
        await pilot.press("enter")
        await until(pilot, lambda: shows(app, "the note is in the recording"))
        assert orders_of(recorder, Note) == [Note("wet [b] 7")] * 2
        assert "wet" not in await pressed(pilot, "n")
        await pressed(pilot, *"  ", "enter", "escape")
        commands(app)["note: on the last run"]()
        await pressed(pilot, *"door", "enter")
        assert orders_of(recorder, Note)[2:] == [Note("door", "added_roll_2")]


async def test_a_message_covers_neither_the_top_lines_nor_the_keys(make_app: Make) -> None:
    app = make_app(measured())
    async with playing(app, SMALL) as pilot:
        rows = screen_text(app).splitlines()
        for text in ("No space left on device", "the note is in the recording"):
            app.warn(text)
            await until(pilot, partial(shows, app, text))
            shown = screen_text(app).splitlines()
            assert text in "\n".join(shown[-4:])
            assert (shown[:10], shown[-1]) == (rows[:10], rows[-1])
            assert "\u2518" in "".join(shown[-4:-1]), "the lower edge of the box is seen"


async def test_the_commands_of_the_palette_act(make_app: Make, worker: FakeWorker) -> None:
    recorder = measured()
    app = make_app(recorder)

    async def do(name: str) -> None:
        made = commands(app)[name]()
        if isinstance(made, Awaitable):
            await made

    async with playing(app, SMALL) as pilot:
        assert all(": " in name for name in commands(app))
        await do("recorder: stop")
        assert isinstance(recorder.orders[-1], Stop)
        await do("theme: bench-light")
        assert app.theme == "bench-light"
        await app.action_sessions()
        await pilot.pause()
        assert app.screen is app.get_screen("sessions")
        await pilot.press("ctrl+p", *"shut")
        await pilot.pause(0.3)
        assert "recorder: shut down" in screen_text(app)
        await pilot.press("escape")
        await do("recorder: shut down")
        assert isinstance(recorder.orders[-1], ShutDown)
        assert app._exit


async def test_the_run_loop_says_what_a_key_has_done(make_app: Make) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with playing(app, (140, 40)) as pilot:
        await pressed(pilot, "space")
        recorder.bump()
        await pilot.pause()
        assert "pauses after this run" in await pressed(pilot, "escape")
        assert orders_of(recorder, Pause) == [Pause()]
        recorder.turn(Phase.TRIGGERED)
        recorder.judge()
        await pilot.pause()
        assert "undone; R = redo" in await pressed(pilot, "u")
        assert orders_of(recorder, Undo) == [Undo()]
        assert "redone; U = undo" in await pressed(pilot, "r")
        assert orders_of(recorder, Redo) == [Redo()]
        recorder.turn(Phase.PAUSED)
        await pilot.pause()
        assert "next: baseline pitch" in await pressed(pilot, "down", "m")


async def test_a_refused_order_says_why_and_a_viewer_gives_none(make_app: Make) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with playing(app, SMALL) as pilot:
        recorder.refuse = "the disk is full"
        assert "the disk is full" in await pressed(pilot, "space")
        app.in_control = False
        assert await app.ask(Arm()) is None
        await pilot.pause()
        assert "C asks for control" in seen(app)
        assert await app.ask(Build()) is None
        assert orders_of(recorder, Build) == []
        recorder.refuse = ""
        assert await app.ask(AskCheck(1.0)) is not None, "who looks on may ask"
