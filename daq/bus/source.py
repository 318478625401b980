"""Defines the protocol of a frame source, and the losses between the wire and the recorder.

Sources only read and stamp frames.  They run in separate threads; if one is kept from reading,
frames are lost in the adapter.
"""

from __future__ import annotations

import socket
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Protocol

from dbc.frames import FrameBatch

from ..runs import Losses

BLOCK_FRAMES = 2048
"""Largest number of frames that a source returns at once."""
GATHER_S = 0.01
"""Time, s, for which a source waits for more frames after the first: the cost of a block is shared
by all frames in it, and each frame still has its own time of arrival."""
LONG_GATHER_S = 0.06
"""Time, s, as `GATHER_S`, for interfaces where the kernel stamps and holds the frames in a buffer
of our size: a block of a full bus then has 540 frames."""


@dataclass(frozen=True, slots=True)
class SourceLosses:
    """Losses of a source since it was opened."""

    dropped: int = 0
    """Number of frames that the interface reports as lost before they could be read."""
    garbled: int = 0
    """Number of pieces of input that are not a frame."""
    restamped: int = 0
    """Number of frames with an impossible time stamp, which were stamped on arrival instead."""

    def plus(self, other: SourceLosses) -> SourceLosses:
        """Return the sum of both."""
        return SourceLosses(
            self.dropped + other.dropped,
            self.garbled + other.garbled,
            self.restamped + other.restamped,
        )


@dataclass(frozen=True, slots=True)
class HopLosses:
    """Cumulative counts from the wires to the journal, over all sources; stored with each block."""

    bus_dropped: int = 0
    """Sum of `SourceLosses.dropped`."""
    bus_garbled: int = 0
    """Sum of `SourceLosses.garbled`."""
    restamped: int = 0
    """Sum of `SourceLosses.restamped`."""
    queue_dropped: int = 0
    """Number of frames that were read but not recorded because the writer was too far behind."""

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """The counts in the order of the fields; `dataclasses.astuple` takes ten times as long."""
        return self.bus_dropped, self.bus_garbled, self.restamped, self.queue_dropped

    @property
    def of_a_run(self) -> Losses:
        """The lost frames, as losses of a run."""
        return Losses(
            bus_dropped=self.bus_dropped,
            bus_garbled=self.bus_garbled,
            queue_dropped=self.queue_dropped,
        )

    def since(self, before: HopLosses) -> HopLosses:
        """Return the losses since an earlier count."""
        lost = zip(self.counts, before.counts, strict=True)
        return HopLosses(*(now - then for now, then in lost))


@dataclass(frozen=True, slots=True)
class LinkFacts:
    """State of the link to one bus; a source that fails is opened again (`daq.bus.link`)."""

    name: str
    """Name of the bus for the operator."""
    bitrate: int
    """Configured bit rate, bit/s."""
    connected: bool
    """True while a source is open."""
    error: str
    """Reason why no source is open; empty while connected."""
    advice: str
    """Advice for the operator; empty while connected."""
    heartbeat_s: float
    """Monotonic time of the reader's last cycle, s; before the first, of its creation."""
    reopened: int
    """Number of times the bus came back."""
    losses: SourceLosses
    """Sum over all sources opened until now."""
    interface_down: bool = False
    """True if a source is open on an interface that was taken down."""


class FrameSource(Protocol):
    """A bus read in blocks.

    `read` and `close` belong to one thread at a time; `losses` may be called from any.
    """

    @property
    def name(self) -> str:
        """Name of the bus for the operator."""

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames received; wait up to `timeout_s` for the first.

        Raises BusError if the bus is lost.  Frames read before that have been returned.
        """

    def losses(self) -> SourceLosses:
        """Return the losses since the source was opened."""

    def close(self) -> None:
        """Release the interface; never raises."""


# Sizes the buffer of a bus that is a socket, and counts the datagrams that it had no room for -----

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
    for option in (
        (socket.SO_RCVBUF, _SO_RCVBUFFORCE) if sys.platform == "linux" else (socket.SO_RCVBUF,)
    ):
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


@contextmanager
def socket_of(fileno: Callable[[], int]) -> Iterator[socket.socket]:
    """Lend the socket of a bus; raises any exception if it has none."""
    sock = socket.socket(fileno=fileno())
    try:
        yield sock
    finally:
        sock.detach()  # the descriptor belongs to the bus


class SocketDrops:
    """Counts the drops of one socket since construction; 0 if the system does not count them.

    `fileno`: returns the descriptor of the socket; may raise any exception if there is none.
    """

    def __init__(self, fileno: Callable[[], int]) -> None:
        self._fileno = fileno
        self._before: int | None = None
        self._last = 0
        with suppress(Exception), socket_of(fileno) as sock:
            self._before = drop_counter(sock)

    def count(self) -> int:
        """Return the number of datagrams dropped; of a closed socket, the last known number."""
        if self._before is not None:
            with suppress(Exception), socket_of(self._fileno) as sock:
                if (now := drop_counter(sock)) is not None:
                    self._last = (now - self._before) % (1 << 32)
        return self._last
