"""The server of the display: who is admitted, what is sent, what a flood costs."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from daq.control.messages import Arm, Hello, Order, Phase, Reject
from tui.browser.server import MOST_UNPROVEN, Guard, listen, terminal_pages
from tui.display.follow import Hub
from tui.display.server import Control, DisplayServer

from ..terminal.fake_recorder import FakeRecorder

HOST = "127.0.0.1"
PATIENCE_S = 30.0


@dataclass
class Page:
    """A browser's page on a display."""

    http: aiohttp.ClientSession
    guard: Guard
    recorder: FakeRecorder
    control: Control | None

    async def post(self, place: str, **body: object) -> tuple[int, str]:
        own = {"Origin": self.guard.origin}
        async with self.http.post(self.guard.link + place, json=body, headers=own) as answer:
            return answer.status, (await answer.json()).get("error", "")


@asynccontextmanager
async def display(folder: Path, control: Control | None = None) -> AsyncIterator[Page]:
    recorder = FakeRecorder(in_control=False)
    recorder.mark("vehicle", "check")
    guard, ended = Guard(HOST, listen(HOST, 0)), asyncio.Event()
    server = DisplayServer(guard, recorder, folder, "MK", control)
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


def test_a_page_is_sent_what_is_and_what_changes(tmp_path: Path) -> None:
    async def act() -> None:
        async with display(tmp_path) as page:
            first: dict[str, Any] = {}
            async for topic, data in events(page):
                first[topic] = data
                if topic == "view" and data["headline"]["kind"] == "ready":
                    break
            assert first["role"] == {"control": False, "granted": False}
            assert first["view"]["vehicle"] == "Ford Granada"
            assert first["curves"]["curves"] == []
            page.recorder.turn(Phase.ARMED)
            await until(page, "view", lambda view: view["headline"]["word"] == ["BUMP", "NOW"])
            page.recorder.bump()
            page.recorder.judge()
            for _ in range(3):  # a picture is drawn with every third message
                page.recorder.post(page.recorder.live())
            curves = await until(page, "curves", lambda curves: bool(curves["curves"]))
            assert curves["run"] == "baseline_bounce_1"
            assert await page.post("order", button="next") == (
                403,
                "enter the number that is shown at the terminal",
            )
            assert (await page.post("control", number="1"))[1] == "this display only looks on"
            assert not [order for order in page.recorder.orders if isinstance(order, Hello)]

    asyncio.run(act())


def test_what_is_served_asks_for_nothing_from_elsewhere(tmp_path: Path) -> None:
    async def act() -> None:
        async with display(tmp_path) as page:
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

    asyncio.run(act())


@pytest.mark.parametrize("place", ["", "events", "app.js"])
def test_unproven_are_refused(tmp_path: Path, place: str) -> None:
    async def act() -> None:
        async with display(tmp_path) as page:
            link = page.guard.link
            for other, headers in (
                (f"{page.guard.origin}/{'A' * 43}/", {}),
                (link, {"Host": "evil.example"}),
                (link, {"Origin": "http://evil.example"}),
            ):
                async with page.http.get(other + place, headers=headers) as answer:
                    assert answer.status == 403

    asyncio.run(act())


def _with_control(tmp_path: Path, act: Callable[[Page], Awaitable[None]]) -> list[Order]:
    async def run() -> list[Order]:
        async with display(tmp_path, Control()) as page:
            await until(page, "view", lambda view: view["headline"]["kind"] == "ready")
            await act(page)
            return page.recorder.orders

    return asyncio.run(run())


def test_orders_need_the_number(tmp_path: Path) -> None:
    async def act(page: Page) -> None:
        assert page.control is not None
        assert (await page.post("order", button="next"))[0] == 403
        assert (await page.post("control", number="12"))[0] == 403
        assert await page.post("control", number=page.control.secret) == (200, "")
        assert (await until(page, "role", lambda _: True)) == {"control": True, "granted": True}
        assert await page.post("order", button="next") == (200, "")
        page.recorder.publish()
        await until(page, "view", lambda view: view["buttons"]["pause"] == "Pause")
        assert (await page.post("order", button="next"))[0] == 409, "it is armed"
        label = page.recorder.bump()
        page.recorder.judge()
        await until(page, "view", lambda view: view["buttons"]["reject_label"] == label)
        assert (await page.post("order", button="reject", label="baseline_bounce_9"))[0] == 409
        assert (await page.post("order", button="reject", label=label))[0] == 200

    orders = _with_control(tmp_path, act)
    assert [order for order in orders if isinstance(order, Arm | Reject)] == [
        Arm(),
        Reject("baseline_bounce_1"),
    ]
    assert Hello("MK", control=True) in orders


def test_a_terminal_in_control_is_named_and_can_be_followed(tmp_path: Path) -> None:
    async def act(page: Page) -> None:
        assert page.control is not None
        await page.post("control", number=page.control.secret)
        page.recorder.refuse = "JL is in control (take over, or only watch)"
        code, error = await page.post("order", button="next")
        assert (code, error.partition(" (")[0]) == (423, "JL is in control")
        page.recorder.refuse = ""
        assert (await page.post("order", button="next", take_over=True))[0] == 200

    assert Hello("MK", control=True, take_over=True) in _with_control(tmp_path, act)


def test_orders_of_no_page_of_ours_are_refused(tmp_path: Path) -> None:
    async def act(page: Page) -> None:
        assert page.control is not None
        await page.post("control", number=page.control.secret)
        place, own = f"{page.guard.link}order", {"Origin": page.guard.origin}
        body = b'{"button": "next"}'
        for headers, data in (
            ({"Content-Type": "application/json"}, body),
            ({**own, "Content-Type": "text/plain"}, body),
            ({**own, "Content-Type": "application/json"}, b"[]"),
            ({**own, "Content-Type": "application/json"}, b"{"),
            ({**own, "Content-Type": "application/json"}, b'"%s"' % (b"x" * 2000)),
        ):
            async with page.http.post(place, data=data, headers=headers) as answer:
                assert answer.status in (403, 413), data

    assert not [order for order in _with_control(tmp_path, act) if isinstance(order, Arm)]


def test_a_page_that_does_not_read_misses_states_and_delays_no_other() -> None:
    async def act() -> None:
        hub = Hub()
        hub.post("view", b"0")
        slow, quick = hub.messages(), hub.messages()
        for reader in (slow, quick):
            assert await anext(reader) == b"event: view\ndata: 0\n\n"
        assert hub.pages == 2
        for number in range(1, 1000):
            hub.post("view", b"%d" % number)
            assert await anext(quick) == b"event: view\ndata: %d\n\n" % number
        assert await anext(slow) == b"event: view\ndata: 999\n\n", "the newest alone"
        hub.post("view", b"999")
        assert await anext(quick) == b"event: beat\ndata: \n\n", "nothing new within a second"
        hub.close()
        for reader in (slow, quick):
            with pytest.raises(StopAsyncIteration):
                await anext(reader)
        assert hub.pages == 0

    asyncio.run(act())


# Many pages, and pages that do not read -----------------------------------------------------------


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
async def page_of_display(folder: Path) -> AsyncIterator[Guard]:
    async with display(folder) as page:
        yield page.guard


@pytest.mark.parametrize("served", [page_of_display, terminal])
def test_eight_hundred_connections_without_the_token_delay_and_end_nothing(
    served: Callable[[Path], AbstractAsyncContextManager[Guard]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("tui.browser.server.PROOF_S", 1.0)

    async def act() -> None:
        async with served(tmp_path) as guard:
            loop, host = asyncio.get_running_loop(), guard.origin.removeprefix("http://")
            address, port = host.split(":")
            strangers: list[socket.socket] = []
            answered_s: list[float] = []
            descriptors = len(list(Path("/proc/self/fd").iterdir()))
            for n in range(800):
                stranger = socket.socket()
                stranger.setblocking(False)
                await loop.sock_connect(stranger, (address, int(port)))
                said = MALFORMED[n % len(MALFORMED)].replace(b"{host}", host.encode())
                with suppress(OSError):  # closed already
                    await loop.sock_sendall(stranger, said.replace(b"{other}", b"/" + b"A" * 43))
                strangers.append(stranger)
                if len(strangers) > 300:  # this process has both ends
                    strangers.pop(0).close()
                if n % 200 == 199:
                    began_s = time.monotonic()
                    async with (
                        aiohttp.ClientSession() as http,
                        http.get(guard.link) as answer,
                    ):
                        assert answer.status == 200
                    answered_s.append(time.monotonic() - began_s)
            assert max(answered_s) < 1.0
            for stranger in strangers:
                stranger.close()
            strangers = [socket.create_connection((address, int(port))) for _ in range(100)]
            await asyncio.sleep(0.1)
            assert len(list(Path("/proc/self/fd").iterdir())) <= descriptors + 100 + MOST_UNPROVEN
            for stranger in strangers:  # each is closed by the server, the last after its time
                stranger.setblocking(False)
                with suppress(ConnectionResetError):
                    assert await loop.sock_recv(stranger, 1000) == b""
                stranger.close()
            async with aiohttp.ClientSession() as http, http.get(guard.link) as answer:
                assert answer.status == 200

    asyncio.run(act())
    assert capfd.readouterr() == ("", "")
