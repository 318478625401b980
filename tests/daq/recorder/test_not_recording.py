"""Frames that arrive and are not stored: named after 3 s, whichever part is at fault."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daq.alarms import with_not_recording
from daq.bench.config import Bench
from daq.control.messages import Alarm, Status, StorageStatus
from daq.journal.segment import SyncedFile
from daq.journal.writer import JournalWriter
from daq.recorder.readers import StorageWatch
from dbc import Codec, FrameBatch
from tui.recorders.lines import status_lines

from ..a_status import a_status
from ..recorder_run import PATIENCE_S, Gated, Running, Script, quick, sources, stored
from ..small_campaign import blocks, bumps
from ..watched_bench import WatchedBench

__all__ = ["quick"]  # a fixture


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


def test_the_status_says_it() -> None:
    storage = StorageStatus(1200, 700, 3.2)
    late = with_not_recording(a_status(), storage, 0)
    well = replace(a_status(), storage=StorageStatus(1200, 1200), recording="")
    text = "NOT RECORDING for 3.2 s: 700 of 1,200 frames stored since the start"
    assert text in list(status_lines(late))
    assert "recording: 1,200 of 1,200 frames stored since the start" in list(status_lines(well))
    assert any("between two campaigns, recording goes on" in line for line in status_lines(well))


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


def test_a_silent_bus_and_a_first_frame_are_no_alarm(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    gate = threading.Event()
    script = Gated(gate, blocks(bumps(codec, 1)))
    with Running(quick, tmp_path, sources(script)) as running:
        running.until(lambda s: len(running.published) > 5)
        gate.set()
        running.until(lambda s: s.disk.recorded_frames == 1200)
        count = len(running.published)
        running.until(lambda s: len(running.published) > count + 5)
    assert not any("not_recording" in codes(status) for status in running.published)


def test_a_disk_that_refuses_is_said_alone() -> None:
    """It is the cause, and stands first with its remedy; a status of a hung writer says it too."""
    refused = Alarm("journal_failed", "", "the disk is full", "make room on the disk", 0)
    last = replace(a_status(), alarms=(refused,))
    assert with_not_recording(last, StorageStatus(1200, 700, 176.0), 6_000_000_000) is last
