"""Sending frames: gaps, steps back, several buses and patience, each limit on both sides."""

from __future__ import annotations

from dataclasses import replace

import can
import numpy as np
import pytest

from daq.errors import BusError
from daq.replay import replay
from daq.replay.replay import play
from dbc import FrameBatch

from .test_replay import START_NS, FalseTime, Wire, frames


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FalseTime:
    false = FalseTime()
    monkeypatch.setattr(replay, "time", false)
    return false


def _at(times_s: list[float]) -> FrameBatch:
    batch = frames(len(times_s))
    return replace(batch, t_ns=np.array([START_NS + round(t * 1e9) for t in times_s]))


@pytest.mark.parametrize(
    ("times_s", "passed_s"),
    [
        ([0.0, 9.9], 9.9),
        ([0.0, 10.1], 0.0),  # what lies between two runs is skipped
        ([0.0, 10.1, 11.0], 0.9),
        ([0.0, 5.0, 4.1, 5.2], 5.2),  # a step back within a second is disorder
        ([0.0, 5.0, 3.9, 5.2], 6.3),  # a longer one is another log
        ([0.0, 9.0, 18.0], 18.0),
    ],
)
def test_how_long_a_recording_takes(
    clock: FalseTime, times_s: list[float], passed_s: float
) -> None:
    list(play([_at(times_s)], Wire(clock), 1.0))
    assert clock.now_s - 100.0 == pytest.approx(passed_s, abs=1e-3)


def test_a_frame_goes_to_the_bus_of_its_number_or_to_the_first(clock: FalseTime) -> None:
    wires = [Wire(clock), Wire(clock), Wire(clock)]
    batch = replace(frames(5), bus=np.array([0, 2, 1, 3, 255], np.uint8))
    assert list(play([batch], wires[0], None, *wires[1:])) == [5]
    sent = [[message.arbitration_id for _, message in wire.sent] for wire in wires]
    assert sent == [[0x100, 0x18DA0003, 0x104], [0x102], [0x18DA0001]]


@pytest.mark.parametrize(("refusals", "taken"), [(12, True), (13, False)])
def test_a_bus_has_two_seconds_to_take_a_frame(
    clock: FalseTime, refusals: int, taken: bool
) -> None:
    # Pauses of 0.5 ms, 1 ms, 2 ms ...: twelve of them are 2.0475 s, eleven 1.0235 s.
    wire = Wire(clock, refusals=refusals)
    if taken:
        assert list(play([frames(1)], wire, None)) == [1]
    else:
        with pytest.raises(BusError):
            list(play([frames(1)], wire, None))
    assert sum(clock.slept_s) == pytest.approx(2.0475)


def test_a_frame_that_a_bus_can_never_take_ends_it_at_once(clock: FalseTime) -> None:
    wire = Wire(clock, refusals=1, error=ValueError("no CAN FD"))
    with pytest.raises(BusError, match="no CAN FD"):
        list(play([frames(1)], wire, None))
    assert not clock.slept_s


def test_patience_begins_anew_with_each_frame(clock: FalseTime) -> None:
    class Moody(Wire):
        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            super().send(msg, timeout)
            self.refusals = 3

    list(play([frames(2)], Moody(clock, refusals=3), None))
    assert clock.slept_s == pytest.approx([0.0005, 0.001, 0.002] * 2)


def test_progress_is_reported_each_256_frames(clock: FalseTime) -> None:
    assert list(play([frames(257), frames(256)], Wire(clock), None)) == [256, 257, 513]
