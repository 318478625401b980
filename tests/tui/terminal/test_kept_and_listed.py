"""Texts that are kept or removed, results that are kept, and what a list shows of a session."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from textual.widgets import TextArea

from tui.jobs.lines import IdentifyTask, Task
from tui.terminal.screens import work
from tui.terminal.screens.sessions import SessionsScreen
from tui.terminal.state.signals import Signals
from tui.terminal.widgets.table import Table

from .conftest import screen_text
from .operated import Make, until
from .test_identify_screen import tasks as identified
from .test_results import measured, results_of
from .test_screen_keys import tasks as tasks
from .test_step_keys import front, pressed, seen

identifications = identified


async def test_a_note_is_kept_until_it_is_emptied(make_app: Make) -> None:
    app = make_app(measured())
    draft = app.folder / "draft_note.json"
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await pressed(pilot, "n", *"wet", "escape")
        assert json.loads(draft.read_text()) == {"text": "wet"}
        await pressed(pilot, "n")
        area = app.screen.query_one(TextArea)
        assert area.text == "wet"
        assert area.cursor_location == (0, 3), "one goes on behind it"
        await pressed(pilot, "backspace", "backspace", "backspace", "escape")
        assert not draft.exists()
        await pressed(pilot, "n", "escape")
        assert not draft.exists()


async def test_a_list_follows_the_recording_and_shows_how_to_replay(
    make_app: Make, tasks: list[Task]
) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        await app.action_sessions()
        await until(pilot, lambda: "10:42" in screen_text(app))
        screen = app.screen
        assert isinstance(screen, SessionsScreen)

        def state_of(time: str) -> str:
            (line,) = (line for line in screen_text(app).splitlines() if time in line)
            return " ".join(line.strip(" >").split()[3:6])

        assert state_of("10:42").endswith("! cut off")
        assert "/b/journal" in seen(app)
        recorder.publish(recording="r9")
        await pilot.pause()
        await pilot.pause()
        assert "● open" in state_of("10:42")
        await pressed(pilot, "end")
        assert screen.query_one(Table).cursor_row == 4
        assert "/b/s2.h5" in seen(app)
        said = await pressed(pilot, "v")
        assert "In a second terminal:" in said
        assert "bumpbench tui --replay '/b/s2.h5'" in said
        assert "Esc closes" in said
        await pressed(pilot, "space")
        assert front(app) is screen
        read = len(tasks)
        await pressed(pilot, "escape", "s")
        assert front(app) is screen
        assert len(tasks) == read + 1, "after another screen the folder is read again"
        assert screen.query_one(Table).cursor_row == 4, "the mark stays"
        await pressed(pilot, "v", "escape")
        assert len(tasks) == read + 1, "after a dialog it is not"


async def test_only_the_last_results_are_kept(
    make_app: Make, identifications: list[Task], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(work, "_KEPT", 2)
    app = make_app(measured())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        for name in ("a", "b", "c", "c", "b", "a"):
            await app.open_identify(f"/b/{name}.h5")
            await until(pilot, lambda: front(app) is results_of(app))
            assert results_of(app).outcome is not None
            await app.open("home")
    asked = [Path(task.session).stem for task in identifications if isinstance(task, IdentifyTask)]
    assert asked == ["a", "b", "c", "a"], "the first was given up for the third"


def test_choices_are_those_of_the_last_terminal(tmp_path: Path) -> None:
    path = tmp_path / "bumpbench" / "terminal.json"
    first = Signals(path, lambda: None, lambda *_: None)
    assert (first.sound, first.big) == (True, False)
    assert (first.toggle_sound(), first.toggle_big()) == ("", "")
    again = Signals(path, lambda: None, lambda *_: None)
    assert (again.sound, again.big) == (False, True)
