"""Sizes the buffer of a bus that is a socket, and counts the datagrams that it had no room for."""

from __future__ import annotations

import socket
import struct
import sys
from collections.abc import Callable
from contextlib import suppress

RECEIVE_BUFFER_BYTES = 8 << 20
"""Receive buffer requested from the kernel, bytes: about 21,900 frames, 2.4 s of a full bus of 1
Mbit/s; the default one holds 31 ms."""
_SO_RCVBUFFORCE, _SO_MEMINFO = 33, 55
_IP_MULTICAST_ALL, _IPV6_MULTICAST_ALL = 49, 29
_STRAY_DATAGRAMS = 10_000
"""Datagrams that a multicast socket may have received while it was opened: no buffer holds more."""
_COUNTS = struct.Struct("=9I")
_DROPS = 8
"""Position of the number of dropped datagrams in what SO_MEMINFO returns (SK_MEMINFO_DROPS)."""


def enlarge_buffer(sock: socket.socket) -> int:
    """Ask for `RECEIVE_BUFFER_BYTES` and return what the kernel grants, bytes.

    More than `net.core.rmem_max` needs a privilege.
    """
    options = (socket.SO_RCVBUF, *((_SO_RCVBUFFORCE,) if sys.platform == "linux" else ()))
    for option in options:
        with suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, option, RECEIVE_BUFFER_BYTES)
    # The kernel doubles the size for its own bookkeeping, and returns the double.
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2


def keep_to_own_group(sock: socket.socket) -> None:
    """Make a multicast socket receive its own group only, and begin empty.

    By default it receives every group that any process of this machine has joined; frames of other
    groups may have arrived while it was opened.
    """
    if sys.platform != "linux" or sock.family not in (socket.AF_INET, socket.AF_INET6):
        return
    level, option = socket.IPPROTO_IP, _IP_MULTICAST_ALL
    if sock.family == socket.AF_INET6:
        level, option = socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL
    with suppress(OSError):
        sock.setsockopt(level, option, 0)
    with suppress(OSError):  # until none waits; a busy bus never ends
        for _ in range(_STRAY_DATAGRAMS):
            sock.recv(1, socket.MSG_DONTWAIT)


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
        own = socket.socket(fileno=self._fileno())
        try:
            return drop_counter(own)
        finally:
            own.detach()  # the descriptor belongs to the bus
