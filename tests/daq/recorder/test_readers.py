"""What a reader hands over, counts and drops, read by read; the sum over all readers."""

from __future__ import annotations

import itertools
import re
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daq.alarms.watch import with_not_recording
from daq.bench.config import Bench, BusConfig
from daq.bus.source import HopLosses, Link
from daq.control.messages import Alarm, Status, StorageStatus
from daq.journal.segment import SyncedFile
from daq.journal.writer import JournalWriter
from daq.recorder.readers import DRAIN_S, Piece, PieceQueue, Reader, Readers, StorageWatch
from daq.recorder.recorder import HALT_S
from dbc import Codec, FrameBatch

from ..a_status import a_status
from ..crash_frames import block
from ..recorder_run import PATIENCE_S, Running, Script, sources, stored
from ..small_campaign import blocks, bumps
from ..watched_bench import WatchedBench


def test_losses_are_the_sum_of_the_last_counts_of_all_readers() -> None:
    pieces = PieceQueue()
    readers = Readers(pieces, StorageWatch())
    empty = FrameBatch.empty()
    assert readers.hops() == HopLosses()
    for number, losses in (
        (0, HopLosses(1, 2, 3, 4)),
        (1, HopLosses(10, 20, 30, 40)),
        (0, HopLosses(2, 4, 6, 8)),
    ):
        pieces.put(Piece(number, empty, losses, 0.0))
    assert readers.hops() == HopLosses()  # not before they are taken
    readers.take(10**9)
    assert readers.hops() == HopLosses(12, 24, 36, 48)


@pytest.mark.parametrize(("frames", "fits"), [(1, 4096), (500_000, 3)], ids=["blocks", "frames"])
def test_the_queue_has_room_for_4096_blocks_and_1_600_000_frames(frames: int, fits: int) -> None:
    pieces, piece = PieceQueue(), Piece(0, block(0, frames), HopLosses(), 0.0)
    assert [pieces.put(piece) for _ in range(fits + 1)] == [True] * fits + [False]
    assert pieces.status.high == fits
    pieces.take(1)
    assert pieces.put(piece)


# Readers that are halted --------------------------------------------------------------------------


class Late(Script):
    """A bus whose reader gets no processor until the recorder was stopped."""

    def __init__(self, counts: Iterable[int]) -> None:
        super().__init__([])
        self.counts = iter(counts)
        self.begun, self.awake = threading.Event(), threading.Event()

    def read(self, timeout_s: float) -> FrameBatch:
        self.begun.set()
        assert self.awake.wait(PATIENCE_S)
        return block(0, next(self.counts))


def read_after_the_stop(source: Late) -> list[int]:
    """Return the sizes of the blocks that a reader reads after it was stopped."""
    pieces = PieceQueue()
    link = Link(BusConfig("test", "late", 1_000_000), 0, lambda *_: source)
    reader = Reader(0, link, pieces, StorageWatch())
    reader.start()
    assert source.begun.wait(PATIENCE_S)
    reader.halt()
    source.awake.set()
    reader.join(PATIENCE_S)
    assert not reader.is_alive()
    return [len(piece.frames) for piece in pieces.take(10**9)]


@pytest.mark.parametrize(
    ("waiting", "read"),
    [
        ([2048, 2048, 2047, 5], [2048, 2048, 2047]),  # what comes after a block with room is new
        ([2047, 5], [2047]),
    ],
)
def test_what_had_arrived_is_read(waiting: list[int], read: list[int]) -> None:
    assert read_after_the_stop(Late(waiting)) == read


def test_a_reader_that_hangs_in_its_driver_is_not_waited_for() -> None:
    source, readers = Late([1]), Readers(PieceQueue(), StorageWatch())
    readers.start([Link(BusConfig("test", "late", 1_000_000), 0, lambda *_: source)])
    assert source.begun.wait(PATIENCE_S)
    began_s = time.monotonic()
    readers.halt(0.01)
    assert time.monotonic() - began_s < PATIENCE_S / 2.0
    source.awake.set()
    readers.halt(PATIENCE_S)


def test_a_bus_that_is_never_empty_holds_nothing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    assert DRAIN_S < HALT_S
    monkeypatch.setattr("daq.recorder.readers.DRAIN_S", 0.1)
    assert len(read_after_the_stop(Late(itertools.repeat(2048)))) > 1


# Frames that arrive and are not stored: named after 3 s, whichever part is at fault ---------------


def codes(status: Status) -> list[str]:
    return [alarm.code for alarm in status.alarms]


def test_the_time_without_a_stored_frame_begins_with_the_first_that_waits() -> None:
    watch = StorageWatch()
    watch.received(0, 5.0)
    assert watch.status(9.0) == StorageStatus(0, 0, 0.0)  # a silent bus
    watch.received(10, 10.0)
    watch.received(10, 10.4)
    assert watch.status(10.5) == StorageStatus(20, 0, 0.5)
    watch.stored(0)
    assert watch.status(10.5).late_s == 0.5
    watch.stored(15)
    assert watch.status(20.0) == StorageStatus(20, 15, 0.0)
    watch.received(1, 20.0)
    watch.stored(15)  # nothing new on the disk
    assert watch.status(21.0) == StorageStatus(21, 15, 1.0)


@pytest.mark.parametrize(("late_s", "alarm"), [(2.99, False), (3.01, True)])
def test_from_three_seconds_on_it_is_an_alarm(late_s: float, alarm: bool) -> None:
    storage = StorageStatus(100, 50, late_s)
    bench = WatchedBench(["can0"])
    for _ in range(20):
        bench.turn()
    events = bench.turn(storage=storage)
    assert [a.code for a in bench.alarms] == ["not_recording"] * alarm
    assert [e.text for e in events] == [
        "not_recording: frames arrive, and none was stored for 3.0 s"
    ] * alarm
    # As long as the writer itself hangs, the main thread adds the alarm to its last status.
    last = a_status()
    late = with_not_recording(last, storage, 5_000_000_000)
    assert codes(late) == ["not_recording"] * alarm
    assert (late is last) is not alarm
    if alarm:
        assert late.alarms[0].since_ns == 1_990_000_000
        assert with_not_recording(late, storage, 6_000_000_000) is late


def watched(running: Running) -> Status:
    """Return what a daemon's main thread makes of the recorder's last status."""
    return with_not_recording(running.last, running.recorder.storage(), time.time_ns())


def until_s(condition: Callable[[], bool]) -> float:
    """Return how long it takes until a condition holds, s."""
    begun_s = time.monotonic()
    while not condition():
        assert time.monotonic() - begun_s < PATIENCE_S
        time.sleep(0.01)
    return time.monotonic() - begun_s


def test_a_store_that_drops_frames_without_an_error_is_found(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = bumps(codec, 4)
    script = Script(blocks(frames, 10), None, 0.01)
    append = JournalWriter.append
    dropping = threading.Event()

    def drops(self: JournalWriter, batch: FrameBatch, losses: Any) -> None:
        if not dropping.is_set():
            append(self, batch, losses)

    monkeypatch.setattr(JournalWriter, "append", drops)
    monkeypatch.setattr("daq.alarms.watch._NOT_RECORDING_S", 1.0)  # in place of 3 s
    with Running(quick, tmp_path, sources(script)) as running:
        # A disk may keep a busy machine waiting, and then the alarm is right.
        running.until(lambda s: s.disk.recorded_frames > 200 and "not_recording" not in codes(s))
        dropping.set()
        begun_s = time.monotonic()
        status = running.until(lambda s: "not_recording" in codes(s))
        assert time.monotonic() - begun_s < 8.0  # 3 s, and room for a busy machine
        assert status.storage.received_frames > status.storage.stored_frames
        dropping.clear()
        running.until(lambda s: "not_recording" not in codes(s))
    texts = [e.text for e in stored(tmp_path).events if e.code in ("alarm", "alarm_end")]
    named = [text for text in texts if text.startswith("not_recording")]
    assert len(named) == 2
    assert all(re.fullmatch(r"not_recording: frames arrive, .* \d+\.\d s", text) for text in named)


def test_a_writer_that_hangs_is_named_by_another_thread(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.alarms.watch._NOT_RECORDING_S", 1.0)  # in place of 3 s
    hung, gate = threading.Event(), threading.Event()

    class Hangs(SyncedFile):
        def sync(self) -> None:
            super().sync()
            if hung.is_set():
                gate.wait(PATIENCE_S)

    script = Script(blocks(bumps(codec, 3), 10), None, 0.01)
    with Running(quick, tmp_path, sources(script), create=Hangs) as running:
        running.until(lambda s: s.disk.recorded_frames > 200 and "not_recording" not in codes(s))
        hung.set()
        assert until_s(lambda: "not_recording" in codes(watched(running))) < 8.0  # 3 s, and room
        assert "not_recording" not in codes(running.last)  # it hangs, and publishes nothing
        gate.set()
        running.until(lambda s: s.disk.recorded_frames == 3600)
        until_s(lambda: "not_recording" not in codes(watched(running)))


def test_a_disk_that_refuses_is_said_alone() -> None:
    """It is the cause, and stands first with its remedy; a status of a hung writer says it too."""
    refused = Alarm("journal_failed", "", "the disk is full", "make room on the disk", 0)
    last = replace(a_status(), alarms=(refused,))
    assert with_not_recording(last, StorageStatus(1200, 700, 176.0), 6_000_000_000) is last
