"""R11, the readers: no wait is measured by a clock that can be set."""

from __future__ import annotations

import itertools
import socket
from collections import deque

import pytest

from daq.bus.interfaces import PythonCanSource, doze_for
from daq.python_can import can

from ..sick_bus import Device, SickBus
from ..watched_bench import START_NS


def message(can_id: int = 2) -> can.Message:
    return can.Message(timestamp=START_NS * 1e-9, arbitration_id=can_id, is_extended_id=False)


def test_a_clock_set_back_an_hour_makes_no_read_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = itertools.count(0.0, -3600.0)
    monkeypatch.setattr("can.bus.time", lambda: next(wall))

    trusting = SickBus(Device(sent=deque([message()])))
    trusting.set_filters([{"can_id": 1, "can_mask": 0x7FF}])  # so that `recv` waits once more
    trusting.device.sent.append(message(1))
    assert trusting.recv(0.1) is not None
    assert trusting.waits == [0.1, pytest.approx(3600.1)]  # what python-can does

    waiting = SickBus(Device(sent=deque([message()] * 3)))
    source = PythonCanSource(waiting, "kvaser 1", 0, lambda: START_NS)
    assert len(source.read(0.1)) == 3
    assert max(wait for wait in waiting.waits if wait is not None) <= 0.1

    polled = SickBus(Device())  # backends that measure their own waiting by the wall clock
    source = PythonCanSource(polled, "pcan 1", 0, doze=doze_for(polled, "pcan"))
    assert len(source.read(0.02)) == 0
    assert set(polled.waits) == {0.0}

    kernel, wire = socket.socketpair()
    with kernel, wire:
        monkeypatch.setattr(polled, "fileno", kernel.fileno)
        source = PythonCanSource(polled, "pcan 1", 0, lambda: START_NS, doze_for(polled, "pcan"))
        polled.device.sent.append(message())
        wire.send(b"x")
        assert len(source.read(60.0)) == 1
    assert set(polled.waits) == {0.0}
