"""R9, the sources: what backends really raise, through link, watch and the whole recorder."""

from __future__ import annotations

import errno
import socket
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import can
import pytest

from daq.bench.config import BusConfig
from daq.bus.socketcan import FrameBuffers, SocketCanSource
from daq.bus.source import FrameSource, HopLosses, Link, SteadyClock
from dbc import FrameBatch

from ..adapters import Device, opener, parse_error
from ..watched_bench import FOREIGN_ID, WatchedBench

HEALTHY_TURNS, FAULTY_TURNS = 4, 20
NAMED_WITHIN_S, OVER_WITHIN_S = 1.2, 5.0
"""A bus is silent after a second, and a block takes a tenth."""


class Steady:
    """A healthy source: a turn of the bench each time it is read."""

    name = "can0"

    def __init__(self, bench: WatchedBench) -> None:
        self._bench = bench

    def read(self, timeout_s: float) -> FrameBatch:
        return self._bench.healthy()

    def losses(self) -> HopLosses:
        return HopLosses()

    def close(self) -> None:
        pass


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


class Buffers(FrameBuffers):
    """The kernel's answers, after the faults of the test."""

    faults: tuple[int, ...] = ()

    def receive(self, descriptor: int) -> int:
        if Buffers.faults:
            code, Buffers.faults = Buffers.faults[0], Buffers.faults[1:]
            raise OSError(code, "injected")
        return super().receive(descriptor)


def test_an_interface_taken_down_and_one_that_has_gone_both_come_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("daq.bus.socketcan.FrameBuffers", Buffers)
    wires: list[socket.socket] = []

    def open_socketcan(config: BusConfig, number: int) -> FrameSource:
        kernel, wire = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        wires.append(wire)
        return SocketCanSource(
            kernel, "socketcan 1", number, SteadyClock(lambda: bench.t_ns, lambda: 0)
        )

    buses = TwoBuses("socketcan", open_socketcan)
    bench = buses.bench
    buses.turn()

    def run(turns: int, bus_is_up: bool = True) -> list[str]:
        for _ in range(turns):
            if bus_is_up:
                wires[-1].send(struct.pack("=IB3x8s", FOREIGN_ID, 8, bytes(8)))
            buses.turn()
        return buses.codes("socketcan 1")

    assert run(15) == []
    Buffers.faults = (errno.ENETDOWN,)
    assert run(15, bus_is_up=False) == ["interface_down"]
    assert run(25) == []
    assert buses.links[1].facts().reopened == 0

    Buffers.faults = (errno.ENODEV,)
    assert "disconnected" in run(2, bus_is_up=False)
    assert run(30) == []
    assert buses.links[1].facts().reopened == 1
    assert bench.logged("alarm").count("disconnected socketcan 1") == 1
    assert buses.received == [400 * (bench.turns - 1), 70]
    for link in buses.links:
        link.close()
    for wire in wires:
        wire.close()
