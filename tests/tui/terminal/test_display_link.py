"""The terminal shows how to open the display that was started with it."""

from __future__ import annotations

from collections.abc import Callable

from tui.display.link import Served
from tui.terminal.app import BenchApp
from tui.terminal.palette import commands
from tui.terminal.screens.dialogs import DisplayLinkScreen
from tui.terminal.state.words import DisplayLink

from .conftest import screen_text
from .fake_recorder import FakeRecorder

LINK = "http://192.0.2.7:8010/Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmF/"


async def test_the_terminal_shows_link_and_code(make_app: Callable[..., BenchApp]) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    code = Served(LINK, "192.0.2.7", "").code
    words = (f"display: open {LINK}", "warning: ...", "control: type 1")
    app.display_link = lambda: DisplayLinkScreen(DisplayLink(words, code))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.pause()
        shown = screen_text(app)
        assert all(line.strip() in shown for line in code), "the whole code fits"
        assert "control: type 1" in shown
        await pilot.press("escape")
        await pilot.pause()
        assert "control: type" not in screen_text(app)
        assert "display: link" in [name for name, _, _ in commands(app)]
        app.display_link = None
        assert "display: link" not in [name for name, _, _ in commands(app)]
