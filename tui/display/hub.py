"""Sends the newest state to every page; one that does not read misses states, and delays none.

Only the newest message of each topic is kept, once for all pages.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator

BEAT_S = 1.0
"""Longest time between two messages, s: a page that has heard nothing for three of them reports
the line lost."""


class Hub:
    """The newest message of each topic, numbered; all calls in one event loop."""

    def __init__(self) -> None:
        self._messages: dict[str, tuple[int, bytes]] = {}
        self._number = 0
        self._waiting: set[asyncio.Event] = set()
        self._closed = False

    @property
    def pages(self) -> int:
        """Number of pages that are connected."""
        return len(self._waiting)

    def post(self, topic: str, data: bytes) -> None:
        """Keep a message as the newest of its topic, and wake the pages if it has changed."""
        if topic in self._messages and self._messages[topic][1] == data:
            return
        self._number += 1
        self._messages[topic] = self._number, data
        for event in self._waiting:
            event.set()

    def close(self) -> None:
        """End what all pages read."""
        self._closed = True
        for event in self._waiting:
            event.set()

    async def messages(self) -> AsyncGenerator[bytes, None]:
        """Yield server-sent events: first all topics, then changed ones, and heartbeats."""
        fresh = asyncio.Event()
        self._waiting.add(fresh)
        seen = 0
        try:
            while not self._closed:
                fresh.clear()
                newer = [(n, t, data) for t, (n, data) in self._messages.items() if n > seen]
                seen = self._number
                if newer:
                    yield b"".join(_event(topic, data) for _, topic, data in sorted(newer))
                try:
                    async with asyncio.timeout(BEAT_S):
                        await fresh.wait()
                except TimeoutError:
                    yield _event("beat", b"")
        finally:
            self._waiting.discard(fresh)


def _event(topic: str, data: bytes) -> bytes:
    return b"event: %s\ndata: %s\n\n" % (topic.encode(), data)
