"""Receiving from a socket: our blocks against python-can's `SocketcanBus.recv`, on the same bytes.

A kernel without CAN will do: datagrams of `struct can_frame` over UDP on the loopback, stamped by
the kernel, stand for the bus.  Costs are CPU time of the receiving thread, kernel included.  Paced
is as a full bus of 1 Mbit/s comes, and what counts; queued is after a stall.
"""

from __future__ import annotations

import logging
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from unittest import mock

import can
import numpy as np
from can.interfaces.socketcan import SocketcanBus, socketcan

from daq.bus.socketcan import SocketCanSource

FULL_BUS_HZ = 9_000
PACED_FRAMES = 9_000
QUEUED_FRAMES = 250
"""So many fit into the socket's default buffer."""
REPEATS = 3

SENDER = """
import socket, sys, time
port, count, rate_hz, frames = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), sys.argv[4:]
frames = [bytes.fromhex(frame) for frame in frames]
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
    sending.connect(("127.0.0.1", port))
    began_s = time.perf_counter() + 0.05
    for i in range(count):
        while time.perf_counter() < began_s + i / rate_hz:
            pass
        sending.send(frames[i % len(frames)])
"""


def main() -> None:
    """Print the cost per frame of both and their ratio."""
    logging.getLogger("can").setLevel(logging.CRITICAL)  # it misses options of a true CAN socket
    for name, measure in (("full bus, paced", _paced_us), ("queued", _queued_us)):
        theirs_us = min(measure(*_python_can()) for _ in range(REPEATS))
        ours_us = min(measure(*_ours()) for _ in range(REPEATS))
        print(
            f"receive, {name}: {ours_us:.2f} us CPU/frame, python-can {theirs_us:.1f}, "
            f"ratio {theirs_us / ours_us:.1f}"
        )


def _frame_bytes(count: int) -> list[bytes]:
    """Return classic frames of 8 random bytes, as the kernel has them."""
    rng = np.random.default_rng(1)
    return [
        socketcan.build_can_frame(
            can.Message(arbitration_id=int(can_id), is_extended_id=False, data=rng.bytes(8))
        )
        for can_id in rng.integers(0, 0x800, count)
    ]


_DATAGRAMS = _frame_bytes(64)


def _socket() -> socket.socket:
    receiving = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiving.bind(("127.0.0.1", 0))
    return receiving


def _python_can() -> tuple[socket.socket, Callable[[], int], Callable[[], None]]:
    """Return a socket, a call that receives and counts its frames, and one that closes both."""
    receiving = _socket()
    with (
        mock.patch.object(socketcan, "create_socket", return_value=receiving),
        mock.patch.object(socketcan, "bind_socket"),
    ):
        bus = SocketcanBus("loopback")
    return receiving, lambda: bus.recv(0.1) is not None, bus.shutdown


def _ours() -> tuple[socket.socket, Callable[[], int], Callable[[], None]]:
    receiving = _socket()
    source = SocketCanSource(receiving, "loopback", 0)
    return receiving, lambda: len(source.read(0.1)), source.close


def _paced_us(
    receiving: socket.socket, receive: Callable[[], int], close: Callable[[], None]
) -> float:
    arguments = [receiving.getsockname()[1], PACED_FRAMES, FULL_BUS_HZ]
    command = [sys.executable, "-c", SENDER, *map(str, arguments), *(d.hex() for d in _DATAGRAMS)]
    with subprocess.Popen(command) as sender:
        began_s = time.thread_time()
        count = 0
        while (new := receive()) or sender.poll() is None:
            count += new
        spent_s = time.thread_time() - began_s
    close()
    assert count >= 0.9 * PACED_FRAMES, "frames lost"
    return spent_s / count * 1e6


def _queued_us(
    receiving: socket.socket, receive: Callable[[], int], close: Callable[[], None]
) -> float:
    spent_s, rounds = 0.0, 40
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        sending.connect(receiving.getsockname())
        for _ in range(rounds):
            for i in range(QUEUED_FRAMES):
                sending.send(_DATAGRAMS[i % len(_DATAGRAMS)])
            began_s = time.thread_time()
            count = 0
            while count < QUEUED_FRAMES and (new := receive()):
                count += new
            spent_s += time.thread_time() - began_s
            assert count == QUEUED_FRAMES, "frames lost"
    close()
    return spent_s / (rounds * QUEUED_FRAMES) * 1e6


if __name__ == "__main__":
    main()
