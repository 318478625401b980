"""Where the terminal begins: who sits there, and whether there is a terminal at all."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest
from textual.widgets import TextArea

from daq.control import address
from daq.control.orders import Arm, Hello
from daq.errors import InputError
from tui.cli import run
from tui.commands.tui import check_fault, known_operator
from tui.diagnostics import ExitCode
from tui.terminal.app import BenchApp
from tui.terminal.state.feed import Lost, News, Role
from tui.terminal.widgets.form import Form

from .conftest import screen_text
from .fake_recorder import FakeRecorder


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


def test_the_name_is_known_from_the_form_that_was_applied(tmp_path: Path) -> None:
    assert known_operator(tmp_path, demo=False) == ""
    assert known_operator(tmp_path, demo=True) == "demo"
    (tmp_path / "vehicle.json").write_text(json.dumps({"operator": " Anna "}))
    assert known_operator(tmp_path, demo=False) == "Anna"
    assert known_operator(tmp_path, demo=True) == "Anna"
    (tmp_path / "vehicle.json").write_text(json.dumps({"operator": 3}))
    assert known_operator(tmp_path, demo=False) == ""


def test_the_name_is_asked_for_once_if_nobody_has_said_it(
    make_app: Callable[..., BenchApp],
) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    app.operator = ""

    async def act() -> None:
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.pause()
            await pilot.pause()
            assert "Your name or initials" in screen_text(app)
            await pilot.press(*"Anna", "enter")
            await pilot.pause()
            assert app.operator == "Anna"
            assert Hello("Anna", control=True) in recorder.orders
            assert "op. Anna" in screen_text(app)

    asyncio.run(act())


def test_the_form_proposes_the_name_of_the_login(
    make_app: Callable[..., BenchApp], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("USER", "anna")
    app = make_app(FakeRecorder())
    app.operator = ""

    async def act() -> None:
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.pause()
            await pilot.pause()
            assert app.screen.query_one(Form).values["operator"] == "anna"

    asyncio.run(act())


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
        assert app.screen.query_one(TextArea).text == "wetx"
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
