"""Datagrams that found no room in the buffer of a socket."""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from typing import Any

from daq.bench.config import BusConfig
from daq.bus.interfaces import open_bus, open_source
from daq.bus.source import SocketDrops

from ...multicast import own_group

GROUP = own_group(76)


def test_what_was_sent_and_not_received_was_dropped() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reader,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        reader.bind(("127.0.0.1", 0))
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        reader.setblocking(False)
        drops = SocketDrops(reader.fileno)
        assert drops.count() == 0
        for n in range(500):
            sender.sendto(n.to_bytes(2, "little"), reader.getsockname())
        received = _emptied(reader)
        assert 0 < received < 500
        assert drops.count() == 500 - received
        again = SocketDrops(reader.fileno)  # a bus that is opened again counts from there
        assert again.count() == 0
    assert drops.count() == 500 - received  # closed


def test_a_bus_without_a_socket_drops_nothing() -> None:
    def no_descriptor() -> int:
        raise NotImplementedError

    assert SocketDrops(no_descriptor).count() == 0
    near, far = os.pipe()
    lowest = _lowest_free(near)
    assert SocketDrops(lambda: near).count() == 0
    assert _lowest_free(near) == lowest  # nothing of it is left open
    os.close(near)
    os.close(far)


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
        while source.losses().garbled > before:
            before = source.losses().garbled
            assert not len(source.read(0.05))
        losses = source.losses()
        assert losses.dropped > 0
        assert losses.dropped + losses.garbled == 200
    finally:
        source.close()


def _emptied(reader: socket.socket) -> int:
    """Receive what a socket holds; return the number of datagrams."""
    received = 0
    with suppress(BlockingIOError):
        while reader.recv(16):
            received += 1
    return received


def _lowest_free(descriptor: int) -> int:
    """Return the number that the next descriptor will have."""
    free = os.dup(descriptor)
    os.close(free)
    return free
