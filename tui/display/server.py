"""Serves the page, its state as server-sent events, and the orders of its buttons.

A client process of the recorder: it reads what is published and holds nothing up.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping
from contextlib import aclosing, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from aiohttp import web

from daq.control import Hello, OrderRefusedError

from ..browser.guard import Guard
from ..terminal.state.feed import Feed
from .buttons import order_of
from .control import Control, NoControlError
from .follow import Follower
from .hub import Hub

MOST_PAGES = 32
"""Most pages at a time; a further one is refused and tries again."""
STALLED_S = 10.0
"""Time after which a page that takes nothing is disconnected, s."""
_MOST_BYTES = 1_000
"""Largest body of an order, bytes."""
_COOKIE = "bumpbench_control"
_FILES = Path(__file__).with_name("page")
_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self'; manifest-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; require-trusted-types-for 'script'; trusted-types 'none'"
)
"""Content security policy: nothing from other servers, no inline script or style, no text that
becomes markup."""


class DisplayServer:
    """The page of one recorder.

    `guard`: admits requests.  `folder`: folder of the recorder.  `name`: name for the journal of
    the person who gives orders.  `control`: None for a display without control.
    """

    def __init__(
        self, guard: Guard, feed: Feed, folder: Path, name: str, control: Control | None
    ) -> None:
        self._guard, self._feed, self._name, self._control = guard, feed, name, control
        self._hub = Hub()
        self._follower = Follower(feed, folder, self._hub)
        self._orders = asyncio.Lock()

    async def serve(
        self, host: str, port: int, ended: asyncio.Event, listening: Callable[[], object]
    ) -> None:
        """Serve until `ended` is set; `listening` is called once pages can be opened."""
        pages = web.Application()
        pages.on_response_prepare.append(_add_policy)
        pages.router.add_get("/events", self._events)
        pages.router.add_post("/control", self._grant)
        pages.router.add_post("/order", self._order)
        for path in sorted(_FILES.iterdir()):
            place = "/" if path.name == "index.html" else f"/{path.name}"
            pages.router.add_get(place, _file(path))
        guarded = self._guard.application(pages, _MOST_BYTES)
        runner = web.AppRunner(guarded, access_log=None, shutdown_timeout=0.5)
        await runner.setup()
        try:
            await web.TCPSite(runner, host, port).start()
            self._follower.start()
            listening()
            await ended.wait()
        finally:
            self._hub.close()
            await asyncio.to_thread(self._feed.stop)
            await runner.cleanup()

    async def _events(self, request: web.Request) -> web.StreamResponse:
        if self._hub.pages >= MOST_PAGES:
            return web.Response(status=503, text=f"{MOST_PAGES} displays are connected\n")
        stream = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
        role = {"control": self._control is not None, "granted": self._granted(request)}
        async with aclosing(self._hub.messages()) as messages:
            with suppress(ConnectionResetError, TimeoutError):  # the page has gone
                await stream.prepare(request)
                await stream.write(b"event: role\ndata: %s\n\n" % json.dumps(role).encode())
                async for message in messages:
                    async with asyncio.timeout(STALLED_S):
                        await stream.write(message)
        return stream

    async def _grant(self, request: web.Request) -> web.Response:
        """Give a page control for the number that is shown at the terminal."""
        body = await _body(request)
        if self._control is None or body is None:
            return _refused(403, "this display only looks on")
        try:
            key = self._control.grant(str(body.get("number", "")), time.monotonic())
        except NoControlError as error:
            return _refused(403, str(error))
        answer = web.json_response({})
        path = f"{self._guard.prefix}/"
        answer.set_cookie(_COOKIE, key, path=path, httponly=True, samesite="Strict")
        return answer

    async def _order(self, request: web.Request) -> web.Response:
        """Carry out the order of a button."""
        body = await _body(request)
        if body is None or not self._granted(request):
            return _refused(403, "enter the number that is shown at the terminal")
        button, label = str(body.get("button", "")), str(body.get("label", ""))
        async with self._orders:
            status = self._follower.status
            order = order_of(button, label, status) if status is not None else None
            if order is None:
                return _refused(409, "that is over: look at the page again")
            try:
                await self._feed.ask(Hello(self._name, True, body.get("take_over") is True))
            except OrderRefusedError as error:
                return _refused(423, str(error))
            try:
                await self._feed.ask(order)
            except OrderRefusedError as error:
                return _refused(409, str(error))
        return web.json_response({})

    def _granted(self, request: web.Request) -> bool:
        key = request.cookies.get(_COOKIE, "")
        return self._control is not None and self._control.holds(key)


async def _body(request: web.Request) -> Mapping[str, Any] | None:
    """Return the JSON object of a request; None if it is not one, or names no page of ours."""
    if request.headers.get("Origin") is None or request.content_type != "application/json":
        return None
    try:
        found = await request.json()
    except ValueError:
        return None
    return MappingProxyType(found) if isinstance(found, dict) else None


def _file(path: Path) -> Any:
    text, kind = path.read_text("utf-8"), _TYPES[path.suffix]

    async def send(_: web.Request) -> web.Response:
        return web.Response(text=text, content_type=kind)

    return send


def _refused(code: int, text: str) -> web.Response:
    return web.json_response({"error": text}, status=code)


async def _add_policy(_: web.Request, response: web.StreamResponse) -> None:
    response.headers["Content-Security-Policy"] = _POLICY
