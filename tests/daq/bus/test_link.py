"""A bus that is opened as often as need be, by an injected clock."""

from __future__ import annotations

import itertools
import socket
import struct
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from daq.bench.config import BusConfig
from daq.bus.socketcan import SocketCanSource
from daq.bus.source import BusError, FrameSource, HopLosses, Link, SteadyClock
from dbc import FrameBatch

from ..small_campaign import blocks, bumps, small_codec

ONE = blocks(bumps(small_codec(), 1))[0]


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


class Source:
    """Gives out what is written; an exception is raised, silence goes on for ever."""

    name = "test"

    def __init__(self, clock: Clock, given: Sequence[FrameBatch | BaseException]) -> None:
        self.clock, self.given, self.closed = clock, iter(given), False
        self.frames = 0

    def read(self, timeout_s: float) -> FrameBatch:
        self.clock.now_s += timeout_s
        found = next(self.given, FrameBatch.empty())
        if isinstance(found, BaseException):
            raise found
        self.frames += len(found)
        return found

    def losses(self) -> HopLosses:
        if self.closed:
            raise OSError("closed")
        return HopLosses(self.frames, 1, 2)

    def close(self) -> None:
        self.closed = True
        raise RuntimeError("cannot say goodbye")


def link_to(clock: Clock, *found: FrameSource | BaseException, interface: str = "gs_usb") -> Link:
    config = BusConfig(interface, "0", 500_000)
    opened = iter(found)

    def open_source(_: BusConfig, number: int) -> FrameSource:
        result = next(opened)
        if isinstance(result, BaseException):
            raise result
        return result

    return Link(config, 0, open_source, clock)


def test_the_pauses_between_openings_grow_to_two_seconds() -> None:
    clock, tries = Clock(), list[float]()

    def refuse(_: BusConfig, number: int) -> FrameSource:
        tries.append(clock.now_s)
        raise BusError("can0", "no such device", "see `ip link`")

    link = Link(BusConfig("socketcan", "can0", 500_000), 0, refuse, clock)
    while clock.now_s < 120.0:
        assert not len(link.read(0.0))
        clock.now_s += 0.05
        assert link.facts().heartbeat_s == pytest.approx(clock.now_s - 0.05)
    pauses = [later - sooner for sooner, later in itertools.pairwise(tries)]
    assert pauses[:5] == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6], abs=0.06)
    assert pauses[5:] == pytest.approx([2.0] * len(pauses[5:]), abs=0.06)
    facts = link.facts()
    assert (facts.connected, facts.error, facts.advice) == (
        False,
        "no such device",
        "see `ip link`",
    )


def test_losses_add_up_over_openings_and_after_a_success_the_pause_is_short_again() -> None:
    clock = Clock()
    first = Source(clock, [ONE, OSError(5, "Input/output error")])
    second = Source(clock, [ONE, ONE])
    link = link_to(clock, first, NameError("canlib"), second)
    counted = 0
    while counted < 3 * len(ONE):
        counted += len(link.read(0.05))
        clock.now_s += 0.1
    facts = link.facts()
    assert facts.losses == HopLosses(3 * len(ONE), 2, 4)
    assert (facts.connected, facts.reopened, facts.error) == (True, 1, "")
    assert first.closed
    link.close()
    assert second.closed
    assert link.facts().losses == facts.losses
    assert not link.facts().connected


class NetworkSource(Source):
    """On an interface that is down for the second and the third read."""

    reads = 0

    def read(self, timeout_s: float) -> FrameBatch:
        self.reads += 1
        return super().read(timeout_s)

    @property
    def interface_down(self) -> bool:
        return self.reads in (2, 3)


def test_an_interface_that_was_taken_down_is_reported_until_frames_come_again() -> None:
    clock = Clock()
    nothing = FrameBatch.empty()
    source = NetworkSource(clock, [ONE, nothing, nothing, ONE])
    link = link_to(clock, source, interface="socketcan")
    reported = []
    for _ in range(5):
        link.read(0.1)
        reported.append(link.facts().interface_down)
    assert reported == [False, False, True, True, False]  # the first turn opens it
    assert not source.closed


# R11, the stamps: the wall clock is set an hour on and back, and the axis of time goes on ---------

S = 1_000_000_000
START_NS = 1_800_000_000 * S


class Host:
    """Two clocks, one of which can be set."""

    def __init__(self) -> None:
        self.monotonic_ns, self.set_ns = 5 * S, 0
        self.axis = SteadyClock(self.wall, self.monotonic)

    def monotonic(self) -> int:
        return self.monotonic_ns

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


def test_a_thread_that_waits_between_the_two_clocks_reads_them_again() -> None:
    host, waits_ns = Host(), iter([20_000_000])  # after the monotonic clock was read
    axis = SteadyClock(host.wall, host.monotonic)
    stamps = np.array([host.wall()], np.int64)

    def wall_after_a_wait() -> int:
        host.monotonic_ns += next(waits_ns, 0)
        return host.wall()

    axis._wall_ns = wall_after_a_wait
    assert axis.from_wall(stamps) is stamps


def test_what_is_slewed_is_left_alone() -> None:
    host = Host()
    stamps = np.array([host.wall()], np.int64)
    host.set_ns += 900_000
    assert host.axis.from_wall(stamps) is stamps


# When a bus counts as lost, and is opened again -------------------------------------------------


@pytest.mark.parametrize(
    ("error", "what", "advice"),
    [
        (BusError("can0", "has gone", "plug it in"), "has gone", "plug it in"),
        (OSError(5, "Input/output error"), "Input/output error", "check plug, power and driver"),
        (OSError("odd"), "odd", "check plug, power and driver"),
        (NameError("canlib"), "NameError('canlib')", "please report this"),
    ],
)
def test_why_a_bus_was_lost_is_said(error: Exception, what: str, advice: str) -> None:
    clock = Clock()
    link = link_to(clock, Source(clock, [ONE, error]))
    for _ in range(3):
        link.read(0.0)
    facts = link.facts()
    assert (facts.connected, facts.error, facts.advice) == (False, what, advice)


@pytest.mark.parametrize(
    ("interface", "given", "silent_s", "closed"),
    [
        ("gs_usb", [ONE], 4.9, False),
        ("gs_usb", [ONE], 5.1, True),
        ("socketcan", [ONE], 100.0, False),  # its source would report a loss
        ("gs_usb", [], 100.0, False),  # it was never heard: the car may be off
    ],
)
def test_a_bus_that_fell_silent_is_opened_again_after_five_seconds(
    interface: str, given: list[FrameBatch | Exception], silent_s: float, closed: bool
) -> None:
    clock = Clock()
    first, second, third = Source(clock, given), Source(clock, []), Source(clock, [])
    link = link_to(clock, first, second, third, interface=interface)
    for _ in range(2):
        link.read(0.1)
    clock.now_s += silent_s
    assert not len(link.read(0.0))
    assert first.closed is closed
    link.read(0.0)
    clock.now_s += silent_s
    link.read(0.0)
    assert second.closed is closed
    assert link.facts().reopened == int(closed)


@pytest.mark.parametrize("ended", ["halt", "close"])
def test_a_link_that_has_ended_opens_nothing_any_more(ended: str) -> None:
    clock = Clock()
    source = Source(clock, [ONE])
    link = link_to(clock, OSError("not yet"), source)
    assert not len(link.read(0.0))
    getattr(link, ended)()
    clock.now_s += 60.0
    for _ in range(3):
        assert not len(link.read(0.0))
    assert source.frames == 0
    assert not link.facts().connected


@pytest.mark.parametrize("raised", [SystemExit(1), KeyboardInterrupt(), MemoryError()])
def test_a_driver_that_ends_the_program_is_one_more_lost_bus(raised: BaseException) -> None:
    """The reader goes on, and opens the bus again."""

    class Fatal(Source):
        def losses(self) -> Any:
            raise raised

        def close(self) -> None:
            raise raised

    clock = Clock()
    fatal = [Fatal(clock, [raised]) for _ in range(3)]
    link = link_to(clock, fatal[0], raised, *fatal[1:], interface="kvaser")
    for _ in range(7):
        assert not len(link.read(0.0))
        clock.now_s += 10.0
    assert not any(list(source.given) for source in fatal)
    assert not link.facts().connected
    assert type(raised).__name__ in link.facts().error
    link.close()
