from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from daq.bus import open_bus, open_source
from daq.campaign import Campaign
from daq.channels import Quantity
from daq.config import Bench, BusConfig, TriggerConfig, load_bench
from daq.errors import BusError, InputError
from daq.journal import Journal, JournalError
from daq.journal_format import JournalHead
from daq.journal_reader import read_journal
from daq.recorder import Recorder, RecorderStatus
from daq.recording import QUEUE_BLOCKS, record
from daq.runs import Event, Excitation, Losses
from daq.slcan import open_slcan
from daq.source import HopLosses, SourceLosses
from dbc import Codec, FrameBatch, FrameFlag, parse_codec

from .pty_pair import pty_pair

START_NS = 1_800_000_000_000_000_000
PERIOD_S = 1.2
CAMPAIGN = Campaign((Excitation.BOUNCE, Excitation.ROLL), 1)
LABELS = [step.label for step in CAMPAIGN.steps]


@pytest.fixture(scope="module")
def bench() -> Bench:
    return replace(
        load_bench(None), campaign=CAMPAIGN, trigger=TriggerConfig(3.0, 0.1, 0.5, rest_s=0.1)
    )


@pytest.fixture(scope="module")
def codec(bench: Bench) -> Codec:
    return parse_codec(bench.dbc_text, bench.dbc_name)


@pytest.fixture
def journal(bench: Bench, tmp_path: Path) -> Iterator[Journal]:
    head = JournalHead(bench.text, bench.dbc_text, "test", START_NS, 0)
    with Journal(tmp_path, head) as journal:
        yield journal


def bumps(codec: Codec, count: int, message: str = "HUB_Front") -> FrameBatch:
    """Frames of one message at 1 kHz: every 1.2 s, after 0.5 s of rest, 20 m/s2 for 0.2 s."""
    layout = codec.message(message)
    n = round(count * PERIOD_S * 1000)
    t_s = np.arange(n) * 1e-3
    phase_s = t_s % PERIOD_S - 0.5
    acc_g = np.where((phase_s > 0) & (phase_s < 0.2), 20 / 9.80665, 0.0)
    names = [s.name for s in layout.signals if s.name.startswith("acc")]
    data = codec.encode(message, dict.fromkeys(names, acc_g))
    return FrameBatch(
        START_NS + np.arange(n) * 1_000_000,
        np.full(n, layout.can_id, np.uint32),
        np.zeros(n, np.uint16),
        np.zeros(n, np.uint8),
        np.full(n, layout.length, np.uint8),
        data,
    )


def blocks(frames: FrameBatch, size: int = 100) -> list[FrameBatch]:
    return [frames.select(slice(i, i + size)) for i in range(0, len(frames), size)]


def codes(events: Sequence[Event]) -> list[tuple[str, str]]:
    return [(event.code, event.text) for event in events]


PLANNED = [(code, label) for label in LABELS for code in ("bump", "run_end")]


def test_runs_are_labelled_in_the_order_of_the_campaign_and_stored(
    bench: Bench, codec: Codec, journal: Journal
) -> None:
    recorder = Recorder(bench, codec, journal)
    assert recorder.status([]).step == CAMPAIGN.steps[0]
    events: list[Event] = []
    for block in blocks(bumps(codec, len(LABELS))):
        events += recorder.step(block, HopLosses())
        assert recorder.complete == (codes(events) == PLANNED)

    assert codes(events) == PLANNED
    for k, event in enumerate(e for e in events if e.code == "bump"):
        assert event.t_ns == START_NS + round((k * PERIOD_S + 0.501) * 1e9)
    assert recorder.complete
    assert recorder.losses == Losses()
    journal.close()
    contents = read_journal(journal.paths)
    assert contents.events == tuple(events)
    assert len(contents.frames) == len(LABELS) * 1200


def test_a_bump_after_the_campaign_is_kept_apart(
    bench: Bench, codec: Codec, journal: Journal
) -> None:
    recorder = Recorder(bench, codec, journal)
    events = recorder.step(bumps(codec, len(LABELS) + 1), HopLosses())
    assert codes(events)[:-2] == PLANNED
    assert [e.code for e in events[-2:]] == ["unplanned_bump", "unplanned_run_end"]


def test_the_status_says_what_is_due_and_what_is_going_on(
    bench: Bench, codec: Codec, journal: Journal
) -> None:
    recorder = Recorder(bench, codec, journal)
    frames = bumps(codec, 1)
    events = recorder.step(frames.select(slice(0, 700)), HopLosses())
    status = recorder.status(events)
    assert status.running == status.step == CAMPAIGN.steps[0]
    assert (status.done, status.planned, status.frames) == (0, len(LABELS), 700)
    assert status.t_ns == frames.t_ns[699]
    assert codes(status.events) == PLANNED[:1]
    recorder.step(frames.select(slice(700, None)), HopLosses())
    status = recorder.status([])
    assert (status.running, status.step, status.done) == (None, CAMPAIGN.steps[1], 1)


def test_losses_of_every_hop_add_up(bench: Bench, codec: Codec, journal: Journal) -> None:
    frames = bumps(codec, 1)
    data = frames.data.copy()
    data[10, 0] ^= 1  # checksum
    can_id = frames.can_id.copy()
    can_id[20] = 0x7F0  # unknown; leaves a gap in the counter
    flags = frames.flags.copy()
    flags[30] |= FrameFlag.ERROR
    flags[40] |= FrameFlag.REMOTE
    length = frames.length.copy()
    length[-1] = 2
    frames = replace(frames, data=data, can_id=can_id, flags=flags, length=length)
    frames = frames.select(np.delete(np.arange(len(frames)), [50, 51]))

    recorder = Recorder(bench, codec, journal)
    for block in blocks(frames):
        recorder.step(block, HopLosses(bus_dropped=1, bus_garbled=2, queue_dropped=3))

    assert recorder.losses == Losses(
        bus_dropped=1,
        bus_garbled=2,
        queue_dropped=3,
        counter_gaps=5,  # 20, 30, 40, 50, 51
        crc_bad=1,
        wrong_length=1,
        unknown_id=1,
        error_frames=1,
        remote_frames=1,
    )


def test_a_block_that_cannot_be_stored_is_not_used(bench: Bench, codec: Codec) -> None:
    class Full(Journal):
        def __init__(self) -> None:
            pass

        def append(self, frames: FrameBatch, losses: HopLosses) -> None:
            raise JournalError("x", "is full", "make room")

    recorder = Recorder(bench, codec, Full())
    with pytest.raises(JournalError):
        recorder.step(bumps(codec, 1), HopLosses())
    assert recorder.status([]).frames == 0


def test_stamps_of_another_epoch_are_told_once(
    bench: Bench, codec: Codec, journal: Journal
) -> None:
    recorder = Recorder(bench, codec, journal)
    first = recorder.step(FrameBatch.empty(), HopLosses(restamped=5))
    again = recorder.step(FrameBatch.empty(), HopLosses(restamped=9))
    assert [event.code for event in first] == ["restamped"]
    assert again == ()


def test_a_bench_that_cannot_trigger_or_does_not_fit_its_dbc_is_refused(
    bench: Bench, codec: Codec, journal: Journal
) -> None:
    mute = tuple(c for c in bench.channels if c.quantity is Quantity.PITCH_RATE)
    with pytest.raises(InputError, match="no channel that can trigger"):
        Recorder(replace(bench, channels=mute), codec, journal)
    wrong = (replace(bench.channels[0], signal="HUB_Front.nothing"), *bench.channels[1:])
    with pytest.raises(InputError, match=r"no signal 'HUB_Front\.nothing'"):
        Recorder(replace(bench, channels=wrong), codec, journal)


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
