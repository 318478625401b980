from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from daq.bus import open_bus, open_source
from daq.config import Bench, BusConfig
from daq.errors import BusError
from daq.journal import Journal, JournalError
from daq.journal_format import JournalHead
from daq.journal_reader import read_journal
from daq.recorder import Recorder, RecorderStatus
from daq.recording import QUEUE_BLOCKS, record
from daq.runs import Event, Losses
from daq.slcan import open_slcan
from daq.source import HopLosses, SourceLosses
from dbc import Codec, FrameBatch

from .pty_pair import pty_pair
from .small_campaign import (
    LABELS,
    PLANNED,
    START_NS,
    blocks,
    bumps,
    codes,
)


class Script:
    """A source that gives out blocks, then fails or falls silent."""

    def __init__(self, name: str, given: Sequence[FrameBatch], error: Exception | None) -> None:
        self.name = name
        self.given = list(given)
        self.error = error
        self.exhausted = threading.Event()
        self.closed = False

    def read(self, timeout_s: float) -> FrameBatch:
        if self.given:
            return self.given.pop(0)
        if self.error:
            raise self.error
        self.exhausted.set()
        threading.Event().wait(0.001)
        return FrameBatch.empty()

    def losses(self) -> SourceLosses:
        return SourceLosses(garbled=1)

    def close(self) -> None:
        self.closed = True


def silent(_: RecorderStatus) -> None:
    pass


def test_a_recording_ends_with_the_campaign(bench: Bench, codec: Codec, journal: Journal) -> None:
    frames = bumps(codec, len(LABELS))
    source = Script("a", blocks(frames), None)
    seen: list[RecorderStatus] = []
    record(Recorder(bench, codec, journal), [source], threading.Event(), seen.append)
    assert source.closed
    assert codes([event for status in seen for event in status.events]) == PLANNED
    assert seen[-1].done == len(LABELS)
    assert seen[-1].losses == Losses(bus_garbled=1)
    journal.close()
    stored = read_journal(journal.paths)
    np.testing.assert_array_equal(stored.frames.t_ns, frames.t_ns)
    assert codes(stored.events) == PLANNED
    assert stored.hops.between(0, START_NS * 2) == HopLosses(bus_garbled=1)


def test_a_stopped_recording_keeps_what_was_read(
    bench: Bench, codec: Codec, journal: Journal
) -> None:
    source = Script("a", blocks(bumps(codec, 1), 7), None)
    stop = threading.Event()

    def stop_when_all_is_read(_: RecorderStatus) -> None:
        if source.exhausted.is_set():
            stop.set()

    record(Recorder(bench, codec, journal), [source], stop, stop_when_all_is_read)
    journal.close()
    assert len(read_journal(journal.paths).frames) == 1200


@pytest.mark.parametrize("error", [BusError("a", "has gone", "check"), RuntimeError("bug")])
def test_the_last_source_that_fails_ends_the_recording_after_its_frames_are_stored(
    bench: Bench, codec: Codec, journal: Journal, error: Exception
) -> None:
    source = Script("a", blocks(bumps(codec, 1)), error)
    with pytest.raises(BusError, match=r"a: (has gone|reader failed: RuntimeError\('bug'\))"):
        record(Recorder(bench, codec, journal), [source], threading.Event(), silent)
    assert source.closed
    journal.close()
    contents = read_journal(journal.paths)
    assert len(contents.frames) == 1200
    assert [event.code for event in contents.events].count("bus_gone") == 1


def test_a_source_that_fails_while_another_goes_on_is_an_event(
    bench: Bench, codec: Codec, journal: Journal
) -> None:
    rear = bumps(codec, 1, "HUB_Rear")
    failing = Script("rear", blocks(rear), BusError("rear", "has gone", "check"))
    lasting = Script("front", blocks(bumps(codec, 1)), None)
    stop = threading.Event()
    seen: list[Event] = []

    def stop_after_loss(status: RecorderStatus) -> None:
        seen.extend(status.events)
        if lasting.exhausted.is_set() and any(event.code == "bus_gone" for event in seen):
            stop.set()

    record(Recorder(bench, codec, journal), [lasting, failing], stop, stop_after_loss)
    gone = [event for event in seen if event.code == "bus_gone"]
    assert [(event.value, event.text) for event in gone] == [(1.0, "rear: has gone (check)")]
    journal.close()
    contents = read_journal(journal.paths)
    assert len(contents.frames) == 2400
    assert gone[0] in contents.events


def test_what_does_not_fit_in_the_queue_is_counted_to_the_frame(
    bench: Bench, codec: Codec, tmp_path: Path
) -> None:
    frames = bumps(codec, 3)
    given = blocks(frames, 2)
    source = Script("a", given, None)
    assert len(given) > 2 * QUEUE_BLOCKS
    stalled = threading.Event()

    class SlowDisk(Journal):
        def append(self, frames: FrameBatch, losses: HopLosses) -> None:
            if not stalled.is_set():  # until the reader has read all there is
                stalled.set()
                assert source.exhausted.wait(30)
            super().append(frames, losses)

    stop = threading.Event()

    def stop_when_all_is_read(_: RecorderStatus) -> None:
        stop.set()

    with SlowDisk(tmp_path, JournalHead("", "", "test", 0, 0)) as journal:
        recorder = Recorder(bench, codec, journal)
        record(recorder, [source], stop, stop_when_all_is_read)
    stored = read_journal(journal.paths)
    dropped = recorder.losses.queue_dropped
    assert dropped > 0
    assert len(stored.frames) + dropped == len(frames)
    assert stored.hops.counts[-1, -1] == dropped


def test_a_full_disk_ends_the_recording_and_closes_the_buses(
    bench: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = Script("a", blocks(bumps(codec, 1)), None)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with Journal(tmp_path, JournalHead("", "", "test", 0, 0)) as journal:
        recorder = Recorder(bench, codec, journal)
        monkeypatch.setattr(os, "fdatasync", full)
        with pytest.raises(JournalError, match="No space left on device"):
            record(recorder, [source], threading.Event(), silent)
    assert source.closed


def messages(frames: FrameBatch) -> list[can.Message]:
    return [
        can.Message(
            timestamp=int(t_ns) / 10**9,
            arbitration_id=int(can_id),
            is_extended_id=False,
            data=row[:length].tobytes(),
        )
        for t_ns, can_id, length, row in zip(
            frames.t_ns, frames.can_id, frames.length, frames.data, strict=True
        )
    ]


def test_a_campaign_over_a_virtual_bus_arrives_whole(
    bench: Bench, codec: Codec, journal: Journal
) -> None:
    config = BusConfig("virtual", "test_recorder", 1_000_000)
    source = open_source(config, 0)
    frames = bumps(codec, len(LABELS))
    frames = replace(frames, t_ns=frames.t_ns - START_NS + time.time_ns())
    seen: list[Event] = []

    def car() -> None:
        with open_bus(config) as bus:
            for message in messages(frames):
                bus.send(message)

    driving = threading.Thread(target=car)
    driving.start()
    record(
        Recorder(bench, codec, journal),
        [source],
        threading.Event(),
        lambda s: seen.extend(s.events),
    )
    driving.join()
    assert codes(seen) == PLANNED
    journal.close()
    stored = read_journal(journal.paths).frames
    # The sender may still be at its last frames when the campaign is complete.
    np.testing.assert_array_equal(stored.data, frames.data[: len(stored)])
    assert len(stored) >= len(frames) - 300
    assert np.abs(stored.t_ns - frames.t_ns[: len(stored)]).max() <= 120


def test_a_bench_on_a_serial_line_is_recorded(bench: Bench, codec: Codec, journal: Journal) -> None:
    frames = bumps(codec, 1)
    stop = threading.Event()
    seen: list[RecorderStatus] = []

    def stop_when_all_is_stored(status: RecorderStatus) -> None:
        seen.append(status)
        if status.frames >= len(frames):
            stop.set()

    with pty_pair() as (near, far):
        source = open_slcan(near, 1_000_000, 0)

        def car() -> None:
            with can.Bus(
                interface="slcan", channel=far, sleep_after_open=0, ignore_config=True
            ) as bus:
                for message in messages(frames):
                    bus.send(message)

        driving = threading.Thread(target=car)
        driving.start()
        record(Recorder(bench, codec, journal), [source], stop, stop_when_all_is_stored)
        driving.join()
    assert seen[-1].losses == Losses()
    journal.close()
    np.testing.assert_array_equal(read_journal(journal.paths).frames.data, frames.data)
