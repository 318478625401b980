"""Reads SocketCAN at full speed: many frames with one system call, directly into arrays.

python-can reads one frame at a time and makes an object of it, leaves the socket's buffer at 31 ms
of a full bus, and does not count the frames that did not fit.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
import socket
import threading
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from ...errors import BusError
from ..socket_drops import drop_counter
from ..source import BLOCK_FRAMES, GATHER_S, LONG_GATHER_S, SourceLosses
from ..steady_clock import STEADY_CLOCK, SteadyClock
from . import abi as abi
from . import hardware_clock
from .messages import frame_columns

RECEIVE_BUFFER_BYTES = 8 << 20
"""Receive buffer requested from the kernel, bytes: about 21,900 frames, 2.4 s of a full bus of 1
Mbit/s."""
_ALL_ERRORS = 0x1FFFFFFF


class StampClock(StrEnum):
    """The clock that stamps the frames of a source."""

    UNKNOWN = "unknown"
    """No frame was received yet."""
    HARDWARE = "hardware"
    """The adapter's clock, when the frame is on the wire; see
    `daq.bus.socketcan.hardware_clock`."""
    KERNEL = "kernel"
    """The kernel's clock, when the driver delivers the frame."""
    ARRIVAL = "arrival"
    """This process's clock, when the block is read."""


@dataclass(frozen=True, slots=True)
class Reception:
    """The clock and the buffer of a source."""

    clock: StampClock
    """The clock of the latest stamps."""
    buffer_bytes: int
    """Size of the buffer, bytes."""

    @property
    def clipped(self) -> bool:
        """True if the kernel grants a smaller buffer than `RECEIVE_BUFFER_BYTES`.

        A larger one needs the privilege CAP_NET_ADMIN or a larger `net.core.rmem_max`.
        """
        return self.buffer_bytes < RECEIVE_BUFFER_BYTES


class SocketCanSource:
    """An open CAN_RAW socket read in blocks.

    For some milliseconds after the first socket with stamps was opened, the kernel stamps frames
    only when they are read.  Unlike other sources it may be closed while another thread is reading;
    `read` then returns at once.

    `sock`: bound to one interface; closed by `close`.  `name`: name of the bus in messages.
    `index`: number of the bus in its frames.  `steady_clock`: converts the kernel's stamps, and
    stamps frames that have none.
    """

    def __init__(
        self,
        sock: socket.socket,
        name: str,
        index: int,
        steady_clock: SteadyClock = STEADY_CLOCK,
    ) -> None:
        self.name = name
        self._socket = sock
        self._index = index
        self._steady_clock = steady_clock
        self._clock = StampClock.UNKNOWN
        self._down = self._older = False
        self._buffer_bytes = _prepare(sock)
        self._gather_s = GATHER_S if self.reception.clipped else LONG_GATHER_S
        self._buffers = abi.FrameBuffers(BLOCK_FRAMES)
        self._reading, self._closing = threading.Lock(), threading.Lock()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._arrival, self._halt = select.poll(), select.poll()
        self._arrival.register(sock, select.POLLIN)
        for poll in (self._arrival, self._halt):
            poll.register(self._wake, select.POLLIN)
        self._closed = False
        self._more = False
        self._fault: OSError | None = None
        self._adapter: hardware_clock.HardwareClock | None = None
        self._losses = SourceLosses()
        self._drop_counter = 0

    def read(self, timeout_s: float) -> FrameBatch:
        """Return a block of at most `BLOCK_FRAMES` frames; see `FrameSource`.

        An interface that is taken down raises no error: the socket receives again once it is up.
        """
        with self._reading:
            if self._closed:
                raise BusError(self.name, "has been closed", "open it again")
            if not (self._more or self._fault):
                self._wait(timeout_s)
            count = self._receive()
            self._more = count == BLOCK_FRAMES
            older, self._older = self._older, self._older and self._more
            if count:
                return self._batch(count, older)
            self._count_drops(drop_counter(self._socket))
            if self._fault:
                raise BusError(
                    self.name,
                    f"has gone: {self._fault.strerror}",
                    "check plug and power, then start again",
                ) from self._fault
            return FrameBatch.empty()

    def losses(self) -> SourceLosses:
        """Return the losses; frames lost within the adapter are reported by error frames."""
        return self._losses

    @property
    def reception(self) -> Reception:
        """The clock and the buffer in use."""
        return Reception(self._clock, self._buffer_bytes)

    @property
    def interface_down(self) -> bool:
        """True if the interface was taken down and no frame has come since."""
        return self._down

    def close(self) -> None:
        """Wake a thread that is reading and close the socket."""
        if not self._closing.acquire(blocking=False):
            return
        os.eventfd_write(self._wake, 1)
        with self._reading:
            self._closed = True
            self._socket.close()
            os.close(self._wake)

    def _wait(self, timeout_s: float) -> None:
        """Wait for the first frame, then for others to join it."""
        if self._arrival.poll(math.ceil(max(timeout_s, 0.0) * 1e3)):
            self._halt.poll(self._gather_s * 1e3)

    def _receive(self) -> int:
        """Fill the buffers and return the number of datagrams.

        The kernel returns a fault before the frames that were queued earlier, so a second attempt
        follows a fault.
        """
        for _ in range(2):
            try:
                return self._buffers.receive(self._socket.fileno())
            except (BlockingIOError, InterruptedError):
                return 0
            except OSError as error:
                if error.errno == errno.ENETDOWN:
                    self._down = self._older = True
                else:
                    self._fault = error
        return 0

    def _batch(self, count: int, older: bool) -> FrameBatch:
        datagrams = self._buffers.datagrams(count)
        self._count_drops(datagrams.ancillary.dropped)
        t_ns, stamped = self._stamps(datagrams.ancillary)
        batch, good = frame_columns(datagrams, t_ns, self._index)
        garbled = count - len(batch)
        restamped = int(np.count_nonzero(good > stamped))
        if garbled or restamped:
            self._losses = replace(
                self._losses,
                garbled=self._losses.garbled + garbled,
                restamped=self._losses.restamped + restamped,
            )
        if len(batch) and not older:  # older frames, queued before, do not mean that it is up
            self._down = False
        return batch

    def _stamps(self, ancillary: abi.Ancillary) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the best stamp of each frame, and a mask of stamps from before the reading."""
        stamped = ancillary.kernel_ns != 0
        t_ns = self._steady_clock.from_wall(ancillary.kernel_ns)
        if np.count_nonzero(stamped) < len(stamped):
            t_ns = np.where(stamped, t_ns, self._steady_clock.now_ns())
        self._clock = StampClock.KERNEL if stamped[-1] else StampClock.ARRIVAL
        by_hardware = ancillary.hardware_ns != 0
        if np.count_nonzero(by_hardware):
            self._adapter, converted_ns = hardware_clock.advance(
                self._adapter, ancillary.hardware_ns[by_hardware], t_ns[by_hardware]
            )
            t_ns = t_ns.copy()
            t_ns[by_hardware] = converted_ns
            self._clock = StampClock.HARDWARE
        return t_ns, stamped | by_hardware

    def _count_drops(self, counter: int | None) -> None:
        """Add the advance of the socket's counter, which has 32 bits and wraps.

        A counter that came with a frame is as old as that frame, so it may be lower than the last
        one.
        """
        if counter is None:
            return
        ahead = (counter - self._drop_counter) & 0xFFFFFFFF
        if 0 < ahead < 1 << 31:
            self._drop_counter = counter
            self._losses = replace(self._losses, dropped=self._losses.dropped + ahead)


def open_socketcan(channel: str, bus: int) -> SocketCanSource:
    """Open a network interface like `can0` for classic, FD and error frames.

    `channel`: name of the interface.  `bus`: number of the bus in its frames.  Raises BusError if
    no interface is named.  Raises OSError if the kernel has no CAN or no such interface.
    """
    name = f"socketcan {channel}"
    if not channel:  # to the kernel that means all interfaces
        raise BusError(name, "names no interface", "channel is like can0; see `ip link`")
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_CLOEXEC, abi.RAW_PROTOCOL)
    with contextlib.ExitStack() as undo:
        undo.callback(sock.close)
        sock.setsockopt(abi.SOL_CAN_RAW, abi.CAN_RAW_ERR_FILTER, _ALL_ERRORS)
        with contextlib.suppress(OSError):  # a kernel that has no CAN FD
            sock.setsockopt(abi.SOL_CAN_RAW, abi.CAN_RAW_FD_FRAMES, 1)
        source = SocketCanSource(sock, name, bus)  # before `bind`, so that every frame is stamped
        undo.callback(source.close)
        sock.bind((channel,))
        undo.pop_all()
    return source


def _prepare(sock: socket.socket) -> int:
    """Ask for a large buffer, stamps and the drop counter; return the buffer granted."""
    for option, value in (
        (socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES),
        (abi.SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES),  # beyond net.core.rmem_max; needs a privilege
        (abi.SO_TIMESTAMPNS, 1),
        (abi.SO_TIMESTAMPING, abi.HARDWARE_STAMPS),
        (abi.SO_RXQ_OVFL, 1),
    ):
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, option, value)
    # The kernel doubles the size for its own bookkeeping, and returns the double.
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
