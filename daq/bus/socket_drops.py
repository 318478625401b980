"""Counts the datagrams that the kernel drops because a socket is not read fast enough."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable
from contextlib import suppress

_SO_MEMINFO = 55
"""Socket option that returns 32-bit numbers (Linux since 4.12); Python's `socket` does not define
it."""
_COUNTS = struct.Struct("=9I")
_DROPS = 8
"""Position of the number of dropped datagrams among them (SK_MEMINFO_DROPS)."""


def drop_counter(sock: socket.socket) -> int | None:
    """Return a socket's counter of dropped datagrams, modulo 2^32; None if the kernel has none.

    The counter in a CAN frame was read when the frame was queued: without this function, frames
    dropped at the end of a burst would stay unknown until the next frame.
    """
    try:
        raw = sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _COUNTS.size)
    except OSError:
        return None
    return int(_COUNTS.unpack(raw)[_DROPS]) if len(raw) == _COUNTS.size else None


class SocketDrops:
    """Counts the drops of one socket since construction; 0 if the system does not count them.

    `fileno`: returns the descriptor of the socket; may raise any exception if there is none.
    """

    def __init__(self, fileno: Callable[[], int]) -> None:
        self._fileno = fileno
        self._last = 0
        self._before: int | None = None
        with suppress(Exception):  # no socket, no descriptor, not implemented, another system
            self._before = self._read()

    def count(self) -> int:
        """Return the number of datagrams dropped; of a closed socket, the last known number."""
        if self._before is not None:
            with suppress(Exception):
                if (now := self._read()) is not None:
                    self._last = (now - self._before) % (1 << 32)
        return self._last

    def _read(self) -> int | None:
        end = socket.socket(fileno=self._fileno())
        try:
            return drop_counter(end)
        finally:
            end.detach()  # the descriptor belongs to the bus
