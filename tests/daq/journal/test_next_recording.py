"""One recording after the other in the same journal, and what each file of it is worth."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.folder import last_recording, recordings, segments_in
from daq.journal.format import PROFILE, JournalHead, pack_events, pack_frames, unpack_events
from daq.journal.segment import Room
from daq.journal.segment_reader import SegmentReader
from daq.journal.writer import JournalWriter
from daq.runs import Event

from ..crash_disk import QuickFile
from ..crash_frames import START_NS, block

LIMITS = RecorderConfig(reserve_bytes=0.0)
HEAD = JournalHead("", "", "test", START_NS, 0, "a" * 32)
NEXT = replace(HEAD, recording="b" * 32)


def test_one_recording_ends_and_the_next_begins(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.cut()
        writer.append(block(10, 10), HopLosses())
        assert writer.begin(NEXT)
        assert writer.head == replace(NEXT, first_segment=3)
        assert writer.status.recorded_frames == 0
        writer.append(block(20, 5), HopLosses())
        assert (writer.status.recorded_frames, writer.stored_frames) == (5, 25)
        assert [path.name for path in writer.paths] == ["open_0003.mcap"]
    first, second = recordings(tmp_path)
    assert (first.recording, first.frames, first.ended) == ("a" * 32, 20, True)
    assert (second.recording, second.frames, second.ended) == ("b" * 32, 5, False)
    assert [path.name for path in first.segments] == ["journal_0001.mcap", "journal_0002.mcap"]


def test_the_next_recording_does_not_begin_while_frames_wait(tmp_path: Path) -> None:
    free = [10**12]
    limits = RecorderConfig(reserve_bytes=200e6)
    with JournalWriter(
        tmp_path, HEAD, limits, QuickFile, room=lambda _: Room(free[0], 10**12)
    ) as writer:
        writer.maintain(0.0)
        free[0] = 1
        writer.maintain(1.0)
        writer.append(block(0, 10), HopLosses())
        assert not writer.begin(NEXT)
        assert writer.head == HEAD
        free[0] = 10**12
        writer.maintain(2.0)
        assert writer.begin(NEXT)
    assert [(one.frames, one.ended) for one in recordings(tmp_path)] == [(10, True), (0, False)]


def test_of_the_recording_before_a_segment_without_a_bump_may_go(tmp_path: Path) -> None:
    """Of the present one it is kept for twenty minutes: a bump may come at any moment."""
    limits = RecorderConfig(reserve_bytes=0.0, keep_bytes=1.0)
    with JournalWriter(tmp_path, HEAD, limits, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.cut()
        writer.maintain(1.0)
        assert (tmp_path / "journal_0001.mcap").exists()
        assert writer.begin(NEXT)
        writer.append(block(10, 10), HopLosses())
        writer.maintain(2.0)
        assert not (tmp_path / "journal_0001.mcap").exists()


def test_what_was_cut_is_closed_and_all_files_count(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.cut()
        writer.append(block(10, 10), HopLosses())
        names = [path.name for path in segments_in(tmp_path)]
        assert names == ["journal_0001.mcap", "open_0002.mcap"]
        sizes = [path.stat().st_size for path in segments_in(tmp_path)]
        assert writer.status.journal_bytes == sum(sizes)
        assert min(sizes) > 0


def test_blocks_carry_their_number_for_other_tools(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile) as writer:
        for k in range(3):
            writer.append(block(k, 1), HopLosses())
    with writer.paths[0].open("rb") as file:
        records = list(StreamReader(file).records)
    messages = [record for record in records if isinstance(record, Message)]
    assert [message.sequence for message in messages] == [0, 1, 2]


def test_a_block_is_tried_in_the_open_file_and_in_one_more(tmp_path: Path) -> None:
    created: list[Path] = []

    class Broken(QuickFile):
        """Takes its head, and no block; a third file would take those, too."""

        syncs = 0

        def sync(self) -> None:
            self.syncs += 1
            if self.syncs > 1 and len(created) < 3:
                raise OSError(errno.EIO, os.strerror(errno.EIO))

    def create(path: Path) -> QuickFile:
        created.append(path)
        return Broken(path)

    writer = JournalWriter(tmp_path, HEAD, LIMITS, create)
    writer.append(block(0, 10), HopLosses())
    assert len(created) == 2
    assert writer.status.held_frames == 10
    writer.close()
    tail = last_recording(tmp_path)
    assert tail is not None
    assert tail.frames == 10


@pytest.mark.parametrize("blocks", [0, 1])
def test_a_file_without_a_head_is_worth_something_if_blocks_are_in_it(
    tmp_path: Path, blocks: int
) -> None:
    path = tmp_path / "journal_0001.mcap"
    writer = Writer(str(path), compression=CompressionType.NONE, use_chunking=False)
    writer.start(PROFILE, "test")
    channel = writer.register_channel("frames", "bumpbench-frames-1", 0)
    for _ in range(blocks):
        writer.add_message(channel, 0, pack_frames(0, block(0, 10), HopLosses()), 0)
    writer.finish()
    with SegmentReader(path) as segment:
        assert segment.head is None
        assert segment.holds_blocks() is bool(blocks)


@pytest.mark.parametrize("fields", [(1, 5), (1, "bump", 1.0, 5), (1.5, "bump")])
def test_events_of_other_types_are_refused(fields: tuple[Any, ...]) -> None:
    assert unpack_events(pack_events(3, [Event(1, "bump")])).number == 3
    with pytest.raises(ValueError, match="a field is of another type"):
        unpack_events(pack_events(3, [Event(*fields)]))
