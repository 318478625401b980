"""Blocks of frames from lists of payloads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dbc import FrameBatch, FrameFlag


def block(
    payloads: Sequence[bytes],
    can_id: int | Sequence[int],
    extended: bool | Sequence[bool] = False,
    flags: int | Sequence[int] = 0,
    width: int = 8,
) -> FrameBatch:
    """Return a block of these payloads, one a microsecond."""
    n = len(payloads)
    width = 64 if any(len(payload) > 8 for payload in payloads) else width
    data = np.zeros((n, width), np.uint8)
    for row, payload in zip(data, payloads, strict=True):
        row[: len(payload)] = list(payload)
    bits = np.broadcast_to(flags, n) | np.broadcast_to(extended, n) * int(FrameFlag.EXTENDED)
    return FrameBatch(
        np.arange(n) * 1000,
        np.broadcast_to(can_id, n),
        bits,
        np.zeros(n, np.uint8),
        np.array([len(payload) for payload in payloads], np.uint8),
        data,
    )
