"""How a display is started, announced and ended; the edges of its pages."""

from __future__ import annotations

import asyncio
import io
import json
import os
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest

from daq.control.exchange import OrderRefusedError
from daq.control.messages import Arm, AskBench, AskHistory, Order, Reply
from daq.errors import InputError
from tui.cli import run
from tui.display import server
from tui.display.follow import Follower, Hub
from tui.display.link import (
    Served,
    display_beside_recorder,
    display_beside_terminal,
    is_loopback,
    listen_on,
)
from tui.display.server import MOST_PAGES, Control, run_display
from tui.terminal.feed import Lost, Role

from ..terminal.fake_recorder import FakeRecorder
from .test_server import display

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
        for _ in range(100):  # its messages about them are not read
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

    monkeypatch.setattr("tui.display.link.subprocess.Popen", popen)
    monkeypatch.setattr("tui.display.link._END_S", 0.1)
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
    monkeypatch.setitem(sys.modules, "tui.browser.server", None)
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


# Edges of pages and addresses ---------------------------------------------------------------------


S = 1_000_000_000


@pytest.fixture
def recorder() -> FakeRecorder:
    made = FakeRecorder()
    made.mark("vehicle", "check")
    return made


# Control ----------------------------------------------------------------------------------------


def test_wrong_numbers_are_forgotten_after_a_minute_one_by_one() -> None:
    control = Control()
    control.secret = "493217"
    for second in (0.0, 10.0, 20.0, 30.0, 40.0):
        assert "not the number" in control.grant("000000", second)[1]
    assert control.grant("493217", 59.9) == ("", "too many wrong numbers: wait a minute")
    key, refusal = control.grant("493 217", 60.0)
    assert (control.holds(key), refusal) == (True, "")
    assert "not the number" in control.grant("493218", 60.0)[1]
    assert "wait a minute" in control.grant("493217", 69.9)[1]


def test_a_page_too_many_is_refused(tmp_path: Path) -> None:
    async def act() -> None:
        async with display(tmp_path) as page:
            place = f"{page.guard.link}events"
            streams = [await page.http.get(place) for _ in range(MOST_PAGES)]
            assert [stream.status for stream in streams] == [200] * 32
            async with page.http.get(place) as refused:
                assert refused.status == 503
                assert "32 displays" in await refused.text()
            for stream in streams:
                stream.close()

    asyncio.run(act())


def test_an_order_that_the_recorder_refuses_is_said_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def act() -> None:
        async with display(tmp_path, Control()) as page:
            assert page.control is not None
            await page.post("control", number=page.control.secret)
            while page.recorder.orders == []:
                await asyncio.sleep(0)
            ask = page.recorder.ask

            async def refusing(order: Order) -> Reply:
                if isinstance(order, Arm):
                    raise OrderRefusedError("the disk is full")
                return await ask(order)

            monkeypatch.setattr(page.recorder, "ask", refusing)
            assert await page.post("order", button="next") == (409, "the disk is full")

    asyncio.run(act())


# The view ---------------------------------------------------------------------------------------


# Curves -----------------------------------------------------------------------------------------


# Following --------------------------------------------------------------------------------------


class Refusing(FakeRecorder):
    """A recorder that refuses at first to send its bench."""

    async def ask(self, order: Order) -> Reply:
        """Refuse once."""
        if isinstance(order, AskBench) and not self.orders:
            self.orders.append(order)
            raise OrderRefusedError("not now")
        return await super().ask(order)


def posted(hub: Hub, topic: str) -> Any:
    return json.loads(hub._messages[topic][1])


def test_a_bench_that_was_refused_is_asked_for_again(tmp_path: Path) -> None:
    async def act() -> None:
        recorder, hub = Refusing(), Hub()
        follower = Follower(recorder, tmp_path, hub)
        assert follower.status is None
        follower.start()
        for _ in range(9):
            await asyncio.sleep(0)
        assert posted(hub, "view")["vehicle"] == "Ford Granada"
        assert posted(hub, "view")["sketch"] is None
        assert [type(order) for order in recorder.orders] == [AskBench]
        recorder.publish()
        for _ in range(9):
            await asyncio.sleep(0)
        assert posted(hub, "view")["sketch"] is not None
        assert recorder.orders[1:] == [AskBench(), AskHistory(60.0)]
        recorder.publish()
        follower.take(Role(True))
        for _ in range(9):
            await asyncio.sleep(0)
        assert len(recorder.orders) == 3, "once for each bench"
        recorder.post(Lost("it has ended", "see its log"))
        for _ in range(9):
            await asyncio.sleep(0)
        assert follower.status is None
        assert posted(hub, "view")["headline"]["kind"] == "lost"

    asyncio.run(act())


# Where it listens -------------------------------------------------------------------------------


def test_the_usual_port_is_taken_if_it_is_free() -> None:
    here = f"127.{1 + os.getpid() % 250}.0.2"  # of this machine, and nothing else listens there
    (address, taken), (_, other) = listen_on(here), listen_on(here)
    with taken, other:
        assert (address, taken.getsockname()[1]) == (here, 8010)
        assert other.getsockname()[1] not in (0, 8010)
    address, local = listen_on("here")
    local.close()
    assert address == "127.0.0.1"
    with pytest.raises(InputError, match=r"cannot listen on 192\.0\.2\.1: .*or lan"):
        listen_on("192.0.2.1")


def test_the_address_in_the_network_is_that_of_the_way_to_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unreachable(*_: object) -> NoReturn:
        raise OSError(101, "Network is unreachable")

    probed: list[object] = []
    listened: list[tuple[str, int]] = []
    monkeypatch.setattr("tui.browser.server.listen", lambda *place: listened.append(place))
    monkeypatch.setattr(socket.socket, "connect", lambda _, place: probed.append(place))
    monkeypatch.setattr(socket.socket, "getsockname", lambda _: ("192.168.1.5", 40000))
    assert listen_on("lan")[0] == "192.168.1.5"
    assert listened == [("192.168.1.5", 8010)]
    assert probed == [("192.0.2.1", 9)]
    monkeypatch.setattr(socket.socket, "connect", unreachable)
    with pytest.raises(InputError, match="no network is connected"):
        listen_on("lan")


class Ended(io.StringIO):
    """Standard error that interrupts the display as soon as its link is there."""

    def write(self, text: str) -> int:
        if "display: open" in text:
            signal.raise_signal(signal.SIGTERM)
        return super().write(text)


@pytest.fixture
def _signals() -> Iterator[None]:
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.usefixtures("_signals")
def test_a_display_is_served_until_it_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = Ended()
    monkeypatch.setattr(sys, "stderr", said)
    assert run(["display", str(tmp_path), "--control", "--operator", "MK"]) == 0
    lines = said.getvalue().splitlines()
    assert lines[0].startswith("display: open http://127.0.0.1:")
    assert lines[1].startswith("control: type ")
    assert "no recorder runs there" in lines[2]
    assert lines[3] == "bumpbench: the display has ended; the recorder goes on"
