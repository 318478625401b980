"""Frames written by hand, as the documents of their sensors say."""

from collections.abc import Iterable

import numpy as np

from dbc.frames import FrameBatch, FrameFlag

START_NS = 1_800_000_000_000_000_000

Row = tuple[float, int, bytes]
"""Seconds since the start, identifier, payload."""


def frame_batch(rows: Iterable[Row], extended: bool = False) -> FrameBatch:
    """Return frames in order of time; those at one time keep their order."""
    ordered = sorted(rows, key=lambda row: row[0])
    n = len(ordered)
    wide = max((len(row[2]) for row in ordered), default=0) > 8
    data = np.zeros((n, 64 if wide else 8), np.uint8)
    for i, (_, _, payload) in enumerate(ordered):
        data[i, : len(payload)] = np.frombuffer(payload, np.uint8)
    return FrameBatch(
        np.array([START_NS + round(row[0] * 1e9) for row in ordered], np.int64),
        np.array([row[1] for row in ordered], np.uint32),
        np.full(n, FrameFlag.EXTENDED if extended else 0, np.uint16),
        np.zeros(n, np.uint8),
        np.array([len(row[2]) for row in ordered], np.uint8),
        data,
    )
