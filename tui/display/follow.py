"""Follows a recorder, and sends what the page shows to every page whenever it changes.

Only the newest state is kept, once for all pages: a page that does not read misses states, and
delays none.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from daq import InputError
from daq.control.exchange import OrderRefusedError
from daq.control.messages import AskBench, Status

from ..terminal.feed import Lost, News, RecorderFeed
from .view import view

if TYPE_CHECKING:
    from daq.bench.config import Bench

BEAT_S = 1.0
"""Longest time between two messages, s: a page that has heard nothing for three of them reports
the line lost."""


class Follower:
    """Turns the news of a feed into the newest state of the page; all calls in one event loop.

    `folder`: folder of the recorder; paths in bench.toml are relative to it.
    """

    def __init__(self, feed: RecorderFeed, folder: Path) -> None:
        self._feed, self._folder = feed, folder
        self._last: Status | None = None
        self._lost: Lost | None = None
        self._bench: Bench | None = None
        self._bench_crc32: int | None = None
        """Checksum of the bench that was asked for last; None: the next status asks."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._state = b""
        """The newest state as JSON."""
        self._waiting: set[asyncio.Event] = set()
        """One event for each page, set when the state has changed."""
        self._closed = False

    @property
    def pages(self) -> int:
        """Number of pages that are connected."""
        return len(self._waiting)

    @property
    def status(self) -> Status | None:
        """The last status; None before the first, and while the recorder is lost."""
        return None if self._lost is not None else self._last

    def start(self) -> None:
        """Show that nothing is known yet, and start the feed; its thread posts news to the loop."""
        loop = asyncio.get_running_loop()

        def post(news: News) -> None:
            with suppress(RuntimeError):  # the loop has ended before the feed's thread
                loop.call_soon_threadsafe(self.take, news)

        self._show()
        self._feed.start(post)

    def close(self) -> None:
        """End what all pages read."""
        self._closed = True
        self._wake()

    def take(self, news: News) -> None:
        """Take in news of the recorder, and show them if they change the page."""
        match news:
            case Status():
                self._last, self._lost = news, None
                if news.bench_crc32 != self._bench_crc32:
                    self._bench_crc32 = news.bench_crc32
                    task = asyncio.get_running_loop().create_task(self._ask_bench())
                    self._tasks.add(task)  # the loop itself keeps no reference to it
                    task.add_done_callback(self._tasks.discard)
            case Lost():
                self._lost, self._bench_crc32 = news, None
            case _:
                return
        self._show()

    async def messages(self) -> AsyncGenerator[bytes, None]:
        """Yield server-sent events: the newest state whenever it has changed, and heartbeats."""
        changed = asyncio.Event()
        self._waiting.add(changed)
        sent = b""
        try:
            while not self._closed:
                changed.clear()
                if self._state != sent:
                    sent = self._state
                    yield b"event: view\ndata: %s\n\n" % sent
                try:
                    async with asyncio.timeout(BEAT_S):
                        await changed.wait()
                except TimeoutError:
                    yield b"event: beat\ndata: \n\n"
        finally:
            self._waiting.discard(changed)

    async def _ask_bench(self) -> None:
        """Ask for the bench.toml in force, which has the sketch, and show it."""
        from daq.bench.config import parse_bench

        try:
            text = (await self._feed.ask(AskBench())).bench_text
            self._bench = parse_bench(text, "bench.toml", self._folder, dbc_text="")
        except (OrderRefusedError, InputError):
            self._bench_crc32 = None  # the next status asks again
            return
        self._show()

    def _show(self) -> None:
        state = asdict(view(self._last, self._lost, self._bench))
        self._state = json.dumps(state, separators=(",", ":"), allow_nan=False).encode()
        self._wake()

    def _wake(self) -> None:
        for event in self._waiting:
            event.set()
