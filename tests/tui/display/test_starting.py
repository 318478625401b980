"""How a display is started beside a recorder or a terminal, announced and ended."""

from __future__ import annotations

import asyncio
import io
import json
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from daq.errors import InputError
from tui.cli import run
from tui.display import server
from tui.display.link import Served, is_loopback
from tui.display.server import run_display
from tui.display.start import display_beside_recorder, display_beside_terminal

LINK = "http://192.0.2.7:8010/Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmF/"


def test_beside_a_terminal_it_is_served_whoever_asks_until_the_terminal_ends(
    tmp_path: Path,
) -> None:
    with display_beside_terminal(tmp_path, "here", "MK", control=True) as display:
        assert display is not None
        assert display.code == (), "this machine's browsers need no camera"
        link = display.lines[0].removeprefix("display: open ")
        assert display.lines[1].startswith("control: type ")
        host, _, port = link.split("/")[2].partition(":")
        for _ in range(100):  # nobody reads what it would say of them
            with socket.create_connection((host, int(port))) as stranger:
                stranger.sendall(
                    b"OPTIONS * HTTP/1.1\r\nHost: %s:%s\r\n\r\n\0" % (host.encode(), port.encode())
                )
        with urllib.request.urlopen(link, timeout=10.0) as answer:
            assert answer.status == 200
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(link)


def test_beside_a_recorder_nothing_waits_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[tuple[Any, ...]] = []
    opened = subprocess.Popen

    def popen(command: list[str], **options: Any) -> subprocess.Popen[str]:
        started.append((command, options["stdout"], options["stderr"]))
        return opened([sys.executable, "-c", "import time; time.sleep(600)"], **options)

    monkeypatch.setattr("tui.display.start.subprocess.Popen", popen)
    monkeypatch.setattr("tui.display.start._END_S", 0.1)
    monkeypatch.chdir(tmp_path)
    with display_beside_recorder(Path("day"), "here", control=True):
        pass  # and one that does not end is killed
    ((command, stdout, stderr),) = started
    assert command[1:6] == ["-m", "tui", "display", str(tmp_path / "day"), "--display"]
    assert command[6:] == ["here", "--operator", "display", "--json", "--control"]
    assert (stdout, stderr) == (subprocess.DEVNULL, None)


def test_one_that_cannot_be_served_is_refused_before_anything_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with display_beside_terminal(tmp_path, None, "MK", control=False) as display:
        assert display is None
    for host, said in (
        (None, "needs a display"),
        ("0.0.0.0", "every address"),
        ("::", "every address"),
        ("192.0.2.7", r"cannot listen on 192\.0\.2\.7"),
    ):
        with (
            pytest.raises(InputError, match=said),
            display_beside_recorder(tmp_path, host, control=True),
        ):
            pass
    with (
        pytest.raises(InputError, match=r"nosuch: does not exist .*start it alone"),
        display_beside_terminal(tmp_path / "nosuch", "here", "MK", control=False),
    ):
        pass
    monkeypatch.setitem(sys.modules, "tui.display.link", None)
    monkeypatch.delitem(sys.modules, "tui.display.server")
    with (
        pytest.raises(InputError, match=r"--display: aiohttp is not installed"),
        display_beside_recorder(tmp_path, "here", control=False),
    ):
        pass
    assert run(["display", str(tmp_path)]) == 2
    assert "display: aiohttp is not installed (install bumpbench[web])" in capsys.readouterr().err


def test_a_link_into_the_network_comes_with_a_warning_and_a_code() -> None:
    assert [is_loopback(host) for host in ("127.0.0.1", "::1", "localhost")] == [True] * 3
    assert [is_loopback(host) for host in ("192.168.0.4", "bench.local")] == [False] * 2
    served = Served(LINK, "192.0.2.7", "493217")
    lines = list(served.lines(colours=True))
    assert lines[0] == f"display: open {LINK}"
    assert lines[1].startswith("warning: ")
    assert "493 217" in lines[2]
    assert all(line.startswith("\x1b[") for line in lines[3:])
    assert list(Served(LINK, "127.0.0.1", "").lines(colours=True)) == [f"display: open {LINK}"]
    assert len(served.code) <= 20
    assert len(served.code[0]) <= 40
    corner = "█▀▀▀▀▀█"  # the first two rows of a finder, behind a margin of two
    assert served.code[1][2:9] == served.code[1][-9:-2] == corner


# The server ---------------------------------------------------------------------------------------


class Pages:
    """A server of pages that only waits for its end."""

    made: list[tuple[Any, ...]]
    does: Callable[[], None] | None

    def __init__(self, guard: Any, feed: Any, folder: Path, name: str, control: Any) -> None:
        self.secret = control.secret if control else ""
        Pages.made.append((guard, feed, folder, name, control))

    async def serve(self, ended: asyncio.Event, listening: Callable[[], object]) -> None:
        """Wait."""
        listening()
        if Pages.does is not None:
            Pages.does()
        await asyncio.wait_for(ended.wait(), 20.0)


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Pages]]:
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    monkeypatch.setattr(Pages, "made", [], raising=False)
    monkeypatch.setattr(Pages, "does", None, raising=False)
    monkeypatch.setattr(server, "DisplayServer", Pages)
    yield Pages
    for guard, *_ in Pages.made:
        guard._listening.close()
    for number, handler in before.items():
        signal.signal(number, handler)


def test_only_a_fault_of_its_own_ends_a_display(
    tmp_path: Path, pages: type[Pages], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails() -> None:
        asyncio.get_running_loop().call_soon(lambda: [].pop())

    def says() -> None:
        loop = asyncio.get_running_loop()
        loop.call_exception_handler({"message": "too many open files", "socket": 3})
        loop.call_exception_handler({"message": "odd"})

    for does, error, words in ((fails, IndexError, "pop"), (says, RuntimeError, "odd")):
        monkeypatch.setattr(Pages, "does", staticmethod(does))
        with pytest.raises(error, match=words):
            run_display(tmp_path, "here", "MK", False, lambda *_: None)


@pytest.mark.parametrize("recorder", [False, True])
def test_the_command_writes_link_and_number_and_whether_a_recorder_runs(
    recorder: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked: list[tuple[Any, ...]] = []
    served = Served("http://127.0.0.1:8010/token/", "127.0.0.1", "493217")

    def serve(folder: Path, host: str, name: str, control: bool, announce: Any) -> None:
        asked.append((folder, host, name, control))
        announce(served, lambda: None)

    monkeypatch.setattr(server, "run_display", serve)
    monkeypatch.setattr("daq.control.address.is_running", lambda _: recorder)
    monkeypatch.setattr("getpass.getuser", lambda: "somebody")
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert run(["display", str(tmp_path)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == f"display: open {served.link}"
    assert lines[1].startswith("control: type 493 217")
    waits = f"bumpbench: {tmp_path}: no recorder runs there; the page waits for one"
    assert [line.startswith(waits) for line in lines[2:-1]] == [True] * (not recorder)
    assert lines[-1] == "bumpbench: the display has ended; the recorder goes on"
    words = ["--host", "lan", "--control", "--operator", "MK", "--json"]
    assert run(["display", str(tmp_path), *words]) == 0
    assert json.loads(capsys.readouterr().out)["link"] == served.link
    assert asked == [(tmp_path, "here", "somebody", False), (tmp_path, "lan", "MK", True)]
