"""The server of the display: who is admitted, what is sent, how it is started and ended."""

from __future__ import annotations

import asyncio
import io
import json
import os
import re
import signal
import socket
import sys
import urllib.error
import urllib.request
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import aiohttp
import pytest

from daq.control.messages import Arm, Hello, Phase, Reject
from dbc.words import InputError
from tui.browser.server import Guard, listen, terminal_pages
from tui.cli import run
from tui.display import server
from tui.display.link import Served, display_beside, listen_on
from tui.display.server import Control, DisplayServer, Follower, run_display
from tui.terminal.feed import Lost, Role

from ..terminal.fake_recorder import FakeRecorder, ready

HOST = "127.0.0.1"
PATIENCE_S = 30.0


@dataclass
class Page:
    """A browser's page on a display."""

    http: aiohttp.ClientSession
    guard: Guard
    recorder: FakeRecorder
    control: Control | None

    @property
    def number(self) -> str:
        """The number that the terminal shows."""
        assert self.control is not None
        return self.control.secret

    async def post(self, place: str, **body: object) -> tuple[int, str]:
        own = {"Origin": self.guard.origin}
        async with self.http.post(self.guard.link + place, json=body, headers=own) as answer:
            return answer.status, (await answer.json()).get("error", "")


@asynccontextmanager
async def display(control: Control | None = None) -> AsyncIterator[Page]:
    recorder = ready(in_control=False)
    guard, ended = Guard(HOST, listen(HOST, 0)), asyncio.Event()
    server = DisplayServer(guard, recorder, "MK", control)
    listening = asyncio.Event()
    serving = asyncio.create_task(server.serve(ended, listening.set))
    jar = aiohttp.CookieJar(unsafe=True)  # addresses have cookies in a browser
    async with aiohttp.ClientSession(cookie_jar=jar) as http:
        try:
            async with asyncio.timeout(PATIENCE_S):
                await listening.wait()
                yield Page(http, guard, recorder, control)
        finally:
            ended.set()
            await serving


async def events(page: Page) -> AsyncIterator[tuple[str, Any]]:
    async with page.http.get(f"{page.guard.link}events") as stream:
        assert stream.status == 200
        topic = ""
        async for line in stream.content:
            name, _, value = line.decode().rstrip("\n").partition(": ")
            if name == "event":
                topic = value
            elif name == "data":
                yield topic, json.loads(value) if value else None


async def until(page: Page, topic: str, found: Callable[[Any], bool]) -> Any:
    async for name, data in events(page):
        if name == topic and found(data):
            return data
    raise AssertionError(topic)


async def test_a_page_is_sent_what_is_and_what_changes() -> None:
    async with display() as page:
        first: dict[str, Any] = {}
        async for topic, data in events(page):
            first[topic] = data
            if topic == "view" and data["headline"]["kind"] == "ready":
                break
        assert first["role"] == {"control": False, "granted": False}
        assert first["view"]["vehicle"] == "Ford Granada"
        page.recorder.turn(Phase.ARMED)
        await until(page, "view", lambda view: view["headline"]["word"] == ["BUMP", "NOW"])
        assert await page.post("order", button="next") == (
            403,
            "enter the number that is shown at the terminal",
        )
        assert (await page.post("control", number="1"))[1] == "this display only looks on"
        assert not [order for order in page.recorder.orders if isinstance(order, Hello)]


async def test_what_is_served_asks_for_nothing_from_elsewhere() -> None:
    async with display() as page:
        async with page.http.get(page.guard.link) as answer:
            text = await answer.text()
            policy = answer.headers["Content-Security-Policy"]
            assert answer.headers["X-Frame-Options"] == "DENY"
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert not re.search(r"\sstyle=|\son\w+=|<style", text), "refused by the policy"
        places = re.findall(r'(?:src|href)="([^"]+)"', text)
        assert {"app.js", "display.css"} <= set(places)
        for place in places:
            assert re.fullmatch(r"[\w.]+", place)
            async with page.http.get(page.guard.link + place) as answer:
                assert answer.status == 200
                code = await answer.text()
                assert not re.search(r"https?://(?!www\.w3\.org/)", code), place
                assert "innerHTML" not in code


@pytest.mark.parametrize("place", ["", "events", "app.js"])
async def test_unproven_are_refused(tmp_path: Path, place: str) -> None:
    async with display() as page:
        link = page.guard.link
        for other, headers in (
            (f"{page.guard.origin}/{'A' * 43}/", {}),
            (link, {"Host": "evil.example"}),
            (link, {"Origin": "http://evil.example"}),
        ):
            async with page.http.get(other + place, headers=headers) as answer:
                assert answer.status == 403


@asynccontextmanager
async def controlled() -> AsyncIterator[Page]:
    """Give a page that may enter the number, once it shows that the recorder is ready."""
    async with display(Control()) as page:
        await until(page, "view", lambda view: view["headline"]["kind"] == "ready")
        yield page


async def test_orders_need_the_number() -> None:
    async with controlled() as page:
        assert (await page.post("order", button="next"))[0] == 403
        assert (await page.post("control", number="12"))[0] == 403
        assert await page.post("control", number=page.number) == (200, "")
        assert (await until(page, "role", lambda _: True)) == {"control": True, "granted": True}
        assert await page.post("order", button="next") == (200, "")
        page.recorder.publish()
        await until(page, "view", lambda view: view["buttons"]["pause"] == "Pause")
        assert (await page.post("order", button="next"))[0] == 409, "it is armed"
        label = page.recorder.bump()
        page.recorder.judge()
        await until(page, "view", lambda view: view["buttons"]["reject_target"] == label)
        assert (await page.post("order", button="reject", target="baseline_bounce_9"))[0] == 409
        assert (await page.post("order", button="reject", target=label))[0] == 200
    orders = page.recorder.orders
    assert [order for order in orders if isinstance(order, Arm | Reject)] == [
        Arm(),
        Reject("baseline_bounce_1"),
    ]
    assert Hello("MK", control=True) in orders


async def test_a_terminal_in_control_is_named_and_can_be_followed() -> None:
    async with controlled() as page:
        await page.post("control", number=page.number)
        page.recorder.refuse = "JL is in control (take over, or only watch)"
        code, error = await page.post("order", button="next")
        assert (code, error.partition(" (")[0]) == (423, "JL is in control")
        page.recorder.refuse = ""
        page.recorder.full = True
        assert await page.post("order", button="next") == (409, "the disk is full")
        page.recorder.full = False
        assert (await page.post("order", button="next", take_over=True))[0] == 200
    assert Hello("MK", control=True, take_over=True) in page.recorder.orders


async def test_orders_of_no_page_of_ours_are_refused() -> None:
    async with controlled() as page:
        await page.post("control", number=page.number)
        own = {"Origin": page.guard.origin}
        body = b'{"button": "next"}'
        for headers, data in (
            ({"Content-Type": "application/json"}, body),
            ({**own, "Content-Type": "text/plain"}, body),
            ({**own, "Content-Type": "application/json"}, b"[]"),
            ({**own, "Content-Type": "application/json"}, b"{"),
            ({**own, "Content-Type": "application/json"}, b'"%s"' % (b"x" * 2000)),
        ):
            for place in ("order", "control"):
                link = f"{page.guard.link}{place}"
                async with page.http.post(link, data=data, headers=headers) as answer:
                    assert answer.status in (403, 413), data
                    assert "looks on" not in await answer.text(), "it may have control"
    assert not [order for order in page.recorder.orders if isinstance(order, Arm)]


async def test_a_page_that_does_not_read_misses_states_and_delays_no_other() -> None:
    recorder = FakeRecorder()
    follower = Follower(recorder)
    follower.start()
    slow, quick = follower.messages(), follower.messages()
    for reader in (slow, quick):
        assert b"waiting for the recorder" in await anext(reader)
    for number in range(100):
        follower.take(replace(recorder.status, vehicle=f"T{number}"))
        assert b'"T%d"' % number in await anext(quick)
    assert b'"T99"' in await anext(slow), "the newest alone"
    await asyncio.sleep(0)
    follower.take(replace(recorder.status, vehicle="T99"))
    while (message := await anext(quick)).startswith(b"event: view"):
        assert b'"T99"' in message
    assert message == b"event: beat\ndata: \n\n", "nothing new within a second"
    follower.close()
    with pytest.raises(StopAsyncIteration):
        await anext(quick)


MALFORMED = (
    b"OPTIONS * HTTP/1.1\r\nHost: {host}\r\n\r\n",
    b"GET http://[ HTTP/1.1\r\nHost: {host}\r\n\r\n",
    b"GET {other} HTTP/1.1\r\nHost: {host}\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 300,
    b"GET /\xff\xfe\xed\xa0\x80 HTTP/1.1\r\nHost: {host}\r\n\r\n",
    b"POST / HTTP/1.1\r\nHost: {host}\r\nContent-Length: 1000000\r\n\r\nslow",
    b"GET / HTTP/1.1\r\nHos",
    b"",
)


@asynccontextmanager
async def terminal(folder: Path) -> AsyncIterator[Guard]:
    listening = listen(HOST, 0)
    guard = Guard(HOST, listening)
    arguments = ["tui", "--demo", "--out", str(folder)]
    async with guard.serving(await terminal_pages(arguments, listening)):
        yield guard


@asynccontextmanager
async def page_of_display(_: Path) -> AsyncIterator[Guard]:
    async with display() as page:
        yield page.guard


@pytest.mark.parametrize("served", [page_of_display, terminal])
def test_malformed_requests_without_the_token_end_nothing_and_write_nothing(
    served: Callable[[Path], AbstractAsyncContextManager[Guard]],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    async def act() -> None:
        async with served(tmp_path) as guard:
            host = guard.origin.removeprefix("http://")
            address, port = host.split(":")
            strangers = []
            for request in 5 * MALFORMED:
                _, stranger = await asyncio.open_connection(address, int(port))
                said = request.replace(b"{host}", host.encode())
                stranger.write(said.replace(b"{other}", b"/" + b"A" * 43))
                strangers.append(stranger)
            async with aiohttp.ClientSession() as http, http.get(guard.link) as answer:
                assert answer.status == 200
            for stranger in strangers:
                stranger.close()

    asyncio.run(act())
    assert capfd.readouterr() == ("", "")


# How it is started and ended ----------------------------------------------------------------------


LINK = "http://192.0.2.7:8010/Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmF/"


def test_beside_another_program_it_is_served_whoever_asks_until_that_ends(tmp_path: Path) -> None:
    day = tmp_path / "day" / "car"  # its recorder is started after the display, and makes it
    with display_beside(day, "here", "MK", control=True) as display:
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


def test_one_that_cannot_be_served_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with display_beside(tmp_path, None, "MK", control=False) as display:
        assert display is None
    failing = tmp_path / "python"
    failing.write_text("#!/bin/sh\necho of many >&2\necho first line, last line >&2\n", "ascii")
    failing.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(failing))
    for folder, host, said in (
        (tmp_path, None, "needs a display"),
        (tmp_path, "0.0.0.0", "every address"),
        (tmp_path, "::", "every address"),
        (tmp_path, "192.0.2.7", r"cannot listen on 192\.0\.2\.7"),
        (tmp_path, "192.168..5", "it is no address"),
        (tmp_path, "here", r"first line, last line \(start it alone"),
    ):
        with (
            pytest.raises(InputError, match=said),
            display_beside(folder, host, "MK", control=True),
        ):
            pass
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    with (
        pytest.raises(InputError, match="needs aiohttp, which is not installed"),
        display_beside(tmp_path, "here", "MK", control=False),
    ):
        pass
    assert run(["display", str(tmp_path)]) == 2
    assert (
        "needs aiohttp, which is not installed (pip install 'bumpbench[web]')"
        in capsys.readouterr().err
    )


def test_a_link_into_the_network_comes_with_a_warning_and_a_code() -> None:
    served = Served(LINK, "192.0.2.7", "493217")
    assert served.lines[0] == f"display: open {LINK}"
    assert served.lines[1].startswith("warning: ")
    assert "493 217" in served.lines[2]
    for host in ("127.0.0.1", "::1", "localhost"):
        here = Served(LINK, host, "")
        assert (here.lines, here.code) == ((f"display: open {LINK}",), ())
    assert len(served.code) <= 20
    assert len(served.code[0]) <= 40
    corner = "█▀▀▀▀▀█"  # the first two rows of a finder, behind a margin of two
    assert served.code[1][2:9] == served.code[1][-9:-2] == corner


@pytest.fixture
def _signals() -> Iterator[None]:
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.usefixtures("_signals")
def test_only_a_fault_of_its_own_ends_a_display(tmp_path: Path) -> None:
    def fails(*_: object) -> None:
        asyncio.get_running_loop().call_soon(lambda: [].pop())

    def says(*_: object) -> None:
        loop = asyncio.get_running_loop()
        loop.call_exception_handler({"message": "too many open files", "socket": 3})
        loop.call_exception_handler({"message": "odd"})

    for announce, error, words in ((fails, IndexError, "pop"), (says, RuntimeError, "odd")):
        with pytest.raises(error, match=words):
            run_display(tmp_path, "here", "MK", False, announce)


def test_the_command_writes_link_and_number_beside_a_recorder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[tuple[Any, ...]] = []
    served = Served("http://127.0.0.1:8010/token/", "127.0.0.1", "493217")

    def serve(folder: Path, host: str, name: str, control: bool, announce: Any) -> None:
        asked.append((folder, host, name, control))
        announce(served, lambda: None)

    monkeypatch.setattr(server, "run_display", serve)
    monkeypatch.setattr("daq.control.address.is_running", lambda _: True)
    monkeypatch.setattr("getpass.getuser", lambda: "somebody")
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert run(["display", str(tmp_path)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == f"display: open {served.link}"
    assert lines[1].startswith("control: type 493 217")
    assert lines[2:] == ["bumpbench: the display has ended; the recorder goes on"]
    words = ["--host", "lan", "--control", "--operator", "MK", "--json"]
    assert run(["display", str(tmp_path), *words]) == 0
    assert json.loads(capsys.readouterr().out)["link"] == served.link
    assert asked == [(tmp_path, "here", "somebody", False), (tmp_path, "lan", "MK", True)]


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


async def test_a_lost_recorder_is_shown_and_takes_no_order() -> None:
    recorder = FakeRecorder()
    follower = Follower(recorder)

    async def shown() -> Any:
        message = await anext(follower.messages())
        return json.loads(message.partition(b"data: ")[2])

    assert follower.status is None
    follower.start()
    for _ in range(9):
        await asyncio.sleep(0)
    assert (await shown())["vehicle"] == "Ford Granada"
    follower.take(Role(True))
    assert follower.status is not None
    follower.take(Lost("it has ended", "see its log"))
    assert (await shown())["headline"]["kind"] == "lost"
    assert follower.status is None


def test_the_usual_port_is_taken_if_it_is_free() -> None:
    here = f"127.{1 + os.getpid() % 250}.0.2"  # of this machine, and nothing else listens there
    (address, taken), (_, other) = listen_on(here), listen_on(here)
    with taken, other:
        assert (address, taken.getsockname()[1]) == (here, 8010)
        assert other.getsockname()[1] not in (0, 8010)


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
    assert (listened, probed) == ([("192.168.1.5", 8010)], [("192.0.2.1", 9)])
    monkeypatch.setattr(socket.socket, "connect", unreachable)
    with pytest.raises(InputError, match="no network is connected"):
        listen_on("lan")


class Ended(io.StringIO):
    """Standard error that interrupts the display as soon as its link is there."""

    def write(self, text: str) -> int:
        if "display: open" in text:
            signal.raise_signal(signal.SIGTERM)
        return super().write(text)


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
    waits = f"bumpbench: {tmp_path}: no recorder runs there; the page waits for one"
    assert lines[2].startswith(waits)
    assert lines[3] == "bumpbench: the display has ended; the recorder goes on"
