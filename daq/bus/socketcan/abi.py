"""Defines the memory layout in which the Linux kernel returns CAN frames.

Layouts and numbers of linux/can.h, linux/can/raw.h, linux/net_tstamp.h and asm-generic/socket.h on
machines of 64 bits, and the buffers of `recvmmsg`, which fills many messages with one call.
"""

from __future__ import annotations

import ctypes
import os
import socket
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

CLASSIC_BYTES = 16
FD_BYTES = 72
FRAME = np.dtype(
    [
        ("can_id", np.uint32),
        ("length", np.uint8),
        ("flags", np.uint8),
        ("reserved", np.uint8),
        ("raw_dlc", np.uint8),
        ("data", np.uint8, (64,)),
    ]
)
"""`struct canfd_frame`; a `struct can_frame` equals its first 16 bytes."""

ID_BITS = 0x1FFFFFFF
"""Bits of the identifier; above them: bit 31 extended, bit 30 remote, bit 29 error frame."""
BITRATE_SWITCH = 1
ERROR_STATE = 2

RAW_PROTOCOL = 1
SOL_CAN_RAW = 101
CAN_RAW_ERR_FILTER = 2
CAN_RAW_FD_FRAMES = 5

SO_RCVBUFFORCE = 33
SO_TIMESTAMPNS = 35
SO_TIMESTAMPING = 37
SO_RXQ_OVFL = 40
HARDWARE_STAMPS = 1 << 2 | 1 << 6
"""SOF_TIMESTAMPING_RX_HARDWARE and SOF_TIMESTAMPING_RAW_HARDWARE."""

_HEADER = np.dtype(
    [
        ("name", np.uintp),
        ("name_bytes", np.uint32),
        ("pieces", np.uintp),
        ("piece_count", np.uintp),
        ("control", np.uintp),
        ("control_bytes", np.uintp),
        ("flags", np.int32),
        ("padding", np.int32),
        ("size", np.uint32),
    ],
    align=True,
)
"""`struct mmsghdr`."""
_PIECE = np.dtype([("base", np.uintp), ("size", np.uintp)], align=True)
"""`struct iovec`."""

_WORD = 8
_CONTROL_WORDS = 16
"""Words for the control messages of a datagram: one stamp of the kernel (4), one of the hardware
(8), one counter (3)."""


def _kind(option: int) -> int:
    """Return level and type of a control message as the word that they form in memory."""
    return int(np.array([socket.SOL_SOCKET, option], np.int32).view(np.int64)[0])


_KERNEL_STAMP = _kind(SO_TIMESTAMPNS)
_ONE_STAMP = 4 * _WORD
_STAMPS = _kind(SO_TIMESTAMPING)
_DROPS = _kind(SO_RXQ_OVFL)


@cache
def _libc() -> Any:
    libc = ctypes.CDLL(None, use_errno=True)
    libc.recvmmsg.argtypes = (
        ctypes.c_int,
        ctypes.c_void_p,
        ctypes.c_uint,
        ctypes.c_int,
        ctypes.c_void_p,
    )
    return libc


@dataclass(frozen=True, slots=True)
class Ancillary:
    """Time stamps and drop counter that the kernel adds to frames."""

    kernel_ns: NDArray[np.int64]
    """Stamps of the kernel, ns, shape (n,); 0 where there is none."""
    hardware_ns: NDArray[np.int64]
    """Stamps of the adapter, ns, shape (n,); 0 where there is none."""
    dropped: int | None = None
    """The socket's counter of dropped frames, modulo 2^32, as carried by the last frame that has
    one; None if no frame has one."""


@dataclass(frozen=True, slots=True)
class Datagrams:
    """Datagrams read from a socket."""

    frames: NDArray[np.void]
    """Frames; only the first `size` bytes of each are valid."""
    size: NDArray[np.uint32]
    """Number of bytes of each datagram, shape (n,)."""
    marks: NDArray[np.int32]
    """`MSG_` flags of each datagram, shape (n,)."""
    ancillary: Ancillary


class FrameBuffers:
    """Memory for up to `capacity` frames of a call and their control messages, used repeatedly."""

    def __init__(self, capacity: int) -> None:
        self._frames = np.zeros(capacity, FRAME)
        self._control = np.zeros((capacity, _CONTROL_WORDS), np.int64)
        self._pieces = np.zeros(capacity, _PIECE)
        self._headers = np.zeros(capacity, _HEADER)
        place = np.arange(capacity, dtype=np.uintp)
        self._pieces["base"] = self._frames.ctypes.data + place * FRAME.itemsize
        self._pieces["size"] = FRAME.itemsize
        self._headers["pieces"] = self._pieces.ctypes.data + place * _PIECE.itemsize
        self._headers["piece_count"] = 1
        self._headers["control"] = self._control.ctypes.data + place * _CONTROL_WORDS * _WORD
        self._headers["control_bytes"] = _CONTROL_WORDS * _WORD
        self._address = self._headers.ctypes.data

    def receive(self, descriptor: int) -> int:
        """Read the datagrams that a socket has queued into the first rows; return their number.

        Raises the kernel's OSError; BlockingIOError if nothing is queued.
        """
        count: int = _libc().recvmmsg(
            descriptor, self._address, len(self._headers), socket.MSG_DONTWAIT, None
        )
        if count < 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code))
        return count

    def datagrams(self, count: int) -> Datagrams:
        """Return the first `count` datagrams; once after each `receive`, which overwrites them."""
        headers = self._headers[:count]
        ancillary = parse_control(self._control[:count], headers["control_bytes"])
        headers["control_bytes"] = _CONTROL_WORDS * _WORD
        return Datagrams(self._frames[:count], headers["size"], headers["flags"], ancillary)


def parse_control(words: NDArray[np.int64], used: NDArray[np.uintp]) -> Ancillary:
    """Read the control messages of datagrams.

    Other kinds are skipped; a message that does not fit ends the control messages of its datagram.

    `words`, (n, m) int64: control buffer of each datagram.  `used`, (n,) uintp: number of bytes
    that the kernel wrote into it.
    """
    if not (np.count_nonzero(used != _ONE_STAMP) or np.count_nonzero(words[:, 1] != _KERNEL_STAMP)):
        return Ancillary(_nanoseconds(words[:, 2], words[:, 3]), np.zeros(len(words), np.int64))
    return _parse_mixed_control(words, used.astype(np.int64))


def _parse_mixed_control(words: NDArray[np.int64], used: NDArray[np.int64]) -> Ancillary:
    kernel_ns, hardware_ns = np.zeros(len(words), np.int64), np.zeros(len(words), np.int64)
    dropped: int | None = None
    dropped_row = -1
    rows = np.flatnonzero(used >= 2 * _WORD)
    at = np.zeros(len(rows), np.int64)  # in words
    while len(rows):
        size, kind = words[rows, at], words[rows, at + 1]
        fits = (size >= 2 * _WORD) & (size <= used[rows] - _WORD * at)
        for code, column, first in (
            (_KERNEL_STAMP, kernel_ns, 2),
            (_STAMPS, hardware_ns, 6),  # software, (obsolete: transformed), hardware
        ):
            found = fits & (kind == code) & (size >= (first + 2) * _WORD)
            if found.any():
                to, place = rows[found], at[found] + first
                column[to] = _nanoseconds(words[to, place], words[to, place + 1])
        found = fits & (kind == _DROPS) & (size >= 2 * _WORD + 4)
        if found.any() and (last := rows[found][-1]) > dropped_row:
            dropped_row = int(last)
            dropped = int(words[last, at[found][-1] + 2 :][:1].view(np.uint32)[0])
        at = at + (size + _WORD - 1) // _WORD
        more = fits & (_WORD * (at + 2) <= used[rows])
        rows, at = rows[more], at[more]
    return Ancillary(kernel_ns, hardware_ns, dropped)


def _nanoseconds(seconds: NDArray[np.int64], nanoseconds: NDArray[np.int64]) -> NDArray[np.int64]:
    return seconds * 1_000_000_000 + nanoseconds
