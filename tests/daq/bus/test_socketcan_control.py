"""Stamps and counters that the kernel adds to frames, and which frames it echoes."""

from __future__ import annotations

import socket

import numpy as np
import pytest

from daq.bus.socketcan import FrameBuffers, frame_columns, read_control
from dbc.frames import FrameFlag


def control(*messages: tuple[int, int, bytes]) -> tuple[bytes, int]:
    """Return a control buffer as the kernel fills it, and how many bytes it says it used."""
    out = b""
    for level, kind, data in messages:
        out += (16 + len(data)).to_bytes(8, "little")
        out += level.to_bytes(4, "little") + kind.to_bytes(4, "little") + data
        out += bytes(-len(out) % 8)
    return out.ljust(64, b"\xee")[:64], min(len(out), 64)


def timespec(seconds: int, nanoseconds: int) -> bytes:
    return seconds.to_bytes(8, "little") + nanoseconds.to_bytes(8, "little")


def test_stamps_and_the_newest_counter_are_found() -> None:
    stamp = (1, 35, timespec(1_800_000_000, 5))
    buffers = [
        control(stamp),
        control(stamp, (1, 40, b"\1\0\0\0")),
        control(stamp, (1, 40, b"\2\0\0\x80")),
        control(stamp),
        control(),
        control((1, 35, timespec(7, 7)[:9])),  # too short for a stamp
        control((41, 35, timespec(7, 7))),  # of another level
    ]
    words = np.array([np.frombuffer(data, np.int64) for data, _ in buffers])
    used = np.array([used for _, used in buffers], np.uintp)
    t_ns, dropped = read_control(words, used)
    assert list(t_ns) == [1_800_000_000 * 10**9 + 5] * 4 + [0, 0, 0]
    assert dropped == 0x8000_0002
    assert read_control(words[:1], used[:1])[1] is None


@pytest.mark.parametrize(("can_id", "is_frame"), [(0x7FF, True), (0x800, False), (0xFFE, False)])
def test_echoes_are_marked_and_what_cannot_be_a_frame_is_left_out(
    can_id: int, is_frame: bool
) -> None:
    buffers = FrameBuffers(4)
    buffers.frames["can_id"], buffers.frames["length"] = [0x123, 0x123, 0x123, can_id], 8
    buffers.headers["size"] = 16
    buffers.headers["flags"] = [0, socket.MSG_DONTROUTE, socket.MSG_TRUNC, 0]
    batch, good = frame_columns(buffers, 4, np.arange(4), 0)
    assert list(good) == [True, True, False, is_frame]
    assert list(batch.flags[:2]) == [0, FrameFlag.TRANSMITTED]
    assert list(batch.can_id) == [0x123, 0x123, can_id][: 2 + is_frame]
