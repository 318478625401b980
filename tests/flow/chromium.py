"""A headless Chromium, spoken to in its own protocol: no library is needed for that."""

from __future__ import annotations

import asyncio
import base64
import shutil
import subprocess
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, cast

import aiohttp

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


class Tab:
    """One page of a browser, of a size of its own."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket, self._number = socket, 0
        self.requested: list[str] = []
        """Addresses that the page has asked for."""

    async def order(self, method: str, **parameters: object) -> dict[str, Any]:
        """Send an order and return its result."""
        self._number += 1
        await self._socket.send_json({"id": self._number, "method": method, "params": parameters})
        while True:
            message = await self._socket.receive_json(timeout=60.0)
            if message.get("method") == "Network.requestWillBeSent":
                self.requested.append(message["params"]["request"]["url"])
            if message.get("id") == self._number:
                assert "error" not in message, message
                return cast("dict[str, Any]", message["result"])

    async def open(self, link: str, width: int, height: int) -> None:
        """Open a page in a window of this size."""
        await self.order("Network.enable")
        await self.order(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        await self.order("Page.navigate", url=link)

    async def value(self, expression: str) -> Any:
        """Return the value of an expression in the page."""
        found = await self.order("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    async def press(self, keys: str) -> None:
        """Press one key after the other, without a click before."""
        for key in keys:
            for kind in ("keyDown", "keyUp"):
                await self.order("Input.dispatchKeyEvent", type=kind, key=key, text=key)

    async def picture(self, path: Path) -> None:
        """Store what the window shows as PNG."""
        await self.order("Page.bringToFront")  # no other tab is drawn
        found = await self.order("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(found["data"]))


@asynccontextmanager
async def tabs(count: int) -> AsyncIterator[list[Tab]]:
    """Start a browser with so many empty tabs, and end it."""
    program = next((found for name in NAMES if (found := shutil.which(name))), None)
    assert program is not None, f"none of {', '.join(NAMES)} is installed"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [program, "--headless=new", "--no-sandbox", "--remote-debugging-port=0",
             f"--user-data-dir={profile}", "--no-first-run", "--disable-renderer-backgrounding",
             "--disable-background-timer-throttling", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            port = await _port(Path(profile) / "DevToolsActivePort")
            async with aiohttp.ClientSession(f"http://127.0.0.1:{port}") as http:
                made = []
                for _ in range(count):
                    async with http.put("/json/new?about:blank") as answer:
                        place = (await answer.json())["webSocketDebuggerUrl"]
                    made.append(Tab(await http.ws_connect(place, max_msg_size=0)))
                yield made
        finally:
            process.terminate()
            process.wait(20.0)


async def _port(path: Path) -> int:
    async with asyncio.timeout(60.0):
        while not path.exists() or not path.read_text().strip():
            await asyncio.sleep(0.1)
    return int(path.read_text().splitlines()[0])
