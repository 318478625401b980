"""Keeps the clients of a recorder, and which of them is in control."""

from __future__ import annotations

import os

from ..errors import printable
from .orders import Hello

LEASE_S = 5.0
"""Time without a message, s, after which a client counts as gone."""
DEAD_S = 1.0
"""Time without a message, s, after which a client whose process has ended counts as gone: a new
terminal must not wait for a dead one."""


class Peers:
    """The clients that have recently sent a message.

    A client's id begins with the number of its process: all clients are on this machine.  A client
    loses control only to one that asks for it, so a terminal that was delayed keeps it.
    """

    def __init__(self) -> None:
        self._names: dict[str, str] = {}
        self._seen_s: dict[str, float] = {}
        self._controller = ""

    def seen(self, client: str, now_s: float) -> None:
        """Note a message of a client, and forget clients that are gone."""
        self._seen_s[client] = now_s
        for other in [c for c, seen_s in self._seen_s.items() if now_s - seen_s > LEASE_S]:
            if other != self._controller:
                self._seen_s.pop(other)
                self._names.pop(other, None)

    def hello(self, client: str, hello: Hello, now_s: float) -> str:
        """Admit a client as controller or viewer; return why it is refused, or an empty text."""
        self._names[client] = printable(hello.name, 60)
        if not hello.control:
            if client == self._controller:
                self._controller = ""
            return ""
        holder = self.controller(now_s)
        if holder and self._controller != client and not hello.take_over:
            self._seen_s.pop(client, None)
            self._names.pop(client)
            return f"{holder} is in control (take over, or only watch)"
        self._controller = client
        return ""

    def in_control(self, client: str) -> bool:
        """Return whether this client may send orders."""
        return client == self._controller

    def controller(self, now_s: float) -> str:
        """Return the name of the client in control; empty if there is none or it is gone."""
        client = self._controller
        if not client:
            return ""
        silent_s = now_s - self._seen_s.get(client, now_s)
        if silent_s > LEASE_S or (silent_s > DEAD_S and not _lives(client)):
            return ""
        return self.name(client)

    def viewers(self, now_s: float) -> int:
        """Return the number of clients that only watch."""
        alive = [c for c, seen_s in self._seen_s.items() if now_s - seen_s <= LEASE_S]
        return len(alive) - (self._controller in alive)

    def name(self, client: str) -> str:
        """Return the name that a client gave, or its id."""
        return self._names.get(client) or printable(client, 60)


def _lives(client: str) -> bool:
    """Return whether the process of a client runs; True if this cannot be determined."""
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
