"""Serves the page, its state as server-sent events, and the orders of its buttons.

A client process of the recorder: it reads what is published and holds nothing up.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import signal
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from aiohttp import web

from daq.control.exchange import OrderRefusedError
from daq.control.messages import Hello, Status

from ..browser.server import Guard
from ..terminal.feed import Lost, News, RecorderFeed
from .link import Served, listen_on
from .view import order_of, view

TRIES = 5
"""Wrong numbers in a minute after which none is accepted: to try a million then takes 140 days."""
_COOKIE = "bumpbench_control"
_FILES = Path(__file__).with_name("page")
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self'; manifest-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; require-trusted-types-for 'script'; trusted-types 'none'"
)
"""Content security policy: nothing from other servers, no inline script or style, no text that
becomes markup."""


def run_display(
    folder: Path,
    host: str,
    name: str,
    control: bool,
    announce: Callable[[Served, Callable[[], object]], None],
) -> None:
    """Serve the display of a folder's recorder until Ctrl-C or SIGTERM.

    `host`: as of `listen_on`.  `announce`: called once with the link, and with a function that ends
    the display from any thread.  Raises InputError if it cannot listen there.
    """
    address, listening = listen_on(host)
    guard = Guard(address, listening)
    feed = RecorderFeed(folder, name, lambda: None, control=False)
    server = DisplayServer(guard, feed, name, Control() if control else None)

    async def serve() -> None:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        failures: list[BaseException] = []

        def end_by_failure(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            if {"socket", "transport", "protocol"} & context.keys():
                return  # the end of a connection, by either side
            # A page that went on without its recorder would show an old state as the present one.
            failures.append(context.get("exception") or RuntimeError(context["message"]))
            ended.set()

        loop.set_exception_handler(end_by_failure)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(ended.set))
        served = Served(guard.link, address, server.secret)
        end = partial(loop.call_soon_threadsafe, ended.set)
        await server.serve(ended, partial(announce, served, end))
        if failures:
            raise failures[0]

    asyncio.run(serve())


class Control:
    """A number that is shown at the terminal, and the pages on which it was typed."""

    def __init__(self) -> None:
        self.secret = f"{secrets.randbelow(10**6):06}"
        """Six digits."""
        self._wrong_s: list[float] = []
        """Times of the wrong numbers of the last minute, s."""
        self._keys: list[str] = []
        """Keys of the pages that have control."""

    def grant(self, typed: str, now_s: float) -> tuple[str, str]:
        """Return the key of a page on which the number was typed, and why it gets none.

        `now_s`: of a clock that is never set.
        """
        # Those of the last minute, as the refusal says.
        self._wrong_s = [wrong_s for wrong_s in self._wrong_s if now_s - wrong_s < 60.0]
        if len(self._wrong_s) >= TRIES:
            return "", "too many wrong numbers: wait a minute"
        digits = "".join(typed.split())
        if not secrets.compare_digest(digits.encode(errors="replace"), self.secret.encode()):
            self._wrong_s.append(now_s)
            return "", "that is not the number shown at the terminal"
        key = secrets.token_urlsafe()
        self._keys.append(key)
        return key, ""

    def holds(self, key: str) -> bool:
        """Return True if a page has control."""
        return any(secrets.compare_digest(key.encode(), known.encode()) for known in self._keys)


class Follower:
    """Turns the news of a feed into the newest state of the page; all calls in one event loop.

    Only the newest state is kept, once for all pages: a page that does not read misses states, and
    delays none.
    """

    def __init__(self, feed: RecorderFeed) -> None:
        self._feed = feed
        self._last_status: Status | None = None
        self._lost: Lost | None = None
        self._state = b""
        """The newest state as JSON."""
        self._changed = asyncio.Event()
        """Set when the state changes; then another one takes its place."""
        self._closed = False

    @property
    def status(self) -> Status | None:
        """The last status; None before the first, and while the recorder is lost."""
        return None if self._lost is not None else self._last_status

    def start(self) -> None:
        """Show that nothing is known yet, and start the feed; its thread posts news to the loop."""
        loop = asyncio.get_running_loop()

        def post(news: News) -> None:
            with suppress(RuntimeError):  # the loop has ended before the feed's thread
                loop.call_soon_threadsafe(self.take, news)

        self._make_state()
        self._feed.start(post)

    def close(self) -> None:
        """End what all pages read."""
        self._closed = True
        self._wake()

    def take(self, news: News) -> None:
        """Take in news of the recorder; only a status and a loss change the page."""
        if isinstance(news, Status):
            self._last_status, self._lost = news, None
        elif isinstance(news, Lost):
            self._lost = news
        else:
            return
        self._make_state()

    async def messages(self) -> AsyncGenerator[bytes, None]:
        """Yield server-sent events: the newest state whenever it has changed, and heartbeats."""
        sent = b""
        while not self._closed:
            changed = self._changed
            if self._state != sent:
                sent = self._state
                yield b"event: view\ndata: %s\n\n" % sent
            try:
                async with asyncio.timeout(1.0):  # s; after 3 s of silence a page says NO LINE
                    await changed.wait()
            except TimeoutError:
                yield b"event: beat\ndata: \n\n"

    def _make_state(self) -> None:
        """Make the newest state of what is known, and wake the pages that wait for it."""
        state = asdict(view(self._last_status, self._lost))
        self._state = json.dumps(state, separators=(",", ":"), allow_nan=False).encode()
        self._wake()

    def _wake(self) -> None:
        """Let all `messages` look at the state again."""
        self._changed.set()
        self._changed = asyncio.Event()


class DisplayServer:
    """The page of one recorder.

    `guard`: admits requests.  `name`: name for the journal of the person who gives orders.
    `control`: None for a display without control.
    """

    def __init__(
        self, guard: Guard, feed: RecorderFeed, name: str, control: Control | None
    ) -> None:
        self._guard, self._feed, self._name, self._control = guard, feed, name, control
        self.secret = control.secret if control else ""
        """Number that gives control; empty for a display without control."""
        self._follower = Follower(feed)
        self._orders = asyncio.Lock()

    async def serve(self, ended: asyncio.Event, announce: Callable[[], object]) -> None:
        """Serve until `ended` is set; `announce` is called once pages can be opened."""
        pages = web.Application()
        pages.on_response_prepare.append(_add_policy)
        pages.router.add_get("/events", self._events)
        pages.router.add_post("/control", self._grant)
        pages.router.add_post("/order", self._order)
        pages.router.add_get("/", _index_page)
        pages.router.add_static("/", _FILES)
        async with self._guard.serving(pages, most_bytes=1_000):  # a number, or a button
            try:
                self._follower.start()
                announce()
                await ended.wait()
            finally:
                self._follower.close()
                await asyncio.to_thread(self._feed.stop)

    async def _events(self, request: web.Request) -> web.StreamResponse:
        """Send a page its role, then the messages of the follower, until one of them ends."""
        stream = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
        role = {"control": self._control is not None, "granted": self._has_control(request)}
        async with aclosing(self._follower.messages()) as messages:
            with suppress(ConnectionResetError):  # the page has gone
                await stream.prepare(request)
                await stream.write(b"event: role\ndata: %s\n\n" % json.dumps(role).encode())
                async for message in messages:
                    await stream.write(message)
        return stream

    async def _grant(self, request: web.Request) -> web.Response:
        """Give a page control for the number that is shown at the terminal."""
        body = await _json_body(request)
        if self._control is None:
            return _refusal(403, "this display only looks on")
        if body is None:
            return _refusal(403, "that was not sent by this page")
        key, reason = self._control.grant(str(body.get("number", "")), time.monotonic())
        if reason:
            return _refusal(403, reason)
        answer = web.json_response({})
        path = f"{self._guard.prefix}/"
        answer.set_cookie(_COOKIE, key, path=path, httponly=True, samesite="Strict")
        return answer

    async def _order(self, request: web.Request) -> web.Response:
        """Carry out the order of a button."""
        body = await _json_body(request)
        if body is None or not self._has_control(request):
            return _refusal(403, "enter the number that is shown at the terminal")
        button, target = str(body.get("button", "")), str(body.get("target", ""))
        async with self._orders:
            status = self._follower.status
            order = order_of(button, target, status) if status is not None else None
            if order is None:
                return _refusal(409, "that is over: look at the page again")
            try:
                await self._feed.ask(Hello(self._name, True, body.get("take_over") is True))
            except OrderRefusedError as error:
                return _refusal(423, str(error))
            try:
                await self._feed.ask(order)
            except OrderRefusedError as error:
                return _refusal(409, str(error))
        return web.json_response({})

    def _has_control(self, request: web.Request) -> bool:
        """Return True if the number was typed on the page that sends a request."""
        key = request.cookies.get(_COOKIE, "")
        return self._control is not None and self._control.holds(key)


async def _json_body(request: web.Request) -> dict[str, Any] | None:
    """Return the JSON object of a request; None if it is not one, or names no page of ours."""
    if request.headers.get("Origin") is None or request.content_type != "application/json":
        return None
    try:
        document = await request.json()
    except ValueError:
        return None
    return document if isinstance(document, dict) else None


async def _index_page(_: web.Request) -> web.FileResponse:
    return web.FileResponse(_FILES / "index.html")


def _refusal(http_status: int, reason: str) -> web.Response:
    return web.json_response({"error": reason}, status=http_status)


async def _add_policy(_: web.Request, response: web.StreamResponse) -> None:
    response.headers["Content-Security-Policy"] = _POLICY
