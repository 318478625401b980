"""How much of a bus a frame takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, FrameFlag

_FAST_DATA = 4
"""The payload of an FD frame with bit rate switch goes so much faster; the rate is not configured
here."""


def wire_bits(frames: FrameBatch) -> NDArray[np.float64]:
    """Return the bits that each frame takes on the wire, estimated, (n,).

    A classic frame has 47 bits around its data, 20 more with 29 bits, and a stuff bit in thirty.
    """
    data = 8.0 * frames.length
    fast = frames.flags & np.uint16(FrameFlag.BITRATE_SWITCH)
    if np.count_nonzero(fast):
        data /= np.where(fast, _FAST_DATA, 1)
    extended = frames.flags & np.uint16(FrameFlag.EXTENDED)
    return np.asarray((47 + 20 * extended + data) * (31 / 30))
