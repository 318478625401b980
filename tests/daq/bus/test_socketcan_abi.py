from __future__ import annotations

import socket

import numpy as np
import pytest

from daq.bus.socketcan import abi as abi
from daq.bus.socketcan.messages import frame_columns
from dbc.frames import FrameFlag


def control(*messages: tuple[int, int, bytes], words: int = 16) -> tuple[bytes, int]:
    """Return a control buffer as the kernel fills it, and how many bytes it says it used."""
    out = b""
    for level, kind, data in messages:
        out += (16 + len(data)).to_bytes(8, "little")
        out += level.to_bytes(4, "little") + kind.to_bytes(4, "little") + data
        out += bytes(-len(out) % 8)
    return out.ljust(8 * words, b"\xee")[: 8 * words], min(len(out), 8 * words)


def timespec(seconds: int, nanoseconds: int) -> bytes:
    return seconds.to_bytes(8, "little") + nanoseconds.to_bytes(8, "little")


def test_control_messages_are_found_in_any_order_and_company() -> None:
    kernel = (1, 35, timespec(1_800_000_000, 5))
    stamps = (1, 37, timespec(9, 9) + timespec(0, 0) + timespec(12, 345_678_901))
    nothing = (1, 37, timespec(9, 9) + timespec(0, 0) + timespec(0, 0))
    stranger = (41, 35, b"\xff" * 4)
    buffers = [
        control(kernel),
        control(kernel, stamps, (1, 40, b"\1\0\0\0")),
        control((1, 40, b"\2\0\0\x80"), nothing, kernel),
        control(stranger, kernel),
        control(),
        control((1, 35, timespec(7, 7)[:9])),  # too short for a stamp
    ]
    words = np.array([np.frombuffer(data, np.int64) for data, _ in buffers])
    found = abi.parse_control(words, np.array([used for _, used in buffers], np.uintp))
    now_ns = 1_800_000_000 * 10**9 + 5
    assert list(found.kernel_ns) == [now_ns, now_ns, now_ns, now_ns, 0, 0]
    assert list(found.hardware_ns) == [0, 12_345_678_901, 0, 0, 0, 0]
    assert found.dropped == 0x8000_0002

    alone = abi.parse_control(words[:1], np.array([32], np.uintp))
    assert (list(alone.kernel_ns), list(alone.hardware_ns)) == ([now_ns], [0])
    assert alone.dropped is None


@pytest.mark.parametrize("size", [0, 15, 33, 1 << 40, -8])
def test_a_control_message_of_impossible_size_ends_the_search(size: int) -> None:
    data, used = control((1, 35, timespec(5, 6)), (1, 40, b"\1\0\0\0"))
    words = np.frombuffer(data, np.int64).copy()[None]
    words[0, 4] = size
    found = abi.parse_control(words, np.array([used], np.uintp))
    assert list(found.kernel_ns) == [5_000_000_006]
    assert found.dropped is None


def test_an_echo_of_this_host_s_own_frame_is_marked() -> None:
    frames = np.zeros(3, abi.FRAME)
    frames["can_id"], frames["length"] = 0x123, 8
    marks = np.array([0, socket.MSG_DONTROUTE, socket.MSG_TRUNC], np.int32)
    nothing = abi.Ancillary(np.zeros(3, np.int64), np.zeros(3, np.int64))
    datagrams = abi.Datagrams(frames, np.full(3, 16, np.uint32), marks, nothing)
    batch, good = frame_columns(datagrams, np.arange(3), 0)
    assert list(batch.flags) == [0, FrameFlag.TRANSMITTED]
    assert list(good) == [True, True, False]


@pytest.mark.parametrize(("can_id", "is_frame"), [(0x7FF, True), (0x800, False), (0xFFE, False)])
def test_a_number_above_eleven_bits_without_the_flag_of_29_is_no_identifier(
    can_id: int, is_frame: bool
) -> None:
    frames = np.zeros(2, abi.FRAME)
    frames["can_id"], frames["length"] = [0x123, can_id], 8
    nothing = abi.Ancillary(np.zeros(2, np.int64), np.zeros(2, np.int64))
    sizes, marks = np.full(2, 16, np.uint32), np.zeros(2, np.int32)
    batch, good = frame_columns(abi.Datagrams(frames, sizes, marks, nothing), np.arange(2), 0)
    assert list(good) == [True, is_frame]
    assert list(batch.can_id) == [0x123, can_id][: 1 + is_frame]
