"""The terminal as a whole: sizes at which screens change, and what it asks of its recorder."""

from __future__ import annotations

import pytest
from textual.widgets import Static

from tui.terminal.screens.help import HelpScreen
from tui.terminal.state.feed import Lost, Role

from .fake_recorder import FakeRecorder
from .operated import Make
from .test_step_keys import pressed, seen

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
        assert "big letters on the run screen: on" in await pressed(pilot, "g")
        assert "big letters on the run screen: off" in await pressed(pilot, "g")
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
