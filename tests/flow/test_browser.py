"""The terminal in a browser: the page, its socket, and nothing from anywhere else."""

from __future__ import annotations

import asyncio
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import aiohttp
import pytest

from .bench_terminal import PATIENCE_S, end_recorder


async def _seen_by_a_browser(url: str) -> None:
    origin = url.rsplit("/", 2)[0]
    async with aiohttp.ClientSession() as browser:
        page = await _page(browser, url)
        places = re.findall(r"""["'(](\w+://[^"')]*)""", page)
        assert len(places) > 3
        for place in places:  # a bench has no network, and one that swallows all is worse
            assert re.match(r"(http|ws)" + re.escape(url.removeprefix("http")), place)
            if place.startswith("http"):
                async with browser.get(place) as answer:
                    assert answer.status == 200
                    assert answer.headers["Referrer-Policy"] == "no-referrer"
        socket_url = re.search(r'data-session-websocket-url="([^"]+)"', page)
        assert socket_url is not None
        await _refuses_all_others(browser, places, url, origin)
        async with browser.ws_connect(
            f"{socket_url[1]}?width=80&height=24", origin=origin
        ) as terminal:
            await _until(terminal, b"Ford Granada")  # from its status
            await terminal.send_json(["stdin", "\x1bOP"])  # F1
            await _until(terminal, b"Help")


async def _refuses_all_others(
    browser: aiohttp.ClientSession, places: Sequence[str], url: str, origin: str
) -> None:
    """Check page, socket and files against strangers, each of which differs in one thing only."""
    host = origin.removeprefix("http://")
    port, token = host.rpartition(":")[2], url.split("/")[3]
    for place in {url, *places}:
        own = {"Origin": origin} if place.startswith("ws") else {}
        for stranger in ("/", f"/{'A' * len(token)}/", f"/{token[:-1]}/", f"/{token}A/"):
            await _is_refused(browser, place.replace(f"/{token}/", stranger), own)
        for other in ("http://evil.example", f"http://localhost:{port}", f"https://{host}", "null"):
            await _is_refused(browser, place, {"Origin": other})
        for other in (f"evil.example:{port}", "127.0.0.1", f"localhost:{port}", "127.0.0.1:1"):
            await _is_refused(browser, place, {**own, "Host": other})
        if place.startswith("ws"):
            await _is_refused(browser, place, {})  # a browser always names its page


async def _is_refused(
    browser: aiohttp.ClientSession, place: str, headers: Mapping[str, str]
) -> None:
    if place.startswith("ws"):
        with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
            await browser.ws_connect(place, headers=headers)
        assert caught.value.status == 403, (place, headers)
        return
    async with browser.get(place, headers=headers) as answer:
        assert answer.status == 403, (place, headers)
        assert (await answer.text()).startswith("refused: ")
        assert "Access-Control-Allow-Origin" not in answer.headers


async def _page(browser: aiohttp.ClientSession, url: str) -> str:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                async with browser.get(url) as answer:
                    return await answer.text()
            except aiohttp.ClientConnectionError:  # it says where a moment before it listens
                await asyncio.sleep(0.1)


async def _until(terminal: aiohttp.ClientWebSocketResponse, words: bytes) -> None:
    seen = b""
    async with asyncio.timeout(PATIENCE_S):
        while words not in seen:
            message = await terminal.receive()
            assert message.type in (aiohttp.WSMsgType.BINARY, aiohttp.WSMsgType.TEXT), seen
            if message.type is aiohttp.WSMsgType.BINARY:
                seen += message.data


def test_the_terminal_in_a_browser(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tui", "tui", "--demo", "--web", "--out", str(tmp_path)]
    with socket.socket() as taken:  # where it would be served, another program is
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", 8000))
        taken.listen()
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
            try:
                assert server.stderr is not None
                said = server.stderr.readline()
                url = re.match(r"open (http://127\.0\.0\.1:\d+/[\w-]{43}/) in a browser", said)
                assert url is not None, said
                assert ":8000/" not in url[1]
                asyncio.run(_seen_by_a_browser(url[1]))
                server.send_signal(signal.SIGINT)
                assert server.wait(PATIENCE_S) == 0
                assert "Traceback" not in server.stderr.read()
            finally:
                server.kill()
                end_recorder(tmp_path)
