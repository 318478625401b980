"""Estimates the time on the bus that a frame takes, in bits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, FrameFlag

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
