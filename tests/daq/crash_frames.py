"""Frames that carry their number, so that none can be lost, doubled or altered unseen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.journal.format import JournalHead
from daq.journal.reader import read_journal
from dbc.frames import FrameBatch

START_NS = 10**18
RATE_HZ = 16_000
"""Four full buses of 500 kbit/s, 8-byte frames."""
BLOCK_FRAMES = RATE_HZ // 10

HEAD = JournalHead(
    "[bus]\n", 'VERSION ""\n', "crash", START_NS, 1, "0123456789abcdef0123456789abcdef"
)


def numbered(n: NDArray[np.int64]) -> FrameBatch:
    """Return the frames of these numbers: every column and the payload follow from the number."""
    mixed = n.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return FrameBatch(
        START_NS + n * 62_500,
        (mixed % np.uint64(2048)).astype(np.uint32),
        (n % 128).astype(np.uint16),
        (n % 4).astype(np.uint8),
        np.full(len(n), 8, np.uint8),
        n.astype(">u8").view(np.uint8).reshape(-1, 8),
    )


def block(first: int, count: int) -> FrameBatch:
    """Return `count` frames from number `first` on."""
    return numbered(np.arange(first, first + count, dtype=np.int64))


def numbers(frames: FrameBatch) -> NDArray[np.int64]:
    """Return the numbers of frames read back.

    Raises
    ------
    AssertionError
        If a single bit of any is not as it was written.
    """
    n = frames.data[:, :8].copy().view(">u8").reshape(-1).astype(np.int64)
    true = numbered(n)
    for name in ("t_ns", "can_id", "flags", "bus", "length", "data"):
        same = np.array_equal(getattr(frames, name), getattr(true, name))
        assert same, f"{name} is not what was written"
    return n


def read_numbers(segments: Sequence[Path]) -> NDArray[np.int64]:
    """Return the numbers of all frames in segments, after the check of each bit."""
    return numbers(read_journal(segments).frames)
