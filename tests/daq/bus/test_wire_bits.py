"""The time of a frame on the wire, in bits counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from daq.bus.interfaces import wire_bits
from dbc import FrameBatch, FrameFlag

FD = FrameFlag.FD
FAST = FrameFlag.FD | FrameFlag.BITRATE_SWITCH


@pytest.mark.parametrize(
    ("flags", "length", "bits"),
    [
        (0, 0, 47),
        (0, 8, 47 + 64),
        (FrameFlag.EXTENDED, 8, 67 + 64),
        (FD, 64, 47 + 512),
        (FAST, 64, 47 + 128),  # its data four times as fast
        (FAST | FrameFlag.EXTENDED, 12, 67 + 24),
    ],
)
def test_bits_of_a_frame_with_one_stuff_bit_in_thirty(flags: int, length: int, bits: int) -> None:
    one = np.ones(2, np.uint8)
    frames = FrameBatch(
        np.arange(2), one.astype(np.uint32), np.array([flags, 0], np.uint16), 0 * one,
        np.array([length, 8], np.uint8), np.zeros((2, 64), np.uint8),
    )  # fmt: skip
    assert wire_bits(frames) == pytest.approx([bits * 31 / 30, 111 * 31 / 30])
