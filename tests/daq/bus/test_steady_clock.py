"""R11, the stamps: the wall clock is set an hour on and back, and the axis of time goes on."""

from __future__ import annotations

import socket
import struct
import time

import numpy as np
import pytest

from daq.bus.socketcan import SocketCanSource
from daq.bus.source import SteadyClock

S = 1_000_000_000
START_NS = 1_800_000_000 * S


class Host:
    """Two clocks, one of which can be set."""

    def __init__(self) -> None:
        self.monotonic_ns, self.set_ns = 5 * S, 0
        self.axis = SteadyClock(self.wall, lambda: self.monotonic_ns)

    def wall(self) -> int:
        return START_NS + self.monotonic_ns - 5 * S + self.set_ns

    def pass_time(self, seconds: float) -> None:
        self.monotonic_ns += round(seconds * S)


@pytest.mark.parametrize("step_s", [3600, -3600, 1, -1, 86_400 * 400])
def test_stamps_go_on_when_the_clock_is_set(step_s: int) -> None:
    host = Host()
    stamps_ns: list[int] = []
    queued: list[int] = []
    for turn in range(100):
        for _ in range(10):
            host.pass_time(0.01)
            queued.append(host.wall())
            if turn == 50 and len(queued) == 5:  # frames of before and after wait in one block
                host.set_ns += step_s * S
        stamps_ns += host.axis.from_wall(np.array(queued, np.int64)).tolist()
        queued.clear()
    assert np.diff(stamps_ns).tolist() == [10_000_000] * 999
    assert stamps_ns[0] == START_NS + 10_000_000
    assert host.axis.now_ns() == stamps_ns[-1]
    host.axis.begin()
    assert host.axis.now_ns() == host.wall()


def test_an_axis_that_goes_on_never_begins_before_its_end() -> None:
    host = Host()
    end_ns = host.wall() + 7200 * S
    host.axis.begin(end_ns)
    stamps = np.array([host.wall() - 5, host.wall()])
    assert host.axis.from_wall(stamps).tolist() == [end_ns - 5, end_ns]
    host.pass_time(2.0)
    assert host.axis.now_ns() == end_ns + 2 * S
    host.set_ns += 10_000 * S  # the time server answers at last
    assert host.axis.from_wall(np.array([host.wall()])).tolist() == [end_ns + 2 * S]
    host.axis.begin(end_ns)  # a clock that is ahead is believed
    assert host.axis.now_ns() == host.wall()


def test_a_clock_that_is_set_again_and_again() -> None:
    host = Host()
    stamps_ns: list[int] = []
    for _ in range(100):  # 100 times a second on, four times a second
        host.pass_time(0.25)
        stamps = [host.wall()]
        host.set_ns += S
        host.pass_time(0.001)
        stamps.append(host.wall())
        stamps_ns += host.axis.from_wall(np.array(stamps, np.int64)).tolist()
    steps = np.diff(stamps_ns)
    assert set(steps.tolist()) == {250_000_000, 1_000_000}


def test_what_is_slewed_is_left_alone() -> None:
    host = Host()
    stamps = np.array([host.wall()], np.int64)
    host.set_ns += 900_000
    assert host.axis.from_wall(stamps) is stamps


def test_frames_of_a_socket_are_on_the_axis() -> None:
    begun_ns = time.time_ns()
    # The kernel stamps by the true clock; to it, this host was an hour ahead when it began.
    clocks = iter([begun_ns + 3600 * S])
    axis = SteadyClock(lambda: next(clocks, time.time_ns()), time.monotonic_ns)
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    source = SocketCanSource(near, "pair", 0, steady_clock=axis)
    with far:
        far.send(struct.pack("=IB3x8s", 0x123, 8, bytes(8)))
        (t_ns,) = source.read(1.0).t_ns.tolist()
    source.close()
    assert 0 <= t_ns - begun_ns - 3600 * S < 10 * S
