"""R9, the whole recorder: five sick buses at once, and a healthy one that must lose nothing."""

from __future__ import annotations

import errno
import threading
import time
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from daq.bench.config import BusConfig
from daq.bus.source import FrameSource, SourceLosses
from daq.control.messages import Live, Status
from daq.journal.reader import read_journal
from daq.recorder.recorder import Recorder
from dbc import FrameBatch

from ..sick_bus import Device, opener
from ..small_campaign import small_bench
from ..watched_bench import FOREIGN_ID, frames

LONG_S = 60.0
"""Nothing takes so long but a machine that is very busy."""
HEALTHY = "virtual healthy"
EXPECTED = {
    "kvaser gone": "disconnected",
    "gs_usb mute": "bus_silent",
    "kvaser garbage": "garbled",
    "kvaser bus_off": "bus_off",
    "kvaser library": "disconnected",
}


class Counting:
    """A healthy bus: every frame carries its number."""

    name = HEALTHY

    def __init__(self) -> None:
        self.handed = 0

    def read(self, timeout_s: float) -> FrameBatch:
        time.sleep(0.01)
        numbers = range(self.handed, self.handed + 20)
        self.handed += 20
        data = [number.to_bytes(8, "little") for number in numbers]
        return frames(FOREIGN_ID, data, time.time_ns())

    def losses(self) -> SourceLosses:
        return SourceLosses()

    def close(self) -> None:
        pass


class Script:
    """Breaks the devices, waits for the alarms, repairs them, waits for their end."""

    def __init__(self, devices: dict[str, Device], stop: threading.Event) -> None:
        self.devices, self.stop = devices, stop
        self.turns = self.garbage = 0
        self.broken_ns = self.mended_ns = 0
        self.named_ns: dict[str, int] = {}
        self.over_ns = 0
        self.last: Status | None = None
        self.deadline_s = time.monotonic() + LONG_S

    def turn(self, status: Status, live: Live | None) -> None:
        """Take what the recorder publishes ten times a second, and go on by it."""
        self.turns, self.last = self.turns + 1, status
        if time.monotonic() > self.deadline_s:
            self.stop.set()
        well = not self.broken_ns or bool(self.mended_ns)
        for name, device in self.devices.items():
            if well or name == "kvaser garbage":
                device.sent.append(self._message())
        found = {a.subject: a for a in status.alarms if a.code == EXPECTED.get(a.subject)}
        if not self.broken_ns:
            if self.turns >= 5:
                self._break()
        elif not self.mended_ns:
            self.devices["kvaser garbage"].sent.append(ValueError("bad line"))
            self.devices["kvaser bus_off"].sent.append(self._message(0x40, is_error_frame=True))
            self.garbage += 1
            for subject, alarm in found.items():
                self.named_ns.setdefault(subject, alarm.since_ns)
            if set(self.named_ns) == set(EXPECTED):
                self._repair()
        elif not found:
            self.over_ns = time.time_ns()
            self.stop.set()

    def _break(self) -> None:
        self.broken_ns = time.time_ns()
        gone = OSError(errno.ENODEV, "No such device")
        self.devices["kvaser gone"].fault = gone
        self.devices["kvaser gone"].open_fault = gone
        self.devices["gs_usb mute"].swallows = True
        self.devices["kvaser library"].fault = can.CanOperationError("x")
        self.devices["kvaser library"].open_fault = NameError("name 'canlib' is not defined")

    def _repair(self) -> None:
        self.mended_ns = time.time_ns()
        for device in self.devices.values():
            device.fault = device.open_fault = None
            device.swallows = False

    def _message(self, can_id: int = FOREIGN_ID, **other: bool) -> can.Message:
        return can.Message(
            timestamp=time.time(),
            arbitration_id=can_id,
            is_extended_id=False,
            data=bytes(8),
            **other,
        )


def test_five_sick_buses_are_named_and_well_again_and_the_sixth_loses_no_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.bus.link.SILENT_S", 2.0)  # in place of 5 s
    devices = {name: Device() for name in EXPECTED}
    healthy = Counting()

    def open_any(config: BusConfig, number: int) -> FrameSource:
        name = f"{config.interface} {config.channel}"
        if name == HEALTHY:
            return healthy
        return opener(devices[name], time.time_ns)(config, number)

    names = [name.split() for name in (HEALTHY, *EXPECTED)]
    buses = tuple(BusConfig(interface, channel, 500_000) for interface, channel in names)
    bench = replace(small_bench(), buses=buses)
    stop = threading.Event()
    script = Script(devices, stop)
    Recorder(bench, tmp_path, open_any, software="test").run(stop, script.turn)

    assert set(script.named_ns) == set(EXPECTED), script.last
    assert script.over_ns, script.last
    # Silence takes a second, and this machine may be busy; injected time holds the exact bounds.
    assert max(script.named_ns.values()) - script.broken_ns < 5e9
    assert script.over_ns - script.mended_ns < 10e9
    assert script.last is not None
    assert script.last.losses.bus_garbled == script.garbage
    reopened = {bus.name for bus in script.last.buses if bus.reopened}
    assert reopened == {"kvaser gone", "gs_usb mute", "kvaser library"}
    contents = read_journal(sorted((tmp_path / "journal").glob("*.bbj")))
    recorded = contents.frames.select(contents.frames.bus == 0)
    numbers = recorded.data.copy().view("<u8")[:, 0]
    assert np.array_equal(numbers, np.arange(healthy.handed))
    texts = [event.text for event in contents.events if event.code == "alarm"]
    for name, code in EXPECTED.items():
        assert any(text.startswith(f"{code} {name}: ") for text in texts)
