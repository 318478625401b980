"""Playing frames on a bus: order, pacing by a false clock, back-off, giving up."""

from __future__ import annotations

from dataclasses import dataclass, field

import can
import numpy as np
import pytest

from daq.errors import BusError
from daq.replay import replay
from daq.replay.replay import play
from dbc import FrameBatch, FrameFlag

from ..formats.mixed import batch_of, mixed

START_NS = 1_700_000_000_000_000_000


@dataclass
class FalseTime:
    """A clock that only passes while somebody sleeps or sends."""

    now_s: float = 100.0
    slept_s: list[float] = field(default_factory=list)

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.slept_s.append(duration_s)
        self.now_s += duration_s + 50e-6  # a sleeper wakes late


class Wire(can.BusABC):
    """A bus that notes what it is given and when, and may refuse."""

    def __init__(self, clock: FalseTime, refusals: int = 0, error: Exception | None = None) -> None:
        self.channel_info = "wire 7"
        self.clock, self.refusals = clock, refusals
        self.error = error or can.CanOperationError("transmit buffer full")
        self.sent: list[tuple[float, can.Message]] = []
        self._is_shutdown = True  # nothing to close

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.refusals:
            self.refusals -= 1
            raise self.error
        self.clock.now_s += 20e-6
        self.sent.append((self.clock.now_s, msg))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FalseTime:
    false = FalseTime()
    monkeypatch.setattr(replay, "time", false)
    return false


def frames(n: int, step_ns: int = 250_000, start_ns: int = START_NS) -> FrameBatch:
    rows = np.arange(n)
    length = rows % 9
    data = np.where(np.arange(8) < length[:, None], (rows[:, None] + np.arange(8)) % 256, 0)
    extended = rows % 2 == 1
    return FrameBatch(
        start_ns + step_ns * rows,
        np.where(extended, 0x18DA0000 + rows, 0x100 + rows % 16).astype(np.uint32),
        np.where(extended, np.uint16(FrameFlag.EXTENDED), np.uint16(0)),
        np.zeros(n, np.uint8),
        length.astype(np.uint8),
        data.astype(np.uint8),
    )


def test_every_frame_arrives_as_it_is_and_in_order(clock: FalseTime) -> None:
    wire = Wire(clock)
    batch = frames(600)
    progress = list(play([batch.select(slice(0, 400)), batch.select(slice(400, 600))], wire, None))
    assert progress == [256, 400, 600]
    assert not clock.slept_s
    for i, (_, message) in enumerate(wire.sent):
        assert message.arbitration_id == batch.can_id[i]
        assert message.is_extended_id == (i % 2 == 1)
        assert message.dlc == len(message.data) == batch.length[i]
        assert bytes(message.data) == batch.data[i, : batch.length[i]].tobytes()
        assert message.timestamp == pytest.approx(batch.t_ns[i] * 1e-9, abs=5e-7)
        assert not message.is_error_frame
        assert not message.is_remote_frame


def test_paced_frames_leave_at_their_own_times_without_drift(clock: FalseTime) -> None:
    wire = Wire(clock)
    batch = frames(4000)
    list(play([batch], wire, 1.0))
    left_s = np.array([at for at, _ in wire.sent])
    due_s = (batch.t_ns - START_NS) * 1e-9
    late_s = left_s - 100.0 - due_s
    # 20 us to send and 50 us of waking late, at the last frame as at the first.
    assert late_s.min() >= 19e-6
    assert late_s.max() < 80e-6


def test_frames_that_are_overdue_are_sent_at_once(clock: FalseTime) -> None:
    wire = Wire(clock)
    list(play([frames(100, step_ns=5_000)], wire, 1.0))  # faster than the wire takes them
    assert len(wire.sent) == 100
    assert not clock.slept_s


def test_twice_the_speed_takes_half_the_time(clock: FalseTime) -> None:
    wire = Wire(clock)
    batch = frames(400, step_ns=1_000_000)
    list(play([batch], wire, 2.0))
    left_s = np.array([at for at, _ in wire.sent])
    due_s = (batch.t_ns - START_NS) * 1e-9 / 2
    assert np.abs(left_s - 100.0 - due_s).max() < 80e-6


def test_nobody_waits_for_a_pause_between_runs_or_for_the_past(clock: FalseTime) -> None:
    wire = Wire(clock)
    later = frames(10, start_ns=START_NS + round(20e9))
    earlier = frames(10, start_ns=START_NS - 3_600_000_000_000)
    list(play([frames(10), later, earlier], wire, 1.0))
    assert len(wire.sent) == 30
    assert clock.now_s - 100.0 < 0.02


def test_every_kind_of_frame_is_sent_as_it_is_but_no_error_frame(clock: FalseTime) -> None:
    wire = Wire(clock)
    sent = mixed(160)
    assert list(play([batch_of(sent)], wire, None)) == [140]
    kept = [frame for frame in sent if not frame.error]
    for (_, message), frame in zip(wire.sent, kept, strict=True):
        assert message.arbitration_id == frame.can_id
        assert message.is_extended_id == frame.extended
        assert message.is_remote_frame == frame.remote
        assert message.is_fd == frame.fd
        assert message.bitrate_switch == frame.brs
        assert message.error_state_indicator == frame.esi
        assert message.dlc == frame.length
        assert bytes(message.data) == frame.data


@pytest.mark.parametrize("error", [can.CanOperationError("full"), OSError(105, "no buffer space")])
def test_a_full_buffer_is_waited_for(clock: FalseTime, error: Exception) -> None:
    wire = Wire(clock, refusals=4, error=error)
    assert list(play([frames(3)], wire, None)) == [3]
    assert len(wire.sent) == 3
    assert clock.slept_s == pytest.approx([0.0005, 0.001, 0.002, 0.004])


def test_a_bus_that_takes_nothing_is_given_up(clock: FalseTime) -> None:
    with pytest.raises(BusError, match=r"wire 7: takes no frame: transmit buffer full"):
        list(play([frames(3)], Wire(clock, refusals=10_000), None))
    assert 2.0 <= sum(clock.slept_s) < 5.0


def test_stamps_of_the_sender_pass_through_a_virtual_bus() -> None:
    batch = frames(20)
    with (
        can.Bus(interface="virtual", channel="player", preserve_timestamps=True) as sender,
        can.Bus(interface="virtual", channel="player", preserve_timestamps=True) as receiver,
    ):
        assert list(play([batch], sender, None)) == [20]
        got = [receiver.recv(timeout=0) for _ in range(20)]
    stamps = np.array([message.timestamp for message in got if message is not None])
    np.testing.assert_allclose(stamps - 1.7e9, (batch.t_ns - START_NS) * 1e-9, atol=1e-6)


def test_every_receiver_of_a_virtual_bus_has_messages_of_its_own() -> None:
    """A bus that hears itself recognises its own frames by a mark on its copy."""
    sender = can.Bus("own", interface="virtual", receive_own_messages=True)
    others = [can.Bus("own", interface="virtual") for _ in range(2)]
    try:
        batch = frames(20)
        list(play([batch], sender, None))
        heard = [[bus.recv(0.0) for _ in range(20)] for bus in (sender, *others)]
    finally:
        for bus in (sender, *others):
            bus.shutdown()
    for number, messages in enumerate(heard):
        for i, message in enumerate(messages):
            assert message is not None
            assert message.arbitration_id == batch.can_id[i]
            assert bytes(message.data) == batch.data[i, : batch.length[i]].tobytes()
            assert message.is_rx == (number > 0)
