"""Converts the kernel's CAN frames to the columns of a block."""

from __future__ import annotations

import socket

import numpy as np
from numpy.typing import NDArray

from dbc.frames import LENGTH_ALLOWED, FrameBatch, FrameFlag

from .abi import BITRATE_SWITCH, CLASSIC_BYTES, ERROR_STATE, FD_BYTES, ID_BITS, Datagrams

# The three top bits of can_id: extended, remote, error.
_TOP = [tuple(bool(top & bit) for bit in (4, 2, 1)) for top in range(8)]
_KIND = np.array(
    [
        extended * FrameFlag.EXTENDED | remote * FrameFlag.REMOTE | error * FrameFlag.ERROR
        for extended, remote, error in _TOP
    ],
    np.uint16,
)
_ID_LIMIT = np.array([1 << 29 if ext or error else 1 << 11 for ext, _, error in _TOP], np.uint32)
_FD_KIND = np.array(
    [
        FrameFlag.FD
        | bool(bits & BITRATE_SWITCH) * FrameFlag.BITRATE_SWITCH
        | bool(bits & ERROR_STATE) * FrameFlag.ERROR_STATE
        for bits in range(4)
    ],
    np.uint16,
)
_STANDARD_IDS = np.uint32(0x7FF)
_NO_FLAG = np.uint16(0)
_REMOTE, _TRANSMITTED = np.uint16(FrameFlag.REMOTE), np.uint16(FrameFlag.TRANSMITTED)
_OCTET = np.arange(64, dtype=np.uint8)


def frame_columns(
    datagrams: Datagrams, t_ns: NDArray[np.int64], bus: int
) -> tuple[FrameBatch, NDArray[np.bool_]]:
    """Convert datagrams of a CAN_RAW socket to a batch.

    `t_ns`, (n,) int64: their time stamps.  `bus`: number of the bus for the frames.  Returns the
    datagrams that are frames (right size, identifier within range, length allowed), and a mask of
    them, (n,).
    """
    if _are_plain(datagrams):
        return _plain_columns(datagrams, t_ns, bus), np.ones(len(t_ns), bool)
    frames = datagrams.frames
    fd = datagrams.size == FD_BYTES
    any_fd = bool(fd.any())
    top = frames["can_id"] >> 29
    can_id = frames["can_id"] & np.uint32(ID_BITS)
    length = frames["length"].copy()  # the next call overwrites the buffer
    flags = _KIND[top]
    if any_fd:
        flags |= np.where(fd, _FD_KIND[frames["flags"] & 3], _NO_FLAG)
    local = datagrams.marks & socket.MSG_DONTROUTE
    if local.any():
        flags |= np.where(local, _TRANSMITTED, _NO_FLAG)
    remote = flags & _REMOTE != 0

    good = (fd | (datagrams.size == CLASSIC_BYTES)) & (datagrams.marks & socket.MSG_TRUNC == 0)
    good &= (can_id < _ID_LIMIT[top]) & LENGTH_ALLOWED[fd.view(np.uint8), length]
    good &= ~(fd & remote)
    # After the payload there are bytes left by the sender or by an earlier frame.
    width = 64 if any_fd else 8
    payload = np.where(remote, np.uint8(0), length)
    data = frames["data"][:, :width] * (_OCTET[:width] < payload[:, None])
    batch = FrameBatch(t_ns, can_id, flags, np.full(len(t_ns), bus, np.uint8), length, data)
    return (batch if good.all() else batch.select(good)), good


def _are_plain(datagrams: Datagrams) -> bool:
    """Return whether all are classic frames of other nodes with 11-bit identifier and 8 bytes.

    Between two blocks other work fills the processor's caches, so every operation takes five times
    as long as in a loop.  This path leaves out operations that such frames do not need.
    """
    frames = datagrams.frames
    return not (
        np.count_nonzero(datagrams.size != CLASSIC_BYTES)
        or np.count_nonzero(datagrams.marks)
        or np.count_nonzero(frames["can_id"] > _STANDARD_IDS)
        or np.count_nonzero(frames["length"] != 8)
    )


def _plain_columns(datagrams: Datagrams, t_ns: NDArray[np.int64], bus: int) -> FrameBatch:
    n, frames = len(t_ns), datagrams.frames
    # A field is a view of the buffer; that of a single frame is even contiguous.
    return FrameBatch(
        t_ns,
        frames["can_id"].copy(),
        np.zeros(n, np.uint16),
        np.full(n, bus, np.uint8),
        frames["length"].copy(),
        frames["data"][:, :8].copy(),
    )
