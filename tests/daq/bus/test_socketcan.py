from __future__ import annotations

import socket
import time

import pytest
from can.interfaces.socketcan import constants
from can.interfaces.socketcan.socketcan import dissect_can_frame

from daq.bus import socketcan
from daq.bus.source import BLOCK_FRAMES
from dbc.frames import FrameBatch, FrameFlag

from .socketcan_feed import NOW_NS, Feed, frame, mixed_frames


def test_frames_of_every_kind_arrive_as_python_can_dissects_them(feed: Feed) -> None:
    sent = mixed_frames(2_000, seed=1)
    blocks = []
    for begin in range(0, len(sent), 100):  # a default send buffer holds no more
        feed.send(*sent[begin : begin + 100])
        blocks.append(feed.read_all())
    got = FrameBatch.concatenate(blocks)

    assert len(got) == len(sent)
    assert feed.source.losses() == type(feed.source.losses())()
    assert set(got.bus) == {3}
    for i, raw in enumerate(sent):
        can_id, length, flags, data = dissect_can_frame(raw)
        fd, remote = len(raw) == constants.CANFD_MTU, bool(can_id & constants.CAN_RTR_FLAG)
        expected = FrameFlag(0)
        expected |= FrameFlag.EXTENDED if can_id & constants.CAN_EFF_FLAG else expected
        expected |= FrameFlag.REMOTE if remote else expected
        expected |= FrameFlag.ERROR if can_id & constants.CAN_ERR_FLAG else expected
        expected |= FrameFlag.FD if fd else expected
        expected |= FrameFlag.BITRATE_SWITCH if flags & constants.CANFD_BRS else expected
        expected |= FrameFlag.ERROR_STATE if flags & constants.CANFD_ESI else expected
        assert got.can_id[i] == can_id & 0x1FFFFFFF
        assert FrameFlag(int(got.flags[i])) == expected
        assert got.length[i] == length
        assert bytes(got.data[i]) == (b"" if remote else data).ljust(64, b"\0")


def test_classic_frames_make_narrow_blocks_that_later_frames_leave_alone(feed: Feed) -> None:
    feed.send(frame(1, bytes(8)), frame(2, b"12345678"))
    plain = feed.read()
    feed.send(frame(3, b"abcdefgh"), frame(4, b"x"))
    feed.read()
    assert plain.data.shape == (2, 8)
    assert list(plain.can_id) == [1, 2]
    assert bytes(plain.data[1]) == b"12345678"
    assert list(plain.length) == [8, 8]


@pytest.mark.parametrize("data", [b"12345678", b"x"])
def test_a_frame_alone_in_its_block_is_not_touched_by_the_next(feed: Feed, data: bytes) -> None:
    feed.send(frame(1, data))
    first = feed.read()
    feed.send(frame(2, b"abcde"))
    feed.read()
    assert (list(first.can_id), list(first.length)) == ([1], [len(data)])
    assert bytes(first.data[0]) == data.ljust(8, b"\0")


def test_a_length_code_above_8_is_8_bytes(feed: Feed) -> None:
    raw = bytearray(frame(data=b"12345678"))
    raw[7] = 13  # raw DLC, which some drivers report in addition to the length
    feed.send(bytes(raw))
    batch = feed.read()
    assert list(batch.length) == [8]
    assert bytes(batch.data[0]) == b"12345678"


def with_byte(raw: bytes, position: int, value: int) -> bytes:
    return raw[:position] + bytes([value]) + raw[position + 1 :]


@pytest.mark.parametrize(
    "bad",
    [
        frame()[:15],
        frame()[:8],
        frame() + b"\0",
        frame(is_fd=True)[:71],
        frame(is_fd=True) + bytes(100),
        with_byte(frame(), 4, 9),
        with_byte(frame(), 4, 255),
        with_byte(frame(is_fd=True), 4, 9),
        with_byte(frame(is_fd=True), 4, 65),
        with_byte(frame(), 1, 0x08),  # 0x800: twelve bits, not marked as extended
        with_byte(frame(is_fd=True), 3, 0x40),  # CAN FD has no remote frames
    ],
    ids=lambda raw: f"{len(raw)} bytes {raw[:5].hex()}",
)
def test_what_cannot_be_a_frame_is_counted_and_its_neighbours_are_kept(
    feed: Feed, bad: bytes
) -> None:
    feed.send(frame(1), bad, frame(2, bytes(64), is_fd=True), bad, frame(3))
    assert list(feed.read_all().can_id) == [1, 2, 3]
    assert feed.source.losses().garbled == 2
    assert feed.source.losses().restamped == 0


def test_frames_carry_the_time_at_which_the_kernel_got_them(feed: Feed) -> None:
    feed.wait_for_stamps()
    before_ns, between_ns = [], []
    for i in range(20):
        before_ns.append(time.time_ns())
        feed.send(frame(i, bytes(8)))
        between_ns.append(time.time_ns())
    batch = feed.read()
    assert (batch.t_ns >= before_ns).all()
    assert (batch.t_ns <= between_ns).all()
    assert feed.source.losses().restamped == 0


def test_frames_without_a_stamp_are_stamped_on_arrival_and_counted(feed: Feed) -> None:
    feed.receiving.setsockopt(socket.SOL_SOCKET, socketcan.SO_TIMESTAMPNS, 0)
    feed.send(frame(1), frame(2), frame()[:9])
    assert list(feed.read().t_ns) == [NOW_NS, NOW_NS]
    assert feed.source.losses().restamped == 2


def test_a_block_is_bounded_and_what_is_left_comes_at_once(
    udp: Feed, monkeypatch: pytest.MonkeyPatch
) -> None:
    udp.send(*[frame(i % 0x800) for i in range(BLOCK_FRAMES + 5)])
    first = udp.read()
    with monkeypatch.context() as patch:
        patch.setattr(udp.source, "_arrival", None)  # nothing is waited for
        second = udp.read()
    assert (len(first), len(second)) == (BLOCK_FRAMES, 5)
    assert len(udp.read()) == 0


def test_every_frame_that_did_not_fit_is_counted_even_those_at_the_end(udp: Feed) -> None:
    received = 0
    for sent in (25_000, 50_000):
        udp.send(*[frame(data=bytes(8))] * 25_000)
        received += len(udp.read_all())
        dropped = udp.source.losses().dropped
        assert dropped > 1_000  # or the socket did not overrun
        assert received + dropped == sent


def test_the_counter_that_comes_with_a_frame_is_counted_without_asking(
    udp: Feed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socketcan, "drop_counter", lambda sock: None)
    udp.send(*[frame(data=bytes(8))] * 25_000)
    received = len(udp.read_all())
    assert udp.source.losses().dropped == 0  # all frames in the queue are older than the drops
    udp.send(frame(7))
    assert list(udp.read().can_id) == [7]
    assert received + udp.source.losses().dropped == 25_000


def test_the_drop_counter_has_32_bits_and_may_be_behind(
    feed: Feed, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter([0x7000_0000, 0xE000_0000, 0xFFFF_FFF0, 0xFFFF_0000, 5, None])
    monkeypatch.setattr(socketcan, "drop_counter", lambda sock: next(answers))
    counts = []
    for _ in range(6):
        feed.read()
        counts.append(feed.source.losses().dropped)
    assert counts == [0x7000_0000, 0xE000_0000, 0xFFFF_FFF0, 0xFFFF_FFF0, 2**32 + 5, 2**32 + 5]
