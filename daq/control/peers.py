"""Who is connected to the recorder, and who of them is in control."""

from __future__ import annotations

import os

from ..errors import printable
from .orders import Hello

LEASE_S = 5.0
"""Who has not been heard for so long is gone."""
DEAD_S = 1.0
"""The same if its process has ended as well: a new terminal is not to wait for a dead one."""


class Peers:
    """The clients that were heard of lately.

    A client's id begins with the number of its process: all clients are on this machine.
    Control is only lost to somebody who asks for it, so a terminal that was held up goes on.
    """

    def __init__(self) -> None:
        self._names: dict[str, str] = {}
        self._seen_s: dict[str, float] = {}
        self._controller = ""

    def seen(self, client: str, now_s: float) -> None:
        """Note that a client lives, and forget those that do not."""
        self._seen_s[client] = now_s
        for other in [c for c, seen_s in self._seen_s.items() if now_s - seen_s > LEASE_S]:
            if other != self._controller:
                self._seen_s.pop(other)
                self._names.pop(other, None)

    def hello(self, client: str, hello: Hello, now_s: float) -> str:
        """Let a client in as controller or viewer; return why not, or an empty text."""
        self._names[client] = printable(hello.name, 60)
        if not hello.control:
            if client == self._controller:
                self._controller = ""
            return ""
        holder = self.controller(now_s)
        if holder and self._controller != client and not hello.take_over:
            self._seen_s.pop(client, None)
            self._names.pop(client)
            return f"{holder} is in control (take over, or look on)"
        self._controller = client
        return ""

    def in_control(self, client: str) -> bool:
        """Whether this client may give orders."""
        return client == self._controller

    def controller(self, now_s: float) -> str:
        """Return the name of who is in control; empty if nobody, or if that one is gone."""
        client = self._controller
        if not client:
            return ""
        silent_s = now_s - self._seen_s.get(client, now_s)
        if silent_s > LEASE_S or (silent_s > DEAD_S and not _lives(client)):
            return ""
        return self.name(client)

    def viewers(self, now_s: float) -> int:
        """Return how many look on."""
        alive = [c for c, seen_s in self._seen_s.items() if now_s - seen_s <= LEASE_S]
        return len(alive) - (self._controller in alive)

    def name(self, client: str) -> str:
        """Return the name that a client gave, or its id."""
        return self._names.get(client) or printable(client, 60)


def _lives(client: str) -> bool:
    """Whether the process of a client runs; one that cannot be seen is taken to."""
    number = client.partition("-")[0]
    if not (number.isascii() and number.isdigit()):
        return True
    try:
        os.kill(int(number), 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
