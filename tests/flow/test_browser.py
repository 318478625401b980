"""The terminal in a browser: the page, its socket, and nothing from anywhere else."""

from __future__ import annotations

import asyncio
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import aiohttp

from .bench_terminal import PATIENCE_S, end_recorder


async def _seen_by_a_browser(url: str) -> None:
    async with aiohttp.ClientSession() as browser:
        page = await _page(browser, url)
        places = re.findall(r"""["'(](\w+://[^"')]*)""", page)
        assert len(places) > 3
        for place in places:  # a bench has no network, and one that swallows all is worse
            assert re.match(r"(http|ws)" + re.escape(url.removeprefix("http")), place)
            if place.startswith("http"):
                async with browser.get(place) as answer:
                    assert answer.status == 200
        socket_url = re.search(r'data-session-websocket-url="([^"]+)"', page)
        assert socket_url is not None
        async with browser.ws_connect(f"{socket_url[1]}?width=80&height=24") as terminal:
            await _until(terminal, b"Ford Granada")  # from its status
            await terminal.send_json(["stdin", "\x1bOP"])  # F1
            await _until(terminal, b"Help")


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
                url = re.match(r"open (http://127\.0\.0\.1:\d+) in a browser", said)
                assert url is not None, said
                assert not url[1].endswith(":8000")
                asyncio.run(_seen_by_a_browser(url[1]))
                server.send_signal(signal.SIGINT)
                assert server.wait(PATIENCE_S) == 0
                assert "Traceback" not in server.stderr.read()
            finally:
                server.kill()
                end_recorder(tmp_path)
