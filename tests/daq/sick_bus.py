"""A device on a bus that can be broken and repaired, behind python-can's own base class."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import can

from daq.bench.config import BusConfig
from daq.bus.interfaces import PythonCanSource
from daq.bus.source import FrameSource
from daq.errors import BusError


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
        self.deaf = False
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
