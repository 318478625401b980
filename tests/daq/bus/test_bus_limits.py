"""When a bus counts as lost, and is opened again; what its socket is asked for."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import suppress

import can
import pytest

from daq.bus.source import enlarge_buffer, keep_to_own_group
from daq.errors import BusError
from dbc import FrameBatch

from .test_bus import ScriptedBus, frame, parse_error, source_on
from .test_link import ONE, Clock, Source, link_to


def read(*script: can.Message | Exception | None) -> list[list[int] | str]:
    """Return the identifiers of each block until the script ends, or that the bus has gone."""
    bus = ScriptedBus(*script)
    source = source_on(bus)
    seen: list[list[int] | str] = []
    while bus.script:
        try:
            seen.append(source.read(0.0).can_id.tolist())
        except BusError:
            seen.append("gone")
    return seen


@pytest.mark.parametrize(("pieces", "seen"), [(9_999, [[1]]), (10_000, ["gone", [1]])])
def test_ten_thousand_unreadable_pieces_are_a_bus_that_has_gone(
    pieces: int, seen: list[list[int] | str]
) -> None:
    assert read(*[parse_error()] * pieces, frame(1)) == seen


def loopbacks() -> Iterator[tuple[socket.AddressFamily, str, int, int]]:
    """Yield family, address, level and option of the loopbacks of this machine."""
    yield socket.AF_INET, "127.0.0.1", socket.IPPROTO_IP, 49  # IP_MULTICAST_ALL of linux/in.h
    with suppress(OSError), socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as there:
        there.bind(("::1", 0))
        yield socket.AF_INET6, "::1", socket.IPPROTO_IPV6, 29  # IPV6_MULTICAST_ALL of linux/in6.h


@pytest.mark.parametrize(("family", "address", "level", "option"), list(loopbacks()))
def test_a_multicast_socket_hears_its_own_groups_alone_and_begins_empty(
    family: socket.AddressFamily, address: str, level: int, option: int
) -> None:
    with socket.socket(family, socket.SOCK_DGRAM) as receiving:
        receiving.bind((address, 0))
        with socket.socket(family, socket.SOCK_DGRAM) as sending:
            for _ in range(3):
                sending.sendto(b"stray", receiving.getsockname())
            before = receiving.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
            enlarge_buffer(receiving)
            keep_to_own_group(receiving)
            assert receiving.getsockopt(level, option) == 0
            assert receiving.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) >= before
            sending.sendto(b"own", receiving.getsockname())
            receiving.settimeout(30.0)
            assert receiving.recv(100) == b"own"


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


@pytest.mark.parametrize(("silent_s", "closed"), [(4.9, False), (5.1, True)])
def test_a_bus_is_opened_again_after_five_seconds_of_silence(silent_s: float, closed: bool) -> None:
    clock = Clock()
    first, second = Source(clock, [ONE]), Source(clock, [])
    link = link_to(clock, first, second)
    link.read(0.1)
    assert len(link.read(0.1)) == len(ONE)
    clock.now_s += silent_s
    assert not len(link.read(0.0))
    assert first.closed is closed


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


def test_a_bus_that_is_opened_for_the_first_time_was_not_opened_again() -> None:
    clock = Clock()
    link = link_to(clock, OSError("not yet"), Source(clock, []), Source(clock, []))
    clock.now_s += 1.0
    link.read(0.0)
    clock.now_s += 1.0
    assert link.read(0.0) is not None
    assert (link.facts().connected, link.facts().reopened) == (True, 0)
    assert isinstance(link.read(0.0), FrameBatch)
