"""Converts python-can's messages to the columns of a block, and says how long frames take."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter, index
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.frames import LENGTH_ALLOWED, FrameBatch, FrameFlag

CLOCK_TOLERANCE_S = 86_400.0
"""Difference from the host's clock, s, above which a stamp is taken to have another epoch (boot,
adapter reset) or none."""

_STANDARD_IDS = 1 << 11
_EXTENDED_IDS = 1 << 29

_FIELDS = attrgetter(
    "timestamp",
    "arbitration_id",
    "dlc",
    "data",
    "is_extended_id",
    "is_remote_frame",
    "is_error_frame",
    "is_fd",
    "bitrate_switch",
    "error_state_indicator",
    "is_rx",
)
_BITS = (
    FrameFlag.EXTENDED,
    FrameFlag.REMOTE,
    FrameFlag.ERROR,
    FrameFlag.FD,
    FrameFlag.BITRATE_SWITCH,
    FrameFlag.ERROR_STATE,
    FrameFlag.TRANSMITTED,
)


def frame_columns(
    messages: Sequence[Any], arrived_ns: Sequence[int], bus: int
) -> tuple[FrameBatch, int, int]:
    """Convert messages to a batch.

    `messages`, sequence of can.Message, not empty: as received; a backend need not have checked
    them.  `arrived_ns`: the host's time at which each was received.  `bus`: number of the bus for
    the frames.  Returns the messages that can be frames (identifier within range, length as stated
    and allowed), the number of the other messages, and the number of frames stamped on arrival.
    Raises TypeError or ValueError or OverflowError if a field has the wrong type or size (a text as
    identifier, more than 64 bytes).
    """
    n = len(messages)
    stamps, ids, dlcs, payloads, *marks, received = zip(*map(_FIELDS, messages), strict=True)
    can_id = np.fromiter(map(index, ids), np.int64, n)
    dlc = np.fromiter(map(index, dlcs), np.int64, n)
    size = np.fromiter(map(len, payloads), np.int64, n)
    flags = np.zeros(n, np.uint16)
    for bit, mark in zip(_BITS, (*marks, np.logical_not(received)), strict=True):
        flags |= np.asarray(mark, bool) * np.uint16(bit)
    width = 8 if size.max() <= 8 else 64
    data = np.frombuffer(b"".join([p.ljust(width, b"\0") for p in payloads]), np.uint8)

    extended, remote, error, fd = (flags & bit != 0 for bit in _BITS[:4])
    good = (can_id >= 0) & (can_id < np.where(extended | error, _EXTENDED_IDS, _STANDARD_IDS))
    good &= (dlc >= 0) & (dlc <= 64) & LENGTH_ALLOWED[fd.view(np.uint8), dlc.clip(0, 64)]
    good &= (np.where(remote, 0, dlc) == size) & ~(fd & remote)
    t_ns, believed = _stamps(np.array(stamps, np.float64), np.array(arrived_ns, np.int64))
    batch = FrameBatch(
        t_ns,
        np.where(good, can_id, 0).astype(np.uint32),
        flags,
        np.full(n, bus, np.uint8),
        np.where(good, dlc, 0).astype(np.uint8),
        data.reshape(n, width),
    )
    garbled, restamped = int(np.sum(~good)), int(np.sum(good & ~believed))
    return (batch.select(good) if garbled else batch), garbled, restamped


def _stamps(
    stamp_s: NDArray[np.float64], arrived_ns: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return time stamps in ns, and a mask of those that come from the interface.

    Whole seconds and the fraction are converted separately: near 1.8e18 a float64 of nanoseconds
    steps by 256, which would add to the 238 ns that a float64 of seconds already costs.
    """
    believed = np.abs(stamp_s - arrived_ns * 1e-9) < CLOCK_TOLERANCE_S  # False for NaN
    stamp_s = np.where(believed, stamp_s, 0.0)
    whole = np.floor(stamp_s)
    t_ns = whole.astype(np.int64) * 1_000_000_000
    t_ns += np.rint((stamp_s - whole) * 1e9).astype(np.int64)
    return np.where(believed, t_ns, arrived_ns), believed


_FAST_DATA = 4
"""Assumed ratio of data to nominal bit rate of FD frames; bench.toml has no data bit rate."""


def wire_bits(frames: FrameBatch) -> NDArray[np.float64]:
    """Return the estimated nominal bit times that each frame takes on the wire, (n,).

    A classic frame has 47 bits in addition to its data, 20 more with a 29-bit identifier, and one
    stuff bit in thirty.
    """
    data = 8.0 * frames.length
    fast = frames.flags & np.uint16(FrameFlag.BITRATE_SWITCH)
    if np.count_nonzero(fast):
        data /= np.where(fast, _FAST_DATA, 1)
    extended = frames.flags & np.uint16(FrameFlag.EXTENDED)
    return np.asarray((47 + 20 * extended + data) * (31 / 30))
