from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.channels import Quantity
from daq.config import Bench
from daq.errors import InputError
from daq.journal import Journal, JournalError
from daq.journal_reader import read_journal
from daq.recorder import Recorder
from daq.runs import Event, Losses
from daq.source import HopLosses
from dbc import Codec, FrameBatch, FrameFlag

from .small_campaign import (
    CAMPAIGN,
    LABELS,
    PERIOD_S,
    PLANNED,
    START_NS,
    blocks,
    bumps,
    codes,
)


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
