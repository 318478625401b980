"""Messages to the operator have a row of their own: they cover nothing, over a dialog either."""

from __future__ import annotations

from collections.abc import Callable

from tui.terminal.app import BenchApp
from tui.terminal.screens.dialogs import NoteScreen

from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .operated import shows, until

Make = Callable[..., BenchApp]


def _bench() -> FakeRecorder:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    return recorder


async def test_a_message_covers_nothing_of_a_dialog(make_app: Make) -> None:
    """A dialog over the whole height makes room for the row of the message."""
    app = make_app(_bench())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.press("f1")
        await pilot.pause()
        app.warn("draft draft_note.json cannot be written: No space left on device")
        await until(pilot, lambda: shows(app, "No space left on device"))
        await until(pilot, lambda: shows(app, "Esc closes"))
        rows = screen_text(app).splitlines()
        assert "No space left on device" in rows[-1]
        assert any("└" in row and "Esc closes" in row for row in rows[-4:-1])


async def test_a_stored_note_is_confirmed_on_the_screen_below(make_app: Make) -> None:
    app = make_app(_bench())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pilot.press("n")
        await until(pilot, lambda: isinstance(app.screen, NoteScreen))
        await pilot.press(*"wind", "ctrl+s")
        await until(pilot, lambda: shows(app, "the note is in the recording"))
        assert not isinstance(app.screen, NoteScreen)
