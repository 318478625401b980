"""A recording played as a bus: when each frame comes, by a false clock, and which are played."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses, SourceLosses
from daq.errors import InputError
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from daq.replay import recorded_source
from daq.replay.recorded_source import RecordedSource, whole_frames
from daq.replay.replay import recorded_frames
from daq.sessions import Session
from dbc import FrameBatch

from ..small_session import small_session
from .test_replay import FalseTime

S = 1_000_000_000
START_NS = 1_800_000_000 * S


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FalseTime:
    false = FalseTime()
    monkeypatch.setattr(recorded_source, "time", false)
    return false


def _frames(times_s: list[float], bus: list[int] | None = None) -> FrameBatch:
    n = len(times_s)
    return FrameBatch(
        np.array([START_NS + round(t * S) for t in times_s], np.int64),
        np.arange(n, dtype=np.uint32),
        np.zeros(n, np.uint16),
        np.array(bus or [0] * n, np.uint8),
        np.zeros(n, np.uint8),
        np.zeros((n, 8), np.uint8),
    )


def test_time_stamps_keep_their_distances_and_long_gaps_become_three_seconds(
    clock: FalseTime,
) -> None:
    source = RecordedSource(_frames([5, 6, 8.9, 11.9, 15, 14, 14.5]), 0, 1.0, 7 * S)
    assert not source.done
    clock.now_s += 20
    frames = source.read(0.0)
    seconds = [0, 1, 3.9, 6.9, 9.9, 9.9, 10.4]
    assert frames.t_ns.tolist() == [7 * S + round(t * S) for t in seconds]
    assert frames.can_id.tolist() == list(range(7))
    assert source.done
    assert source.losses() == SourceLosses()
    assert source.name == "recording"


def test_frames_of_other_buses_take_their_time_and_are_left_out(clock: FalseTime) -> None:
    source = RecordedSource(_frames([0, 2, 4, 5], [1, 0, 1, 0]), 0, 1.0, 0)
    clock.now_s += 20
    assert source.read(0.0).t_ns.tolist() == [2 * S, 5 * S]


@pytest.mark.parametrize(("speed", "second_s"), [(1.0, 0.5), (2.0, 0.25), (0.5, 1.0)])
def test_the_first_frame_comes_after_a_second_and_the_others_at_their_speed(
    clock: FalseTime, speed: float, second_s: float
) -> None:
    source = RecordedSource(_frames([0, 0.5]), 0, speed, 0)
    assert source.read(10.0).can_id.tolist() == [0]
    assert source.read(10.0).can_id.tolist() == [1]
    assert clock.slept_s == pytest.approx([1.0, second_s], abs=1e-3)


def test_nobody_waits_longer_than_asked_or_shorter_than_it_takes_to_gather(
    clock: FalseTime,
) -> None:
    source = RecordedSource(_frames([0, 0.001, 0.5]), 0, 1.0, 0)
    assert len(source.read(0.3)) == 0
    assert source.read(9.0).can_id.tolist() == [0]
    assert source.read(9.0).can_id.tolist() == [1]
    assert len(source.read(0.25)) == 0
    assert source.read(9.0).can_id.tolist() == [2]
    assert len(source.read(0.125)) == 0
    slept = [0.3, 0.7, 0.01, 0.25, 0.239, 0.125]
    assert clock.slept_s == pytest.approx(slept, abs=1e-3)


def test_a_block_has_no_more_than_2048_frames(clock: FalseTime) -> None:
    source = RecordedSource(_frames([0.0] * 3000), 0, 1.0, 0)
    clock.now_s += 2
    assert [len(source.read(0.0)) for _ in range(3)] == [2048, 952, 0]


def _session(*spans: tuple[float, float]) -> Session:
    """Return a session with a run of each span, a frame each tenth of a second."""
    runs = []
    for number, (first_s, last_s) in enumerate(spans, start=1):
        times = np.arange(round(10 * first_s), round(10 * last_s) + 1) / 10
        run = small_session().runs[0]
        t0_ns = START_NS + round(first_s * S)
        runs.append(replace(run, repeat=number, t0_ns=t0_ns, frames=_frames(times.tolist())))
    return replace(small_session(), runs=tuple(runs))


def _seconds(frames: FrameBatch) -> list[float]:
    return [round((t - START_NS) / S, 3) for t in frames.t_ns.tolist()]


def test_frames_of_runs_that_overlap_come_once_and_in_order() -> None:
    session = _session((5.0, 5.4), (1.0, 1.3), (1.2, 1.5), (1.3, 1.4))
    parts = [_seconds(part) for part in recorded_frames(session)]
    assert parts == [[1.0, 1.1, 1.2, 1.3], [1.4, 1.5], [5.0, 5.1, 5.2, 5.3, 5.4]]


def test_a_run_without_frames_is_passed_over() -> None:
    session = _session((1.0, 1.1), (3.0, 3.1))
    empty = replace(session.runs[0], frames=FrameBatch.empty(), t0_ns=START_NS + 2 * S)
    mixed = replace(session, runs=(*session.runs, empty))
    assert [len(part) for part in recorded_frames(mixed)] == [2, 2]


def _journal(folder: Path, times_s: list[float], began_ns: int = START_NS) -> None:
    head = JournalHead("", "", "test", began_ns, 0)
    limits = RecorderConfig(reserve_bytes=0.0)
    with JournalWriter(folder, head, limits) as journal:
        for time_s in times_s:
            journal.append(_frames([time_s]), HopLosses())


def test_the_frames_around_the_runs_are_played_too(tmp_path: Path) -> None:
    _journal(tmp_path / "journal", [0.5, 2.9, 3.1, 5.0, 5.1, 6.0, 7.0, 7.1, 9.0, 9.2])
    session = _session((5.0, 5.1), (7.0, 7.1))
    found = _seconds(whole_frames(session, tmp_path / "car.h5"))
    assert found == [3.1, 5.0, 5.1, 6.0, 7.0, 7.1, 9.0]


@pytest.mark.parametrize("times_s", [[], [5.0], [5.0, 90.0]])
def test_a_session_whose_journal_has_less_than_it_cannot_be_played_alone(
    tmp_path: Path, times_s: list[float]
) -> None:
    if times_s:
        _journal(tmp_path / "journal", times_s)
    with pytest.raises(InputError, match=r"car\.h5"):
        whole_frames(_session((5.0, 5.1)), tmp_path / "car.h5")


def test_the_journal_is_the_recording_that_has_the_runs(tmp_path: Path) -> None:
    for began, times in enumerate(([5.0], [4.0, 5.0, 5.1], [5.0, 5.1, 6.0, 6.1])):
        _journal(tmp_path / "journal", times, START_NS + began)
    found = _seconds(whole_frames(_session((5.0, 5.1)), tmp_path / "car.h5"))
    assert found == [4.0, 5.0, 5.1]


def test_a_session_without_frames_cannot_be_played(tmp_path: Path) -> None:
    _journal(tmp_path / "journal", [5.0])
    session = small_session(FrameBatch.empty())
    with pytest.raises(InputError, match="cannot be replayed alone"):
        whole_frames(session, tmp_path / "car.h5")
