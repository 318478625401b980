"""A SocketCAN source fed through a socket, and frames as the kernel gives them."""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces.socketcan.socketcan import build_can_frame

from daq.bench.config import BusConfig
from daq.bus import socketcan
from daq.bus.interfaces import open_bus, open_source
from daq.bus.socketcan import FrameBuffers, SocketCanSource, frame_columns
from daq.bus.source import BLOCK_FRAMES, BusError, HopLosses, SteadyClock
from dbc.frames import FrameBatch, FrameFlag

from ..adapters import own_group
from ..formats.mixed import frames_in, message, mixed

NOW_NS = 1_800_000_000_123_456_789


def unix_pair() -> tuple[socket.socket, socket.socket]:
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


def udp_pair() -> tuple[socket.socket, socket.socket]:
    receiving, sending = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    receiving.bind(("127.0.0.1", 0))
    sending.connect(receiving.getsockname())
    return receiving, sending


class Feed:
    """A source, and the other end of its socket."""

    def __init__(self, pair: tuple[socket.socket, socket.socket]) -> None:
        self.receiving, self.sending = pair
        self.source = SocketCanSource(
            self.receiving, "fed 0", 3, SteadyClock(lambda: NOW_NS, lambda: 0)
        )

    def send(self, *frames: bytes) -> None:
        for frame in frames:
            self.sending.send(frame)

    def read(self, timeout_s: float = 0.0) -> FrameBatch:
        return self.source.read(timeout_s)

    def wait_for_stamps(self) -> None:
        """Wait until the kernel stamps packets: it starts to when someone wants it, a bit later."""
        deadline_s = time.monotonic() + 10.0
        punctual = False
        while not punctual and time.monotonic() < deadline_s:
            self.send(frame())
            sent_ns = time.time_ns()
            punctual = self.read(1.0).t_ns[0] <= sent_ns
        assert punctual

    def read_all(self) -> FrameBatch:
        blocks = [self.read()]
        while len(blocks[-1]):
            blocks.append(self.read())
        return FrameBatch.concatenate(blocks)


def frame(can_id: int = 0x100, data: bytes = b"\1\2", **other: Any) -> bytes:
    message = can.Message(arbitration_id=can_id, data=data, **{"is_extended_id": False, **other})
    return build_can_frame(message)


# A SocketCAN source, and the other end of its socket --------------------------------------------


@pytest.fixture(params=[unix_pair, udp_pair])
def feed(request: pytest.FixtureRequest) -> Iterator[Feed]:
    fed = Feed(request.param())
    yield fed
    fed.source.close()
    fed.sending.close()


@pytest.fixture
def udp() -> Iterator[Feed]:
    fed = Feed(udp_pair())
    yield fed
    fed.source.close()
    fed.sending.close()


# SocketCAN read in blocks, its control messages, faults and drops -------------------------------


def test_frames_of_every_kind_arrive_as_python_can_sends_them(feed: Feed) -> None:
    rng, sent = np.random.default_rng(1), mixed(400)
    raw = []
    for each in sent:  # with arbitrary bytes behind the payload
        built = build_can_frame(message(each))
        raw.append(built[: 8 + each.length] + rng.bytes(len(built) - 8 - each.length))
    blocks = []
    for begin in range(0, len(raw), 100):  # a default send buffer holds no more
        feed.send(*raw[begin : begin + 100])
        blocks.append(feed.read_all())
    got = FrameBatch.concatenate(blocks)
    assert feed.source.losses() == HopLosses()
    assert not got.data[np.arange(got.data.shape[1]) >= got.length[:, None]].any()
    plain = [replace(each, t_us=0, bus=3, sent=False) for each in sent]
    assert [replace(each, t_us=0) for each in frames_in(got)] == plain


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
    assert feed.source.losses().bus_garbled == 2
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
    feed.send(frame(7), frame(7))
    feed.read()  # its stamps stay in the memory of the next
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
    for option in (socket.SO_RCVBUF, 33):  # small, also if it was made large by force
        udp.receiving.setsockopt(socket.SOL_SOCKET, option, 1 << 15)
    received = 0
    for sent in (500, 1000):
        udp.send(*[frame(data=bytes(8))] * 500)
        received += len(udp.read_all())
        dropped = udp.source.losses().bus_dropped
        assert dropped > 100  # or the socket did not overrun
        assert received + dropped == sent


# SocketCAN: interfaces that go down or away, silence, closing, and opening ------------------------


class FaultyBuffers(FrameBuffers):
    """Buffers that meet the faults of a script before they receive."""

    faults: list[int]
    calls: int

    def receive(self, descriptor: int) -> int:
        type(self).calls += 1
        if self.faults and (code := self.faults.pop(0)):
            raise OSError(code, os.strerror(code))
        return super().receive(descriptor)


@pytest.fixture
def faulty(monkeypatch: pytest.MonkeyPatch, feed: Feed) -> Feed:
    FaultyBuffers.faults, FaultyBuffers.calls = [], 0
    feed.source._buffers = FaultyBuffers(BLOCK_FRAMES)
    return feed


def test_an_interface_that_was_taken_down_is_reported_and_read_on(faulty: Feed) -> None:
    FaultyBuffers.faults = [errno.ENETDOWN]
    assert len(faulty.read()) == 0
    assert faulty.source.interface_down
    assert len(faulty.read()) == 0
    assert faulty.source.interface_down
    faulty.send(frame(5))
    assert list(faulty.read().can_id) == [5]
    assert not faulty.source.interface_down


@pytest.mark.parametrize("code", [errno.ENODEV, errno.EBADF, errno.ENXIO])
def test_an_interface_that_has_gone_hands_out_its_last_frames_first(
    faulty: Feed, code: int
) -> None:
    faulty.send(frame(1), frame(2))
    FaultyBuffers.faults = [code]
    assert list(faulty.read().can_id) == [1, 2]
    for _ in range(2):
        with pytest.raises(BusError, match=r"fed 0: has gone: .*start again") as caught:
            faulty.read()
        assert os.strerror(code) in str(caught.value)


def test_silence_is_waited_for_in_the_kernel(faulty: Feed) -> None:
    began_s = time.monotonic()
    for _ in range(3):
        assert len(faulty.read(0.1)) == 0
    assert time.monotonic() - began_s >= 0.3
    assert FaultyBuffers.calls == 3


class CanSocket(socket.socket):
    """Takes the options of a CAN socket, though the kernel may have none."""

    asked: dict[tuple[int, ...], object]
    bound: object

    def __init__(self, family: int, kind: int, protocol: int) -> None:
        assert (family, kind & 0xF, protocol) == (29, 3, 1)  # AF_CAN, SOCK_RAW, CAN_RAW
        type(self).asked = {}
        super().__init__(socket.AF_INET, socket.SOCK_DGRAM)

    def setsockopt(self, *option: Any) -> None:
        *which, value = option
        self.asked[tuple(which)] = value
        if which[0] == socket.SOL_SOCKET:
            super().setsockopt(*option)

    def bind(self, address: object) -> None:
        if address != ("can0",):
            raise OSError(errno.ENODEV, "No such device")
        type(self).bound = address


def test_opening_asks_for_fd_and_all_error_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "socket", CanSocket)
    source = open_source(BusConfig("socketcan", "can0", 500_000), 1)
    assert isinstance(source, SocketCanSource)
    source.close()
    assert source.name == "socketcan can0"
    assert CanSocket.bound == ("can0",)
    assert CanSocket.asked[101, 2] == 0x1FFFFFFF  # CAN_RAW_ERR_FILTER
    assert CanSocket.asked[101, 5] == 1  # CAN_RAW_FD_FRAMES


# Stamps and counters that the kernel adds to frames, and which frames it echoes -------------------


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


# Datagrams that found no room in the buffer of a socket -------------------------------------------


def test_classic_frames_make_narrow_blocks_that_later_frames_leave_alone(feed: Feed) -> None:
    feed.send(frame(1, bytes(8)), frame(2, b"12345678"))
    plain = feed.read()
    feed.send(frame(3, b"abcdefgh"), frame(4, b"x"))
    feed.read()
    assert plain.data.shape == (2, 8)
    assert list(plain.can_id) == [1, 2]
    assert bytes(plain.data[1]) == b"12345678"
    assert list(plain.length) == [8, 8]


def test_a_length_code_above_8_is_8_bytes(feed: Feed) -> None:
    raw = bytearray(frame(data=b"12345678"))
    raw[7] = 13  # raw DLC, which some drivers report in addition to the length
    feed.send(bytes(raw))
    batch = feed.read()
    assert list(batch.length) == [8]
    assert bytes(batch.data[0]) == b"12345678"


def test_the_drop_counter_has_32_bits(feed: Feed, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([0x7000_0000, 0xE000_0000, 0xFFFF_FFF0, 0xFFFF_FFF0, 5, None])
    monkeypatch.setattr(socketcan, "drop_counter", lambda sock: next(answers))
    counts = []
    for _ in range(6):
        feed.read()
        counts.append(feed.source.losses().bus_dropped)
    assert counts == [0x7000_0000, 0xE000_0000, 0xFFFF_FFF0, 0xFFFF_FFF0, 2**32 + 5, 2**32 + 5]


def test_frames_that_waited_when_it_was_taken_down_are_no_sign_of_life(faulty: Feed) -> None:
    """The kernel returns the fault first, and only then the frames that came before it."""
    faulty.send(frame(1), frame(2))
    FaultyBuffers.faults = [errno.ENETDOWN]
    assert list(faulty.read_all().can_id) == [1, 2]
    assert faulty.source.interface_down
    faulty.send(frame(9))
    assert list(faulty.read().can_id) == [9]
    assert not faulty.source.interface_down


def open_descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_an_interface_that_is_not_there_leaves_nothing_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(socket, "socket", CanSocket)
    before = open_descriptors()
    with pytest.raises(BusError, match=r"can9: cannot be opened: .*No such device.*ip link"):
        open_source(BusConfig("socketcan", "can9", 500_000), 1)
    assert open_descriptors() == before


GROUP = own_group(76)


def test_the_losses_of_udp_multicast_are_the_kernels() -> None:
    config = BusConfig("udp_multicast", GROUP, 1_000_000)
    source: Any = open_source(config, 0)
    try:
        bus: Any = open_bus(config)
        with bus, socket.socket(fileno=os.dup(source._bus.fileno())) as twin:
            for option in (socket.SO_RCVBUF, 33):  # small, also if it was made large by force
                twin.setsockopt(socket.SOL_SOCKET, option, 4096)
            for _ in range(200):
                bus._multicast.send(b"\xc1" * 400)  # each is one datagram, and garbled
        before = -1
        while source.losses().bus_garbled > before:
            before = source.losses().bus_garbled
            assert not len(source.read(0.05))
        losses = source.losses()
        assert losses.bus_dropped > 0
        assert losses.bus_dropped + losses.bus_garbled == 200
    finally:
        source.close()
