"""A headless Chromium, spoken to in its own protocol, and axe-core in its pages."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import cache
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


# The accessibility engine axe-core; npm fetches it where it is run --------------------------------

PACKAGE = "axe-core@4.12.1"
SERIOUS = ("serious", "critical")
RUN = """axe.run().then(found => JSON.stringify(
    found.violations.map(v => [v.impact, v.id, v.nodes[0].html.slice(0, 200)])))"""


@cache
def source() -> str:
    """Return the script of axe-core; raises CalledProcessError if npm cannot fetch it."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["npm", "pack", PACKAGE, "--silent"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        (packed,) = Path(folder).glob("*.tgz")
        with tarfile.open(packed) as archive:
            script = archive.extractfile("package/axe.min.js")
            assert script is not None
            return script.read().decode()


async def assert_accessible(tab: Tab, where: str) -> None:
    """Raise AssertionError if axe finds anything serious in what a page shows now."""
    await tab.value(f"if (!window.axe) {{ {source()} }}")
    answer = await tab.order("Runtime.evaluate", expression=RUN, awaitPromise=True)
    found = json.loads(answer["result"]["value"])
    serious = [violation for violation in found if violation[0] in SERIOUS]
    assert not serious, f"{where}: {serious}"
