"""A SocketCAN source fed through a socket, and frames as the kernel gives them."""

from __future__ import annotations

import socket
import time
from typing import Any

import can
import numpy as np
from can.interfaces.socketcan.socketcan import build_can_frame

from daq.bus.clock import SteadyClock
from daq.bus.socketcan import SocketCanSource
from dbc.frames import FrameBatch

NOW_NS = 1_800_000_000_123_456_789
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


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


def mixed_frames(count: int, seed: int) -> list[bytes]:
    """Return frames of every kind, with arbitrary bytes behind the payload."""
    rng = np.random.default_rng(seed)
    frames = []
    for _ in range(count):
        kind = rng.choice(["data", "remote", "error", "fd"])
        extended = bool(rng.integers(2)) and kind != "error"
        size = 8 if kind == "error" else int(rng.choice(FD_LENGTHS[: 16 if kind == "fd" else 9]))
        message = can.Message(
            arbitration_id=int(rng.integers(1 << 29 if extended else 1 << 11)),
            is_extended_id=extended,
            is_remote_frame=kind == "remote",
            is_error_frame=kind == "error",
            is_fd=kind == "fd",
            bitrate_switch=kind == "fd" and bool(rng.integers(2)),
            error_state_indicator=kind == "fd" and bool(rng.integers(2)),
            dlc=size,
            data=None if kind == "remote" else rng.bytes(size),
        )
        built = build_can_frame(message)
        frames.append(built[: 8 + size] + rng.bytes(len(built) - 8 - size))
    return frames
