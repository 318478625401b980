"""Reads SocketCAN at full speed, and sizes and watches the sockets of any bus.

Many frames are read with one system call, directly into arrays.  python-can makes an object of each
frame, leaves the socket's buffer at 31 ms of a full bus, and does not count the frames that did not
fit.  Layouts and numbers are those of linux/can.h, linux/can/raw.h, linux/net_tstamp.h and
asm-generic/socket.h on machines of 64 bits.
"""

from __future__ import annotations

import ctypes
import errno
import math
import os
import select
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import numpy as np
from numpy.typing import NDArray

from dbc.frames import LENGTH_ALLOWED, FrameBatch, FrameFlag

from .source import (
    BLOCK_FRAMES,
    GATHER_S,
    LONG_GATHER_S,
    REPLUG,
    STEADY_CLOCK,
    BusError,
    HopLosses,
    SteadyClock,
)

CLASSIC_BYTES, FD_BYTES = 16, 72
FRAME = np.dtype(
    [("can_id", "u4"), ("length", "u1"), ("flags", "u1"), ("unused", "u1", 2), ("data", "u1", 64)]
)
"""`struct canfd_frame`; a `struct can_frame` equals its first 16 bytes."""
_HEADER = np.dtype(
    [
        *[("name", "P"), ("name_bytes", "u4"), ("pieces", "P"), ("count", "P"), ("control", "P")],
        *[("control_bytes", "P"), ("flags", "i4"), ("padding", "i4"), ("size", "u4")],
    ],
    align=True,
)
"""`struct mmsghdr`."""
_PIECE = np.dtype([("base", np.uintp), ("size", np.uintp)], align=True)
"""`struct iovec`."""

_RAW_PROTOCOL, _SOL_CAN_RAW, _ERR_FILTER, _FD_FRAMES = 1, 101, 2, 5
SO_TIMESTAMPNS = 35
_WORD = 8
_CONTROL_WORDS = 4
"""Words for the control message of a datagram, a stamp of the kernel: length, kind, s, ns."""
_STAMP = int(np.array([socket.SOL_SOCKET, SO_TIMESTAMPNS], np.int32).view(np.int64)[0])
"""Level and type of that message, as the word that they form in memory."""

_TOP, _BITS = np.arange(8), np.arange(4)
_FLAGS = (_TOP >> 2) * int(FrameFlag.EXTENDED) | (_TOP >> 1 & 1) * int(FrameFlag.REMOTE)
_FLAGS = (_FLAGS | (_TOP & 1) * int(FrameFlag.ERROR)).astype(np.uint16)
"""Flags by the three top bits of can_id: extended, remote, error."""
_ID_LIMIT = np.where(_TOP & 5, 1 << 29, 1 << 11).astype(np.uint32)
_FD_FLAGS = (_BITS & 1) * int(FrameFlag.BITRATE_SWITCH) | (_BITS >> 1) * int(FrameFlag.ERROR_STATE)
_FD_FLAGS = (_FD_FLAGS | int(FrameFlag.FD)).astype(np.uint16)
"""Flags of an FD frame by the two lowest bits of its own flags."""
_OCTET = np.arange(64, dtype=np.uint8)


class FrameBuffers:
    """Memory for up to `capacity` frames of a call and their control messages, used repeatedly."""

    def __init__(self, capacity: int) -> None:
        self.frames = np.zeros(capacity, FRAME)
        self.control = np.zeros((capacity, _CONTROL_WORDS), np.int64)
        self.headers = np.zeros(capacity, _HEADER)
        self._pieces = np.zeros(capacity, _PIECE)
        row = np.arange(capacity, dtype=np.uintp)
        self._pieces["base"] = self.frames.ctypes.data + row * FRAME.itemsize
        self._pieces["size"] = FRAME.itemsize
        self.headers["pieces"] = self._pieces.ctypes.data + row * _PIECE.itemsize
        self.headers["count"] = 1
        self.headers["control"] = self.control.ctypes.data + row * _CONTROL_WORDS * _WORD
        self.headers["control_bytes"] = _CONTROL_WORDS * _WORD
        self._address = self.headers.ctypes.data
        self._recvmmsg = ctypes.CDLL(None, use_errno=True).recvmmsg
        number, address = ctypes.c_int, ctypes.c_void_p
        self._recvmmsg.argtypes = (number, address, ctypes.c_uint, number, address)

    def receive(self, descriptor: int) -> int:
        """Read the datagrams that a socket has queued into the first rows; return their number.

        Raises the kernel's OSError; BlockingIOError if nothing is queued.
        """
        n, dont_wait = len(self.headers), socket.MSG_DONTWAIT
        count: int = self._recvmmsg(descriptor, self._address, n, dont_wait, None)
        if count < 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code))
        return count


def frame_columns(
    buffers: FrameBuffers, count: int, t_ns: NDArray[np.int64], bus: int
) -> tuple[FrameBatch, NDArray[np.bool_]]:
    """Return the first `count` datagrams that are frames as a batch, and a mask of them, (n,).

    A frame has the right size, an identifier within range, and an allowed length.  `t_ns`, (n,)
    int64: stamps.  `bus`: number of the bus for the frames.
    """
    frames, size = buffers.frames[:count], buffers.headers["size"][:count]
    message_flags = buffers.headers["flags"][:count]
    can_id, length = frames["can_id"], frames["length"].copy()  # the next call overwrites them
    buses = np.full(count, bus, np.uint8)
    if not (
        np.count_nonzero(size != CLASSIC_BYTES)
        or np.count_nonzero(message_flags)
        or np.count_nonzero(can_id > 0x7FF)
        or np.count_nonzero(length != 8)
    ):  # Between two blocks other work fills the processor's caches: each operation saved counts.
        data = frames["data"][:, :8].copy()
        batch = FrameBatch(t_ns, can_id.copy(), np.zeros(count, np.uint16), buses, length, data)
        return batch, np.ones(count, bool)
    id_flags, is_fd = can_id >> 29, size == FD_BYTES
    can_id = can_id & np.uint32(0x1FFFFFFF)
    flags = _FLAGS[id_flags] | np.where(is_fd, _FD_FLAGS[frames["flags"] & 3], np.uint16(0))
    is_echo = message_flags & socket.MSG_DONTROUTE != 0
    flags |= is_echo.astype(np.uint16) * np.uint16(FrameFlag.TRANSMITTED)
    is_remote = flags & np.uint16(FrameFlag.REMOTE) != 0

    is_good = (is_fd | (size == CLASSIC_BYTES)) & (message_flags & socket.MSG_TRUNC == 0)
    is_good &= (can_id < _ID_LIMIT[id_flags]) & LENGTH_ALLOWED[is_fd.view(np.uint8), length]
    is_good &= ~(is_fd & is_remote)
    # After the payload there are bytes left by the sender or by an earlier frame.
    width = 64 if is_fd.any() else 8
    payload = np.where(is_remote, np.uint8(0), length)
    data = frames["data"][:, :width] * (_OCTET[:width] < payload[:, None])
    batch = FrameBatch(t_ns, can_id, flags, buses, length, data)
    return (batch if is_good.all() else batch.select(is_good)), is_good


# Sizes the buffer of a bus that is a socket, and counts the datagrams that it had no room for -----

RECEIVE_BUFFER_BYTES = 8 << 20
"""Receive buffer requested from the kernel, bytes: 21,900 frames, 2.4 s of a bus of 1 Mbit/s."""
_SO_RCVBUFFORCE, _SO_MEMINFO = 33, 55
_IP_MULTICAST_ALL = 49
_COUNTS = struct.Struct("=9I")
_DROPS = 8
"""Position of the number of dropped datagrams in what SO_MEMINFO returns (SK_MEMINFO_DROPS)."""


def enlarge_buffer(sock: socket.socket) -> int:
    """Ask for `RECEIVE_BUFFER_BYTES` and return what the kernel grants, bytes.

    More than `net.core.rmem_max` needs a privilege.
    """
    options = [socket.SO_RCVBUF, *[_SO_RCVBUFFORCE] * (sys.platform == "linux")]
    for option in options:
        with suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, option, RECEIVE_BUFFER_BYTES)
    # The kernel doubles the size for its own bookkeeping, and returns the double.
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2


def keep_to_own_group(sock: socket.socket) -> None:
    """Make a multicast socket receive its own group only, and begin empty.

    By default it receives every group that any process of this machine has joined; frames of other
    groups may have arrived while it was opened: no buffer holds more than are taken here.
    """
    if sys.platform == "linux" and sock.family == socket.AF_INET:
        sock.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        with suppress(OSError):  # until none waits; a busy bus never ends
            for _ in range(10_000):
                sock.recv(1, socket.MSG_DONTWAIT)


def drop_counter(sock: socket.socket) -> int | None:
    """Return a socket's counter of dropped datagrams, modulo 2^32; None if the kernel has none."""
    try:
        raw = sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _COUNTS.size)
    except OSError:
        return None
    return int(_COUNTS.unpack(raw)[_DROPS]) if len(raw) == _COUNTS.size else None


@contextmanager
def socket_of(fileno: Callable[[], int]) -> Iterator[socket.socket]:
    """Lend the socket of a bus whose descriptor `fileno` returns; raises what it raises."""
    sock = socket.socket(fileno=fileno())
    try:
        yield sock
    finally:
        sock.detach()  # the descriptor belongs to the bus


# The source ---------------------------------------------------------------------------------------


class SocketCanSource:
    """An open CAN_RAW socket read in blocks, with the bus number `index`.

    For some milliseconds after the first socket with stamps was opened, the kernel stamps frames
    only when they are read.  `steady_clock`: converts the kernel's stamps, and stamps frames that
    have none.
    """

    def __init__(
        self, sock: socket.socket, name: str, index: int, steady_clock: SteadyClock = STEADY_CLOCK
    ) -> None:
        self.name = name
        self._socket, self._index, self._steady_clock = sock, index, steady_clock
        granted = enlarge_buffer(sock)
        self._gather_s = LONG_GATHER_S if granted >= RECEIVE_BUFFER_BYTES else GATHER_S
        with suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._buffers = FrameBuffers(BLOCK_FRAMES)
        self._arrival = select.poll()
        self._arrival.register(sock, select.POLLIN)
        self._may_have_more = self._is_down = False
        self._fault: OSError | None = None
        self._losses = HopLosses()
        self._drop_counter = 0

    def read(self, timeout_s: float) -> FrameBatch:
        """Return a block of at most `BLOCK_FRAMES` frames; see `FrameSource`.

        An interface that is taken down raises no error: the socket receives again once it is up.
        """
        wait_ms = math.ceil(max(timeout_s, 0.0) * 1e3)
        if not (self._may_have_more or self._fault) and self._arrival.poll(wait_ms):
            time.sleep(self._gather_s)  # others join the first
        count, was_taken_down = self._receive()
        self._may_have_more = count == BLOCK_FRAMES
        counter = drop_counter(self._socket)
        if counter is not None and counter != self._drop_counter:
            dropped = (counter - self._drop_counter) & 0xFFFFFFFF  # it has 32 bits and wraps
            self._drop_counter = counter
            self._losses = self._losses.plus(HopLosses(dropped))
        if self._fault and not count:
            problem = f"has gone: {self._fault.strerror}"
            raise BusError(self.name, problem, REPLUG) from self._fault
        batch = self._batch(count) if count else FrameBatch.empty()
        # Frames in the block in which it was taken down came before.
        self._is_down = was_taken_down or (self._is_down and not len(batch))
        return batch

    def losses(self) -> HopLosses:
        """Return the losses; frames lost within the adapter are reported by error frames."""
        return self._losses

    @property
    def interface_down(self) -> bool:
        """True if the interface was taken down and no frame has come since."""
        return self._is_down

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _receive(self) -> tuple[int, bool]:
        """Fill the buffers; return the number of datagrams, and if the interface was taken down.

        The kernel returns a fault before earlier frames, so a second attempt follows a fault.
        """
        was_taken_down = False
        for _ in range(2):
            try:
                return self._buffers.receive(self._socket.fileno()), was_taken_down
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                if error.errno == errno.ENETDOWN:
                    was_taken_down = True
                else:
                    self._fault = error
        return 0, was_taken_down

    def _batch(self, count: int) -> FrameBatch:
        """Return the frames among the first datagrams as a batch."""
        buffers, control_bytes = self._buffers, _CONTROL_WORDS * _WORD
        words, used_bytes = buffers.control[:count], buffers.headers["control_bytes"][:count]
        is_stamped = (words[:, 1] == _STAMP) & (words[:, 0] >= control_bytes)
        is_stamped &= used_bytes >= control_bytes
        used_bytes[:] = control_bytes  # for the next call
        kernel_ns = (words[:, 2] * 1_000_000_000 + words[:, 3]) * is_stamped
        t_ns = self._steady_clock.from_wall(kernel_ns)
        if np.count_nonzero(is_stamped) < count:
            t_ns = np.where(is_stamped, t_ns, self._steady_clock.now_ns())
        batch, is_good = frame_columns(buffers, count, t_ns, self._index)
        garbled, restamped = count - len(batch), int(np.count_nonzero(is_good > is_stamped))
        if garbled or restamped:
            self._losses = self._losses.plus(HopLosses(0, garbled, restamped))
        return batch


def open_socketcan(channel: str, bus: int) -> SocketCanSource:
    """Open a network interface like `can0` for classic, FD and error frames.

    `channel`: name of the interface.  `bus`: number of the bus in its frames.  Raises BusError if
    no interface is named.  Raises OSError if the kernel has no CAN or no such interface.
    """
    name = f"socketcan {channel}".rstrip()
    if not channel:  # to the kernel that means all interfaces
        raise BusError(name, "names no interface", "channel is like can0; see `ip link`")
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_CLOEXEC, _RAW_PROTOCOL)
    with ExitStack() as undo:
        undo.callback(sock.close)
        sock.setsockopt(_SOL_CAN_RAW, _ERR_FILTER, 0x1FFFFFFF)
        with suppress(OSError):  # a kernel that has no CAN FD
            sock.setsockopt(_SOL_CAN_RAW, _FD_FRAMES, 1)
        source = SocketCanSource(sock, name, bus)  # before `bind`, so that every frame is stamped
        sock.bind((channel,))
        undo.pop_all()
    return source
