"""SocketCAN: interfaces that go down or away, silence, closing, and opening."""

from __future__ import annotations

import errno
import os
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from daq.bench.config import BusConfig
from daq.bus import socketcan
from daq.bus.interfaces import open_source
from daq.bus.socketcan import FrameBuffers, SocketCanSource
from daq.bus.source import BLOCK_FRAMES
from daq.errors import BusError

from .socketcan_feed import Feed, frame


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


@pytest.mark.parametrize("waiting", [1, 4, 5])
def test_frames_that_waited_when_it_was_taken_down_are_no_sign_of_life(
    faulty: Feed, monkeypatch: pytest.MonkeyPatch, waiting: int
) -> None:
    """The kernel returns the fault first, and only then the frames that came before it."""
    monkeypatch.setattr(socketcan, "BLOCK_FRAMES", 2)
    faulty.source._buffers = FaultyBuffers(2)
    faulty.send(*map(frame, range(1, waiting + 1)))
    FaultyBuffers.faults = [errno.ENETDOWN]
    assert list(faulty.read_all().can_id) == list(range(1, waiting + 1))
    assert faulty.source.interface_down
    faulty.send(frame(9))
    assert list(faulty.read().can_id) == [9]
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


def test_closing_wakes_a_thread_that_is_reading(feed: Feed) -> None:
    got: list[int] = []
    reader = threading.Thread(target=lambda: got.append(len(feed.read(60.0))), daemon=True)
    reader.start()
    while not feed.source._reading.locked():
        assert reader.is_alive()
    feed.source.close()
    reader.join(10.0)
    assert got == [0]
    with pytest.raises(BusError, match="closed"):
        feed.read()
    assert feed.receiving.fileno() == -1


def test_closing_twice_releases_everything_once(feed: Feed) -> None:
    feed.source.close()
    before = open_descriptors()
    feed.source.close()
    assert open_descriptors() == before


def open_descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


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
    assert CanSocket.asked[1, 40] == 1  # SO_RXQ_OVFL


def test_an_interface_that_is_not_there_leaves_nothing_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(socket, "socket", CanSocket)
    before = open_descriptors()
    with pytest.raises(BusError, match=r"can9: cannot be opened: .*No such device.*ip link"):
        open_source(BusConfig("socketcan", "can9", 500_000), 1)
    assert open_descriptors() == before


def test_all_interfaces_at_once_cannot_be_distinguished() -> None:
    with pytest.raises(BusError, match="names no interface"):
        open_source(BusConfig("socketcan", "", 500_000), 1)
