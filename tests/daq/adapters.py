"""Buses for tests: a cable of two serial devices, a multicast group, adapters of python-can."""

from __future__ import annotations

import os
import select
import threading
import tty
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import can

from daq.bench.config import BusConfig
from daq.bus.interfaces import PythonCanSource
from daq.bus.source import BusError, FrameSource


def own_group(second: int) -> str:
    """Return a multicast group of this process, which those of other processes do not reach.

    `second`: its second number, another one for each file of tests.
    """
    return f"239.{second}.{os.getpid() >> 8 & 255}.{os.getpid() & 255}"


@contextmanager
def pty_pair() -> Iterator[tuple[str, str]]:
    """Yield the paths of two pseudo terminals in raw mode, joined by a thread."""
    masters, slaves = zip(os.openpty(), os.openpty(), strict=True)
    for fd in (*masters, *slaves):
        tty.setraw(fd)
    for fd in masters:
        os.set_blocking(fd, False)
    wake_r, wake_w = os.pipe()

    def carry() -> None:
        other = dict(zip(masters, reversed(masters), strict=True))
        waiting = dict.fromkeys(masters, b"")  # read from one end, not yet taken by the other
        while True:
            readers = [fd for fd in masters if not waiting[fd]]
            writers = [other[fd] for fd in masters if waiting[fd]]
            readable, writable, _ = select.select([*readers, wake_r], writers, [])
            if wake_r in readable:  # also when the other end is read no more
                return
            for fd in readable:
                waiting[fd] = os.read(fd, 4096)
            for fd in masters:
                if other[fd] in writable:
                    waiting[fd] = waiting[fd][os.write(other[fd], waiting[fd]) :]

    cable = threading.Thread(target=carry, daemon=True)
    cable.start()
    try:
        yield os.ttyname(slaves[0]), os.ttyname(slaves[1])
    finally:
        os.write(wake_w, b"x")
        cable.join()
        for fd in (*masters, *slaves, wake_r, wake_w):
            os.close(fd)


# A device on a bus that can be broken and repaired, behind python-can's own base class ----------


def parse_error(text: str = "could not unpack received message") -> Exception:
    """Return what a backend raises on bytes that are no frame: a parser's error behind its own."""
    error = can.CanOperationError(text)
    error.__cause__ = UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")
    return error


@dataclass
class Device:
    """An adapter that fails as it is set to."""

    fault: Exception | None = None
    """What every `recv` raises."""
    open_fault: Exception | None = None
    """What opening raises."""
    swallows: bool = False
    """The driver swallows the error of a device that has gone: opened before, it is silent."""
    sent: deque[can.Message | Exception] = field(default_factory=deque)
    """What comes next: messages, or exceptions that are raised once."""
    opened: int = 0
    """How often it was opened."""


class SickBus(can.BusABC):
    """The device's bus, as a backend would offer it."""

    def __init__(self, device: Device) -> None:
        super().__init__("sick")
        self.device = device
        self.deaf = self.closed = False
        self.waits: list[float | None] = []

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self.waits.append(timeout)
        self.deaf |= self.device.swallows
        if self.deaf:
            return None, False
        if self.device.fault is not None:
            raise self.device.fault
        if not self.device.sent:
            return None, False
        item = self.device.sent.popleft()
        if isinstance(item, Exception):
            raise item
        return item, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Buses are only listened to."""

    def shutdown(self) -> None:
        super().shutdown()
        self.closed = True
        if self.device.fault is not None:
            raise self.device.fault


def opener(device: Device, now_ns: Callable[[], int]) -> Callable[[BusConfig, int], FrameSource]:
    """Return what opens the device as `daq.bus.interfaces.open_source` would."""

    def open_device(config: BusConfig, number: int) -> FrameSource:
        name = f"{config.interface} {config.channel}"
        if device.open_fault is not None:
            raise BusError(name, f"cannot be opened: {device.open_fault}", "plug it in")
        device.opened += 1
        return PythonCanSource(SickBus(device), name, number, now_ns=now_ns)

    return open_device
