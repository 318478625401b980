"""R9, the sources: what backends really raise, through link, watch and the whole recorder."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import can
import pytest

from daq.bench.config import BusConfig
from daq.bus.source import FrameSource, Link
from dbc import FrameBatch

from ..adapters import Device, opener, parse_error
from ..recorder_run import Script
from ..watched_bench import FOREIGN_ID, WatchedBench

HEALTHY_TURNS, FAULTY_TURNS = 4, 20
NAMED_WITHIN_S, OVER_WITHIN_S = 1.2, 5.0
"""A bus is silent after a second, and a block takes a tenth."""


class Steady(Script):
    """A healthy source: a turn of the bench each time it is read."""

    def __init__(self, bench: WatchedBench) -> None:
        super().__init__([])
        self._bench = bench

    def read(self, timeout_s: float) -> FrameBatch:
        return self._bench.healthy()


class TwoBuses:
    """The bench on a healthy bus, and a sick bus beside it."""

    def __init__(self, interface: str, open_sick: Callable[[BusConfig, int], FrameSource]) -> None:
        self.bench = WatchedBench(["can0", "sick"])
        self.links = [
            Link(BusConfig("virtual", "0", 500_000), 0, lambda *_: Steady(self.bench), self.clock),
            Link(BusConfig(interface, "1", 500_000), 1, open_sick, self.clock),
        ]
        self.received = [0, 0]

    def clock(self) -> float:
        return self.bench.now_s

    def turn(self) -> None:
        """Read both, as their threads would, and watch."""
        batches = [link.read(0.0) for link in self.links]
        for number, batch in enumerate(batches):
            self.received[number] += len(batch)
        self.bench.links = [link.facts() for link in self.links]
        self.bench.turn(FrameBatch.concatenate(batches))

    def codes(self, subject: str) -> list[str]:
        """Return the alarms of a subject."""
        return [alarm.code for alarm in self.bench.alarms if alarm.subject == subject]


def message(bench: WatchedBench, **other: Any) -> can.Message:
    fields = {"arbitration_id": FOREIGN_ID, "is_extended_id": False, "data": bytes(8), **other}
    return can.Message(timestamp=bench.t_ns * 1e-9, **fields)


def error_frame(bench: WatchedBench, error_class: int) -> can.Message:
    """Return an error frame as python-can's socketcan hands it out."""
    return message(bench, arbitration_id=error_class, is_error_frame=True)


@dataclass(frozen=True)
class Sickness:
    """A fault of the device, each turn of it, and what is to be counted."""

    code: str
    breaks: Callable[[Device], object] = lambda _: None
    each_turn: Callable[[WatchedBench], list[can.Message | Exception]] = field(default=lambda _: [])
    count: int = 0
    opened_again: bool = False
    interface: str = "kvaser"


def set_fault(error: Exception, open_error: Exception | None = None) -> Callable[[Device], None]:
    def breaks(device: Device) -> None:
        device.fault, device.open_fault = error, open_error

    return breaks


def swallow(device: Device) -> None:
    device.swallows = True


SICKNESSES = {
    "every recv fails": Sickness(
        "disconnected", set_fault(can.CanOperationError("bus gone")), opened_again=True
    ),
    "no such device": Sickness(
        "disconnected", set_fault(OSError(errno.ENODEV, "No such device")), opened_again=True
    ),
    "usb error swallowed": Sickness("bus_silent", swallow, opened_again=True, interface="gs_usb"),
    "cable pulled": Sickness("bus_silent"),
    "bus-off": Sickness("bus_off", each_turn=lambda b: [error_frame(b, 0x40)], count=FAULTY_TURNS),
    "ValueError of a parser": Sickness(
        "garbled", each_turn=lambda b: [message(b), ValueError("int()")], count=FAULTY_TURNS
    ),
    "a byte that is no text": Sickness(
        "garbled", each_turn=lambda b: [parse_error(), message(b)], count=FAULTY_TURNS
    ),
    "length code 9": Sickness(
        "garbled", each_turn=lambda b: [message(b), message(b, dlc=9)], count=FAULTY_TURNS
    ),
    "error frames only": Sickness("check_bitrate", each_turn=lambda b: [error_frame(b, 0x88)]),
}


@pytest.mark.parametrize("name", SICKNESSES)
def test_a_sick_backend_is_named_counted_and_well_again_and_the_other_bus_never_knows(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.bus.interfaces.GATHER_S", 0.0)  # no real time passes here
    sickness, device = SICKNESSES[name], Device()
    clock: list[WatchedBench] = []
    buses = TwoBuses(sickness.interface, opener(device, lambda: clock[0].t_ns))
    bench = buses.bench
    clock.append(bench)
    for _ in range(HEALTHY_TURNS):
        device.sent.append(message(bench))
        buses.turn()
    sick = buses.links[1].facts().name
    assert buses.codes(sick) == []
    received = buses.received[1]

    began_s, named_s = bench.now_s, None
    sickness.breaks(device)
    for _ in range(FAULTY_TURNS):
        device.sent.extend(sickness.each_turn(bench))
        buses.turn()
        if named_s is None and sickness.code in buses.codes(sick):
            named_s = bench.now_s
    alarm = bench.alarm(sickness.code, sick)
    assert named_s is not None, bench.alarms
    assert alarm is not None
    assert named_s - began_s <= NAMED_WITHIN_S
    assert alarm.count == sickness.count

    device.fault = device.open_fault = None
    device.swallows = False
    device.sent.clear()
    over_s = bench.now_s
    while buses.codes(sick) != [] and bench.now_s < over_s + OVER_WITHIN_S:
        device.sent.append(message(bench))
        buses.turn()
    assert buses.codes(sick) == []
    assert buses.received[1] > received
    assert (device.opened > 1) == sickness.opened_again
    assert buses.links[1].facts().reopened == device.opened - 1
    # Nothing of the healthy bus was lost or late; the first turn opened it.
    assert buses.received[0] == 400 * (bench.turns - 1)
    assert bench.state.buses[0].frames == buses.received[0]
    assert buses.codes("virtual 0") == []
    assert bench.state.sensors_alive == 6
