"""How a display is started, announced and ended; processes and pages are only noted."""

from __future__ import annotations

import asyncio
import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from daq.errors import InputError
from tui.cli import run
from tui.display import run as running
from tui.display.run import run_display
from tui.display.served import Served
from tui.display.start import display_beside_recorder, display_beside_terminal

LINK = "http://127.0.0.1:8010/token/"


class Child:
    """A process that is only noted."""

    def __init__(self, out: str = "", err: str = "", stays: bool = False) -> None:
        self.command: list[str] = []
        self.options: dict[str, Any] = {}
        self.stdin, self.stdout, self.stderr = io.StringIO(), io.StringIO(out), io.StringIO(err)
        self.stays, self.ended = stays, list[object]()

    def __call__(self, command: list[str], **options: Any) -> Child:
        self.command, self.options = command, options
        return self

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.append("left")

    def wait(self, timeout: float) -> None:
        """Wait for it; its standard input has been closed."""
        assert self.stdin.closed
        self.ended.append(timeout)
        if self.stays:
            raise subprocess.TimeoutExpired("display", timeout)

    def kill(self) -> None:
        """End it."""
        self.ended.append("killed")


def started(monkeypatch: pytest.MonkeyPatch, child: Child) -> Child:
    monkeypatch.setattr("tui.display.start.subprocess.Popen", child)
    return child


def test_beside_a_recorder_it_writes_its_link_to_the_same_stderr(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    child = started(monkeypatch, Child())
    monkeypatch.chdir(tmp_path)
    with display_beside_recorder(Path("day"), "here", control=False):
        assert not child.stdin.closed
    assert child.command == [
        sys.executable, "-m", "tui.display.attached", str(tmp_path / "day"),
        "--host", "here", "--operator", "display",
    ]  # fmt: skip
    assert child.options == {
        "stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": None, "text": True,
    }  # fmt: skip
    assert child.ended == [2.0, "left"]


def test_one_that_does_not_end_within_two_seconds_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    child = started(monkeypatch, Child(stays=True))
    with display_beside_recorder(tmp_path, "here", control=True):
        pass
    assert child.command[-1] == "--control"
    assert child.ended == [2.0, "killed", "left"]


def test_beside_a_terminal_in_the_network_it_shows_a_code_for_cameras(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = {"link": LINK, "host": "192.0.2.7", "secret": "493217"}
    child = started(monkeypatch, Child(json.dumps(said) + "\n"))
    with display_beside_terminal(tmp_path, "here", "MK", control=True) as link:
        assert link is not None
        assert link.lines[0] == f"display: open {LINK}"
        assert "493 217" in link.lines[2]
        assert not any("\x1b" in line for line in link.lines)
        assert len(link.code) > 10
        assert link.code[1][2:9] == "█▀▀▀▀▀█"
    assert child.command[-3:] == ["--operator", "MK", "--control"]
    assert child.options["stdout"] == child.options["stderr"] == subprocess.PIPE


@pytest.mark.parametrize(
    ("err", "why"),
    [
        ("Traceback\nOSError: no port \n", "OSError: no port (start it alone: bumpbench display)"),
        ("", "it did not start (start it alone"),
    ],
)
def test_one_that_does_not_start_says_its_last_words(
    err: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    child = started(monkeypatch, Child(err=err))
    with (
        pytest.raises(InputError) as refused,
        display_beside_terminal(tmp_path, "here", "MK", control=False),
    ):
        pass
    assert f"display: {why}" in str(refused.value)
    assert child.ended == [2.0, "left"]


def test_without_its_library_nothing_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "tui.display.link", None)
    with (
        pytest.raises(InputError, match=r"--display: aiohttp is not installed"),
        display_beside_recorder(tmp_path, "here", control=False),
    ):
        pass
    assert run(["display", str(tmp_path)]) == 2
    assert "display: aiohttp is not installed (install bumpbench[web])" in capsys.readouterr().err


# The server ---------------------------------------------------------------------------------------


class Pages:
    """A server of pages that only waits for its end."""

    made: list[tuple[Any, ...]]
    does: Callable[[], None] | None

    def __init__(self, guard: Any, *rest: Any) -> None:
        Pages.made.append((guard.link, *rest))

    async def serve(
        self, host: str, port: int, ended: asyncio.Event, listening: Callable[[], object]
    ) -> None:
        """Wait."""
        Pages.made.append((host, port))
        listening()
        if Pages.does is not None:
            Pages.does()
        await asyncio.wait_for(ended.wait(), 20.0)


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Pages]]:
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    monkeypatch.setattr(Pages, "made", [], raising=False)
    monkeypatch.setattr(Pages, "does", None, raising=False)
    monkeypatch.setattr(running, "DisplayServer", Pages)
    yield Pages
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("control", [False, True])
def test_a_display_is_announced_once_and_ended_from_anywhere(
    control: bool, tmp_path: Path, pages: type[Pages]
) -> None:
    announced: list[Served] = []

    def announce(served: Served, end: Callable[[], object]) -> None:
        announced.append(served)
        end()

    run_display(tmp_path, "here", "MK", control, announce)
    ((link, feed, folder, name, granted), (host, port)) = pages.made
    (served,) = announced
    assert (served.link, served.host, host) == (link, "127.0.0.1", "127.0.0.1")
    assert f":{port}/" in link
    assert (folder, name, feed._control) == (tmp_path, "MK", False)
    assert (granted is not None, bool(served.secret)) == (control, control)
    assert granted is None or granted.secret == served.secret


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_a_display(number: int, tmp_path: Path, pages: type[Pages]) -> None:
    run_display(tmp_path, "here", "MK", False, lambda *_: os.kill(os.getpid(), number))
    assert len(pages.made) == 2


def test_a_display_that_lost_its_recorder_by_a_fault_ends_with_the_fault(
    tmp_path: Path, pages: type[Pages], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails() -> None:
        asyncio.get_running_loop().call_soon(lambda: [].pop())

    def says() -> None:
        asyncio.get_running_loop().call_exception_handler({"message": "odd"})

    for does, error, words in ((fails, IndexError, "pop"), (says, RuntimeError, "odd")):
        monkeypatch.setattr(Pages, "does", staticmethod(does))
        with pytest.raises(error, match=words):
            run_display(tmp_path, "here", "MK", False, lambda *_: None)
    assert len(pages.made) == 4


# The command --------------------------------------------------------------------------------------


@pytest.mark.parametrize("recorder", [False, True])
def test_the_command_writes_link_and_number_and_whether_a_recorder_runs(
    recorder: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked: list[tuple[Any, ...]] = []

    def serve(folder: Path, host: str, name: str, control: bool, announce: Any) -> None:
        asked.append((folder, host, name, control))
        announce(Served(LINK, "127.0.0.1", "493217"), lambda: None)

    monkeypatch.setattr(running, "run_display", serve)
    monkeypatch.setattr("daq.control.is_running", lambda _: recorder)
    monkeypatch.setattr("getpass.getuser", lambda: "somebody")
    assert run(["display", str(tmp_path)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == f"display: open {LINK}"
    assert lines[1].startswith("control: type 493 217")
    waits = f"bumpbench: {tmp_path}: no recorder runs there; the page waits for one"
    assert [line.startswith(waits) for line in lines[2:-1]] == [True] * (not recorder)
    assert lines[-1] == "bumpbench: the display has ended; the recorder goes on"
    words = ["--host", "lan", "--control", "--operator", "MK"]
    assert run(["display", str(tmp_path), *words]) == 0
    assert asked == [(tmp_path, "here", "somebody", False), (tmp_path, "lan", "MK", True)]
