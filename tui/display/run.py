"""Runs a display (follower, guard, server) until it is ended."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ..browser.guard import Guard
from ..terminal.state.feed import RecorderFeed
from .control import Control
from .link import address_of, host_in_link, port_of
from .served import Served
from .server import DisplayServer


def run_display(
    folder: Path,
    host: str,
    name: str,
    control: bool,
    announce: Callable[[Served, Callable[[], object]], None],
) -> None:
    """Serve the display of a folder's recorder until Ctrl-C or SIGTERM.

    `host`: as of `address_of`.  `announce`: called once with the link, and with a function that
    ends the display from any thread.  Raises InputError if it cannot listen there.
    """
    address = address_of(host)
    port = port_of(address)
    guard = Guard(host_in_link(address), port)
    granted = Control() if control else None
    feed = RecorderFeed(folder, name, lambda: None, control=False)

    async def serve() -> None:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        failures: list[BaseException] = []

        def fail(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            # A page that went on without its recorder would show an old state as the present one.
            failures.append(context.get("exception") or RuntimeError(context["message"]))
            ended.set()

        loop.set_exception_handler(fail)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(ended.set))
        secret = granted.secret if granted else ""
        served = Served(guard.link, address, secret)
        server = DisplayServer(guard, feed, folder, name, granted)
        end = partial(loop.call_soon_threadsafe, ended.set)
        await server.serve(address, port, ended, partial(announce, served, end))
        if failures:
            raise failures[0]

    asyncio.run(serve())
