"""Counts the datagrams that the kernel drops because nobody reads a socket fast enough."""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Callable
from contextlib import suppress

_SO_MEMINFO = 55
"""Option that returns numbers of 32 bits (Linux since 4.12); Python's `socket` does not name it."""
_COUNTS = struct.Struct("=9I")
_DROPS = 8
"""Place of the dropped datagrams among them (SK_MEMINFO_DROPS)."""


class SocketDrops:
    """The drops of one socket since this was made; 0 where the system does not count them.

    `fileno`: returns the descriptor of the socket; may raise any exception if there is none.
    """

    def __init__(self, fileno: Callable[[], int]) -> None:
        self._socket: socket.socket | None = None
        self._before = self._last = 0
        with suppress(Exception):  # no socket, no descriptor, not implemented, another system
            self._socket = socket.socket(fileno=os.dup(fileno()))
            self._before = self._read(self._socket)

    def count(self) -> int:
        """Return the number of datagrams dropped."""
        if self._socket is not None:
            with suppress(OSError):
                # The kernel's counter has 32 bits and begins anew.
                self._last = (self._read(self._socket) - self._before) % (1 << 32)
        return self._last

    def close(self) -> None:
        """Let the socket go; the count stays."""
        self.count()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    @staticmethod
    def _read(end: socket.socket) -> int:
        raw = end.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _COUNTS.size)
        return int(_COUNTS.unpack(raw)[_DROPS])
