"""Playing frames on a bus: order, pacing by a false clock, back-off, giving up."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import can
import numpy as np
import pytest

from daq import replay as room
from daq.bench.config import RecorderConfig
from daq.bus.source import BusError, HopLosses
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from daq.replay import RecordedSource, play, whole_frames
from daq.sessions import Session
from dbc import FrameBatch
from dbc.words import InputError

from .formats.mixed import batch_of, mixed
from .small_campaign import frames_at
from .small_session import small_session

START_NS = 1_700_000_000_000_000_000
S = 1_000_000_000


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
    monkeypatch.setattr(room, "time", false)
    return false


def frames_after(times_s: list[float], bus: list[int] | None = None) -> FrameBatch:
    t_ns = [START_NS + round(t * S) for t in times_s]
    return frames_at(t_ns, can_id=np.arange(len(t_ns)), length=0, bus=bus or 0)


def test_paced_frames_leave_at_their_own_times_without_drift(clock: FalseTime) -> None:
    wire = Wire(clock)
    batch = frames_after([0.00025 * k for k in range(4000)])
    list(play([batch], wire, 1.0))
    left_s = np.array([at for at, _ in wire.sent])
    due_s = (batch.t_ns - START_NS) * 1e-9
    late_s = left_s - 100.0 - due_s
    # 20 us to send and 50 us of waking late, at the last frame as at the first.
    assert late_s.min() >= 19e-6
    assert late_s.max() < 80e-6


def test_every_kind_of_frame_is_sent_as_it_is_but_no_error_frame(clock: FalseTime) -> None:
    wire = Wire(clock)
    sent = mixed(640)
    assert list(play([batch_of(sent)], wire, None)) == [256, 512, 560]
    assert not clock.slept_s
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


# Sending frames: gaps, steps back, several buses and patience, each limit on both sides -----------


def test_a_frame_goes_to_the_bus_of_its_number_or_to_the_first(clock: FalseTime) -> None:
    wires = [Wire(clock), Wire(clock), Wire(clock)]
    batch = frames_after([0.0] * 5, [0, 2, 1, 3, 255])
    assert list(play([batch], wires[0], None, *wires[1:])) == [5]
    sent = [[message.arbitration_id for _, message in wire.sent] for wire in wires]
    assert sent == [[0, 3, 4], [2], [1]]


@pytest.mark.parametrize(("refusals", "taken"), [(12, True), (13, False)])
def test_a_bus_has_two_seconds_to_take_a_frame(
    clock: FalseTime, refusals: int, taken: bool
) -> None:
    # Pauses of 0.5 ms, 1 ms, 2 ms ...: twelve of them are 2.0475 s, eleven 1.0235 s.
    wire = Wire(clock, refusals=refusals)
    if taken:
        assert list(play([frames_after([0.0])], wire, None)) == [1]
    else:
        with pytest.raises(BusError):
            list(play([frames_after([0.0])], wire, None))
    assert sum(clock.slept_s) == pytest.approx(2.0475)


# A recording played as a bus: when each frame comes, by a false clock, and which are played -------


def test_time_stamps_keep_their_distances_and_long_gaps_become_three_seconds(
    clock: FalseTime,
) -> None:
    source = RecordedSource(frames_after([5, 6, 8.9, 11.9, 15, 14, 14.5]), 0, 1.0, 7 * S)
    assert not source.done
    clock.now_s += 20
    frames = source.read(0.0)
    seconds = [0, 1, 3.9, 6.9, 9.9, 9.9, 10.4]
    assert frames.t_ns.tolist() == [7 * S + round(t * S) for t in seconds]
    assert frames.can_id.tolist() == list(range(7))
    assert source.done
    assert source.losses() == HopLosses()


@pytest.mark.parametrize(("speed", "second_s"), [(1.0, 0.5), (2.0, 0.25), (0.5, 1.0)])
def test_the_first_frame_comes_after_a_second_and_the_others_at_their_speed(
    clock: FalseTime, speed: float, second_s: float
) -> None:
    source = RecordedSource(frames_after([0, 0.5]), 0, speed, 0)
    assert source.read(10.0).can_id.tolist() == [0]
    assert source.read(10.0).can_id.tolist() == [1]
    assert clock.slept_s == pytest.approx([1.0, second_s], abs=1e-3)


def _session(*spans: tuple[float, float]) -> Session:
    """Return a session with a run of each span, a frame each tenth of a second."""
    runs = []
    for number, (first_s, last_s) in enumerate(spans, start=1):
        times = np.arange(round(10 * first_s), round(10 * last_s) + 1) / 10
        run = small_session().runs[0]
        t0_ns = START_NS + round(first_s * S)
        runs.append(replace(run, repeat=number, t0_ns=t0_ns, frames=frames_after(times.tolist())))
    return replace(small_session(), runs=tuple(runs))


def _seconds(frames: FrameBatch) -> list[float]:
    return [round((t - START_NS) / S, 3) for t in frames.t_ns.tolist()]


def _journal(folder: Path, times_s: list[float], began_ns: int = START_NS) -> None:
    head = JournalHead("", "", "test", began_ns, 0)
    limits = RecorderConfig(reserve_bytes=0.0)
    with JournalWriter(folder, head, limits) as journal:
        for time_s in times_s:
            journal.append(frames_after([time_s]), HopLosses())


def test_the_frames_around_the_runs_are_played_from_the_recording_that_has_the_runs(
    tmp_path: Path,
) -> None:
    times_s = [0.5, 2.9, 3.1, 5.0, 5.1, 6.0, 7.0, 7.1, 9.0, 9.2]
    for began_ns, times in enumerate(([5.0], times_s, [5.0, 5.1, 6.0, 7.0, 7.1])):
        _journal(tmp_path / "journal", times, START_NS + began_ns)
    session = _session((5.0, 5.1), (7.0, 7.1))
    played = _seconds(whole_frames(session, tmp_path / "car.h5"))
    assert played == [3.1, 5.0, 5.1, 6.0, 7.0, 7.1, 9.0]


@pytest.mark.parametrize(
    ("times_s", "spans"),
    [([], [(5.0, 5.1)]), ([5.0], [(5.0, 5.1)]), ([5.0, 90.0], [(5.0, 5.1)]), ([5.0], [])],
)
def test_a_session_whose_journal_has_less_than_it_cannot_be_played_alone(
    tmp_path: Path, times_s: list[float], spans: list[tuple[float, float]]
) -> None:
    if times_s:
        _journal(tmp_path / "journal", times_s)
    with pytest.raises(InputError, match=r"car\.h5.*cannot be replayed alone"):
        whole_frames(_session(*spans), tmp_path / "car.h5")


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
    list(play([frames_after(times_s)], Wire(clock), 1.0))
    assert clock.now_s - 100.0 == pytest.approx(passed_s, abs=1e-3)


def test_a_frame_that_a_bus_can_never_take_ends_it_at_once(clock: FalseTime) -> None:
    wire = Wire(clock, refusals=1, error=ValueError("no CAN FD"))
    with pytest.raises(BusError, match=r"no CAN FD \(name a bus"):
        list(play([frames_after([0.0])], wire, None))
    assert not clock.slept_s


def test_patience_begins_anew_with_each_frame(clock: FalseTime) -> None:
    class Moody(Wire):
        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            super().send(msg, timeout)
            self.refusals = 3

    list(play([frames_after([0.0, 0.1])], Moody(clock, refusals=3), None))
    assert clock.slept_s == pytest.approx([0.0005, 0.001, 0.002] * 2)


def test_a_read_waits_as_long_as_asked_at_most_and_until_frames_gather(clock: FalseTime) -> None:
    source = RecordedSource(frames_after([0, 0.001, 0.5]), 0, 1.0, 0)
    assert len(source.read(0.3)) == 0
    assert source.read(9.0).can_id.tolist() == [0]
    assert source.read(9.0).can_id.tolist() == [1]
    assert len(source.read(0.25)) == 0
    assert source.read(9.0).can_id.tolist() == [2]
    assert len(source.read(0.125)) == 0
    slept = [0.3, 0.7, 0.01, 0.25, 0.239, 0.125]
    assert clock.slept_s == pytest.approx(slept, abs=1e-3)


def test_frames_of_other_buses_are_left_out_and_a_block_has_at_most_2048(clock: FalseTime) -> None:
    source = RecordedSource(frames_after([0, 2, 4, 5], [1, 0, 1, 0]), 0, 1.0, 0)
    clock.now_s += 20
    assert source.read(0.0).t_ns.tolist() == [2 * S, 5 * S]
    source = RecordedSource(frames_after([0.0] * 3000), 0, 1.0, 0)
    clock.now_s += 2
    assert [len(source.read(0.0)) for _ in range(3)] == [2048, 952, 0]


def test_frames_of_runs_that_overlap_come_once_and_in_order() -> None:
    session = _session((5.0, 5.4), (1.0, 1.3), (1.2, 1.5), (1.3, 1.4))
    empty = replace(session.runs[0], frames=FrameBatch.empty(), t0_ns=START_NS + 2 * S)
    seconds = [1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 5.0, 5.1, 5.2, 5.3, 5.4]
    assert _seconds(replace(session, runs=(*session.runs, empty)).frames) == seconds
