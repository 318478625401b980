"""The limits of the recorder in numbers, with a case on each side of every one."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.bus.clock import Now
from daq.bus.source import SourceLosses
from daq.control.messages import Reply
from daq.control.orders import Pause
from daq.recorder.derivation import Derivation
from daq.recorder.judging import RecentFrames, RecentLosses, RecentSamples
from daq.recorder.live import LiveRing
from daq.recorder.orders import OrderError, OrderQueue
from daq.recorder.readers import Piece, PieceQueue
from daq.recorder.recording import FaultBarrier
from daq.runs import Losses
from dbc.frames import FrameBatch

from ..crash_frames import block

S = 1_000_000_000


def now(monotonic_s: float) -> Now:
    return Now(0, monotonic_s)


def fail() -> object:
    raise ValueError("broken")


def test_a_failing_consumer_is_reported_once_a_second_with_a_count() -> None:
    barrier = FaultBarrier()
    barrier.run("a", now(10.0), fail)
    (event,) = barrier.events(now(10.0), 77)
    assert (event.t_ns, event.code, event.value) == (77, "consumer_failed", 1)
    assert event.text == "a: ValueError('broken')"
    barrier.run("a", now(10.1), fail)
    barrier.run("a", now(10.2), fail)
    assert barrier.events(now(10.99), 78) == ()
    (event,) = barrier.events(now(11.0), 78)
    assert event.value == 2
    assert barrier.events(now(20.0), 79) == ()


def test_a_consumer_works_again_five_seconds_after_its_last_failure() -> None:
    barrier = FaultBarrier()
    assert barrier.value("a", now(10.0), 3, lambda: 4) == 4
    assert barrier.failed(now(10.0)) == {}
    barrier.run("a", now(10.0), fail)
    assert barrier.failed(now(14.99)) == {"a": "ValueError('broken')"}
    assert barrier.failed(now(15.0)) == {}


def piece(frames: int, width: int = 8) -> Piece:
    batch = FrameBatch.concatenate([block(0, frames)])
    data = np.zeros((frames, width), np.uint8)
    return Piece(0, replace(batch, data=data), SourceLosses(), 0, 0.0)


def test_the_queue_has_room_for_4096_blocks() -> None:
    pieces = PieceQueue()
    one = piece(1)
    assert all(pieces.put(one) for _ in range(4096))
    assert not pieces.put(one)
    assert (pieces.status.blocks, pieces.status.high, pieces.status.room) == (4096, 4096, 4096)
    assert len(pieces.take(1)) == 1
    assert pieces.put(one)
    assert not pieces.put(one)


def test_the_queue_has_room_for_128_megabytes() -> None:
    pieces = PieceQueue()
    large = piece(500_000, 64)  # 40 MB with 16 bytes for each frame
    assert [pieces.put(large) for _ in range(4)] == [True, True, True, False]
    assert pieces.put(piece(177_000, 64))
    assert not pieces.put(piece(1_000, 64))
    assert [len(p.frames) for p in pieces.take(500_001)] == [500_000, 500_000]


def ring_of(*blocks: tuple[Sequence[float], Sequence[float]]) -> LiveRing:
    ring = LiveRing(["acc"])
    for times_s, values in blocks:
        t_ns = np.rint(np.array(times_s) * S).astype(np.int64)
        ring.add({"acc": (t_ns, np.array(values, float))})
    return ring


def test_a_bin_has_lowest_and_highest_value_of_20_ms() -> None:
    live = ring_of(([0.0, 0.019, 0.02, 0.2], [1.0, 3.0, 5.0, 0.0])).fresh()
    assert live is not None
    assert (live.first_bin, live.bin_s) == (0, 0.02)
    assert live.lanes[0].low[:3] == (1.0, 5.0, None)
    assert live.lanes[0].high[:3] == (3.0, 5.0, None)


def test_a_bin_is_published_once_when_100_ms_older_than_the_newest() -> None:
    ring = ring_of(([0.0], [1.0]))
    assert ring.fresh() is None
    ring = ring_of(([0.0, 0.09], [1.0, 2.0]))  # the newest bin is 4
    assert ring.fresh() is None
    ring = ring_of(([0.0, 0.11], [1.0, 2.0]))  # 5: bin 0 is complete
    live = ring.fresh()
    assert live is not None
    assert live.lanes[0].low == (1.0,)
    assert ring.fresh() is None


def test_at_most_ten_seconds_are_published_at_once_and_a_minute_is_kept() -> None:
    ring = ring_of(([0.0, 30.0, 59.99], [1.0, 2.0, 3.0]))
    live = ring.fresh()
    assert live is not None
    assert len(live.lanes[0].low) == 500
    assert live.first_bin == 2995 - 500
    history = ring.history(60.0)
    assert history.first_bin == 0
    assert history.lanes[0].low[0] == 1.0
    ring.add({"acc": (np.array([60 * S]), np.array([4.0]))})  # one bin more than a minute
    assert ring.history(60.0).first_bin == 1


def test_values_are_rounded_to_four_digits_and_those_that_are_not_finite_left_out() -> None:
    values = [1.23456, np.nan, np.inf, -0.000123456, 0.0]
    live = ring_of(([0.0, 0.02, 0.04, 0.06, 0.3], values)).fresh()
    assert live is not None
    assert live.lanes[0].low[:4] == (1.235, None, None, -0.0001235)


def test_a_clock_set_by_more_than_a_minute_restarts_the_ring() -> None:
    ring = ring_of(([100.0], [1.0]), ([200.0, 200.2], [2.0, 3.0]))
    history = ring.history(60.0)
    assert history.first_bin == 10_000
    ring = ring_of(([200.0], [1.0]), ([100.0, 100.2], [2.0, 3.0]))
    assert ring.history(60.0).first_bin == 5_000


def frames_at(t_s: float, count: int = 1) -> FrameBatch:
    batch = block(0, count)
    return replace(batch, t_ns=np.full(count, round(t_s * S)))


def test_raw_frames_are_kept_for_ten_seconds() -> None:
    recent = RecentFrames()
    assert len(recent.last(10.0)) == 0
    for t_s in (0.0, 1.0, 10.0):
        recent.add(frames_at(t_s))
    assert (recent.last(10.0).t_ns // S).tolist() == [0, 1, 10]
    assert (recent.last(9.0).t_ns // S).tolist() == [1, 10]
    assert (recent.last(8.9).t_ns // S).tolist() == [10]
    recent.add(frames_at(10.1))
    assert (recent.last(20.0).t_ns // S).tolist() == [1, 10, 10]


def test_raw_frames_of_a_later_time_go_when_the_clock_is_set_back() -> None:
    recent = RecentFrames()
    recent.add(frames_at(51.0))
    recent.add(frames_at(50.0))
    assert len(recent.last(10.0)) == 2
    recent.add(frames_at(49.9))
    assert sorted((recent.last(10.0).t_ns * 10 // S).tolist()) == [499, 500]


def test_raw_frames_take_at_most_64_megabytes() -> None:
    recent = RecentFrames()
    for _ in range(3):
        recent.add(frames_at(1.0, 1_000_000))  # 24 MB each
    assert len(recent.last(1.0)) == 2_000_000


def test_samples_are_kept_for_a_second_longer_than_a_run() -> None:
    samples = RecentSamples(kept_s=4.0)
    for t_s in (0.0, 5.0, 5.0):
        samples.add(round(t_s * S), {"a": (np.array([round(t_s * S)]), np.ones(1))})
    assert samples.between(0, 6 * S)["a"][0].tolist() == [0, 5 * S, 5 * S]
    for t_s in (5.1, 5.1):
        samples.add(round(t_s * S), {"a": (np.array([round(t_s * S)]), np.ones(1))})
    assert samples.between(0, 6 * S)["a"][0].min() == 5 * S
    assert samples.between(5 * S, round(5.1 * S))["a"][0].tolist() == [5 * S, 5 * S]


def test_losses_of_the_blocks_of_a_span_are_counted() -> None:
    losses = RecentLosses(kept_s=4.0)
    for second, missing in enumerate([0, 2, 5, 9]):
        losses.add(second * S, second * S + S // 2, Losses(counter_gaps=missing))
    assert losses.between(1 * S, 3 * S // 2).counter_gaps == 2
    assert losses.between(1 * S, 2 * S).counter_gaps == 5  # with those of the pause up to 2 s
    assert losses.between(1 * S, 7 * S // 4).counter_gaps == 4  # half of 3 in half of the pause
    assert losses.between(2 * S, 4 * S).counter_gaps == 7


def test_orders_come_in_turn_and_a_closed_queue_refuses_them() -> None:
    orders = OrderQueue()
    assert orders.take() is None
    assert not orders.arrived.is_set()
    first, second, third = (orders.put(Pause(), name) for name in ("Ann", "Ben", "Cho"))
    assert orders.arrived.is_set()
    assert second.cancel()
    pending = orders.take()
    assert pending is not None
    assert (pending.by, pending.answer) == ("Ann", first)
    orders.close()
    refused: Future[Reply] = orders.put(Pause(), "Dee")
    assert isinstance(refused.exception(0), OrderError)
    pending = orders.take()
    assert pending is not None
    assert pending.by == "Cho"
    assert orders.take() is None
    assert not third.cancelled()


@pytest.mark.parametrize(("megabytes", "patience_s"), [(0, 600.0), (2, 602.0)])
def test_a_session_file_gets_ten_minutes_and_a_second_for_each_megabyte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, megabytes: int, patience_s: float
) -> None:
    segment = tmp_path / "journal_0001.bbj"
    segment.write_bytes(bytes(megabytes * 1_000_000))
    clock = iter([100.0, 100.0 + patience_s - 0.5, 100.0 + patience_s + 0.5])
    killed = []

    class Process:
        def __init__(self, *_: object, **__: object) -> None:
            pass

        def poll(self) -> None:
            return None

        def kill(self) -> None:
            killed.append(True)

    monkeypatch.setattr("daq.recorder.derivation.subprocess.Popen", Process)
    monkeypatch.setattr("daq.recorder.derivation.time.monotonic", lambda: next(clock))
    derivation = Derivation()
    derivation.begin(tmp_path / "session_0001.h5", [segment], "a", 1)
    derivation.poll()
    assert not killed
    derivation.poll()
    assert killed == [True]
    assert "took too long" in derivation.status.text
