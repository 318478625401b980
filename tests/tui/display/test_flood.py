"""Idle, slow and malformed connections without the token, to both servers of pages."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from pathlib import Path

import aiohttp
import pytest

from tui.browser.guard import MOST_UNPROVEN, Guard, listen
from tui.browser.server import terminal_pages

from .test_server import HOST, display

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
def test_two_thousand_connections_without_the_token_delay_and_end_nothing(
    served: Callable[[Path], AbstractAsyncContextManager[Guard]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("tui.browser.guard.PROOF_S", 1.0)

    async def act() -> None:
        async with served(tmp_path) as guard:
            loop, host = asyncio.get_running_loop(), guard.origin.removeprefix("http://")
            address, port = host.split(":")
            strangers: list[socket.socket] = []
            answered_s: list[float] = []
            descriptors = len(list(Path("/proc/self/fd").iterdir()))
            for n in range(2_000):
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
