"""Limits of the writer and of what is believed of a segment, with a test on each side."""

from __future__ import annotations

import errno
import os
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.contents import JournalLoss
from daq.journal.folder import last_recording, note_built, recordings, scan, segments_in
from daq.journal.format import (
    PROFILE,
    Gap,
    JournalHead,
    gap_event,
    head_record,
    pack_events,
    pack_frames,
    unpack_events,
)
from daq.journal.reader import read_journal
from daq.journal.retention import Retention
from daq.journal.segment import Room, Segment
from daq.journal.segment_reader import SegmentReader
from daq.journal.writer import JournalWriter
from daq.runs import Event

from ..crash_disk import FailingDisk, QuickFile
from ..crash_frames import START_NS, block
from .test_retention import record

S = 1_000_000_000
GB = 1_000_000_000
LIMITS = RecorderConfig(reserve_bytes=200e6)


HEAD = JournalHead("", "", "test", START_NS, 0, "a" * 32)


class Checks:
    """A disk that counts how often its room is asked for."""

    def __init__(self, free: int = 10**12) -> None:
        self.count = 0
        self.free = free

    def room(self, _: Path) -> Room:
        self.count += 1
        return Room(self.free, 10**12)


@pytest.mark.parametrize("nth", [3, 4, 9])
def test_a_block_that_is_in_two_segments_counts_once(tmp_path: Path, nth: int) -> None:
    # Its first fdatasync failed: it may be on the disk or not, and was written again.
    limits = RecorderConfig(reserve_bytes=0.0)
    writer = JournalWriter(tmp_path, HEAD, limits, FailingDisk("sync", nth).create)
    for k in range(12):
        writer.append(block(10 * k, 10), HopLosses())
    assert len(writer.paths) == 2
    assert writer.status.recorded_frames == 120
    for close in (False, True):
        if close:
            writer.close()
        tail = last_recording(tmp_path)
        assert tail is not None
        assert tail.frames == recordings(tmp_path)[0].frames == 120


def test_the_disk_is_checked_once_a_second(tmp_path: Path) -> None:
    disk = Checks()
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, room=disk.room) as writer:
        writer.maintain(100.0)
        assert disk.count == 2
        writer.maintain(100.99)
        assert disk.count == 2
        writer.maintain(101.0)
        assert disk.count == 3


def test_a_first_file_that_failed_and_then_did_not_is_in_the_status_for_a_minute(
    tmp_path: Path,
) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS, FailingDisk("eio", 2).create) as writer:
        writer.append(block(0, 1), HopLosses())
        writer.maintain(5000.0)
        assert not writer.status.failed
        writer.maintain(5060.0)
        warning = "the first file could not be written: Input/output error"
        assert writer.status.warning == warning
        writer.maintain(5061.0)
        assert writer.status.warning == ""


def test_the_disk_is_checked_after_sixteen_megabytes(tmp_path: Path) -> None:
    disk = Checks()
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, room=disk.room) as writer:
        writer.maintain(0.0)
        writer.append_events([Event(0, "note", text="x" * 15_900_000)])
        writer.maintain(0.1)
        assert disk.count == 2
        writer.append_events([Event(0, "note", text="x" * 200_000)])
        writer.maintain(0.2)
        assert disk.count == 3
        writer.maintain(0.3)
        assert disk.count == 3


def test_a_warning_of_a_lost_file_lasts_a_minute(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, room=Checks().room) as writer:
        writer.maintain(0.0)
        writer.append(block(0, 10), HopLosses())
        writer.paths[0].unlink()
        writer.maintain(1.0)
        assert "was deleted: 10 recorded frames are lost" in writer.status.warning
        assert writer.status.recorded_frames == 0
        writer.maintain(61.0)
        assert writer.status.warning != ""
        writer.maintain(62.1)
        assert writer.status.warning == ""


@pytest.mark.parametrize(("free", "goes"), [(399_000_000, True), (401_000_000, False)])
def test_old_segments_go_below_twice_the_reserve(tmp_path: Path, free: int, goes: bool) -> None:
    old = JournalHead("", "", "test", START_NS, 0, "b" * 32)
    with JournalWriter(tmp_path, old, LIMITS, QuickFile, room=Checks().room) as writer:
        writer.append(block(0, 10), HopLosses())
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, room=Checks(free).room) as writer:
        writer.maintain(0.0)
        assert (tmp_path / "journal_0001.mcap").exists() is not goes


def test_a_full_disk_stops_recording_and_frames_wait(tmp_path: Path) -> None:
    disk = Checks(300_000_000)
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, room=disk.room) as writer:
        writer.maintain(0.0)
        disk.free = 199_000_000
        writer.maintain(1.0)
        assert writer.status.failed == "the disk is full except for the reserve of 200 MB"
        writer.append(block(0, 10), HopLosses())
        writer.maintain(3.5)
        assert (writer.status.held_frames, writer.status.recorded_frames) == (10, 0)
        assert writer.status.lag_s == 2.5
        assert not writer.flush()
        disk.free = 211_000_000
        writer.maintain(4.5)
        assert (writer.status.held_frames, writer.status.recorded_frames) == (0, 10)
        assert (writer.status.failed, writer.status.lag_s) == ("", 0.0)


@pytest.mark.parametrize(("size", "files"), [(9_000.0, 2), (12_000.0, 1)])
def test_a_segment_ends_at_its_size(tmp_path: Path, size: float, files: int) -> None:
    limits = RecorderConfig(segment_bytes=size, reserve_bytes=0.0)
    with JournalWriter(tmp_path, HEAD, limits, QuickFile) as writer:
        writer.append(block(0, 400), HopLosses())  # 9.6 kB and the head
        writer.maintain(0.0)
        assert len(segments_in(tmp_path)) == files


@pytest.mark.parametrize(("age_s", "files"), [(899.9, 1), (900.0, 2)])
def test_a_segment_ends_at_its_age(tmp_path: Path, age_s: float, files: int) -> None:
    limits = RecorderConfig(reserve_bytes=0.0)
    with JournalWriter(tmp_path, HEAD, limits, QuickFile) as writer:
        writer.maintain(50.0)
        writer.append(block(0, 1), HopLosses())
        writer.maintain(50.0 + age_s)
        assert len(segments_in(tmp_path)) == files


@pytest.mark.parametrize(("number", "believed"), [(3, True), (2, False), (1 << 40, True)])
@pytest.mark.parametrize("checked", [True, False])
def test_a_block_is_believed_if_its_checksum_fits_and_its_number_does_not_go_back(
    tmp_path: Path, number: int, believed: bool, checked: bool
) -> None:
    writer = JournalWriter(tmp_path, HEAD, RecorderConfig(reserve_bytes=0.0), QuickFile)
    for k in range(5):
        writer.append(block(k, 1), HopLosses())
    path = writer.paths[0]
    as_killed = path.read_bytes()
    writer.close()
    last = pack_frames(3, block(3, 1), HopLosses())
    body = struct.pack("<Q", number) + last[12:]
    forged = struct.pack("<I", zlib.crc32(body) ^ (not checked)) + body
    assert as_killed.count(last) == 1
    path.write_bytes(as_killed[: -len(last) - 31].replace(last, forged))
    info = scan(path)
    assert info is not None
    assert (info.stop, info.frames) == ((number + 1, 4) if believed and checked else (3, 3))


def test_blocks_between_two_others_are_counted_as_missing_but_for_known_gaps(
    tmp_path: Path,
) -> None:
    def written(*blocks: int, gap: Gap | None = None) -> JournalLoss:
        for path in tmp_path.iterdir():
            path.unlink()
        writer = JournalWriter(tmp_path, HEAD, RecorderConfig(reserve_bytes=0.0), QuickFile)
        with writer:
            for number in blocks:
                writer._number = number
                writer.append(block(number, 1), HopLosses())
            if gap:
                writer.append_events([gap_event("disk_gap", 0, gap)])
        return read_journal(writer.paths).lost

    assert written(0, 1, 2).blocks_missing == 0
    assert written(0, 4).blocks_missing == 3
    known = written(0, 4, gap=Gap("a" * 32, 1, 3, 5))
    assert (known.blocks_missing, known.frames_dropped) == (1, 5)
    assert written(0, 4, gap=Gap("a" * 32, 1, 4, 5)).blocks_missing == 0
    assert written(0, 4, gap=Gap("c" * 32, 1, 4, 5)).blocks_missing == 3


# A disk that takes nothing or cannot be asked: what the writer makes of it, fault by fault --------

NEXT = JournalHead("", "", "test", START_NS, 0, "b" * 32)
LIMITS_OF_FAULTS_OF_THE_DISK = RecorderConfig(reserve_bytes=0.0)


class StubbornFile(QuickFile):
    """A file that takes `left` bytes, in pieces of `piece`, and nothing after that."""

    def __init__(self, path: Path, left: int, piece: int) -> None:
        super().__init__(path)
        self.left, self.piece = left, piece

    def write(self, data: Any) -> int:
        size = min(self.left, self.piece, len(data))
        self.left -= size
        return super().write(data[:size]) if size else 0


def test_a_file_that_takes_a_few_bytes_at_a_time_has_all_of_them(tmp_path: Path) -> None:
    def create(path: Path) -> StubbornFile:
        return StubbornFile(path, 1 << 30, 7)

    with JournalWriter(tmp_path, HEAD, LIMITS_OF_FAULTS_OF_THE_DISK, create) as writer:
        writer.append(block(0, 30), HopLosses())
        paths = writer.paths
        assert sum(path.stat().st_size for path in paths) == writer.status.journal_bytes
    assert len(read_journal(writer.paths).frames) == 30


def test_a_file_that_takes_nothing_is_a_full_disk_and_leaves_no_trace(tmp_path: Path) -> None:
    path = tmp_path / "open_0001.mcap"
    with pytest.raises(OSError, match="No space left"):
        Segment(StubbornFile(path, 20, 7), path, head_record(HEAD, 1), HEAD)
    assert not list(tmp_path.iterdir())


def test_a_disk_that_cannot_be_asked_is_said_and_asked_again(tmp_path: Path) -> None:
    gone = [False]

    def room(_: Path) -> Room:
        if gone[0]:
            raise OSError(5, "Input/output error")
        return Room(10**12, 2 * 10**12)

    with JournalWriter(
        tmp_path, HEAD, LIMITS_OF_FAULTS_OF_THE_DISK, QuickFile, room=room
    ) as writer:
        writer.maintain(0.0)
        assert writer.status.failed == ""
        gone[0] = True
        writer.maintain(1.0)
        assert "Input/output error" in writer.status.failed
        assert writer.status.free_bytes == 10**12  # as it was last
        assert writer.status.total_bytes == 2 * 10**12
        writer.append(block(0, 10), HopLosses())
        assert writer.status.recorded_frames == 10
        gone[0] = False
        writer.maintain(2.0)
        assert writer.status.failed == ""


def test_a_recording_goes_on_if_its_end_cannot_be_written(tmp_path: Path) -> None:
    files: list[StubbornFile] = []

    def create(path: Path) -> StubbornFile:
        if files and files[0].left == 0:
            raise OSError(28, "No space left on device")
        files.append(StubbornFile(path, 1 << 30, 1 << 20))
        return files[-1]

    with JournalWriter(tmp_path, HEAD, LIMITS_OF_FAULTS_OF_THE_DISK, create) as writer:
        writer.append(block(0, 10), HopLosses())
        files[0].left = 0
        assert not writer.begin(NEXT)
        assert writer.head == HEAD
        files[0].left = 1
        assert writer.begin(NEXT)
        assert writer.head.recording == "b" * 32
    first, second = recordings(tmp_path)
    assert (first.frames, first.ended, second.ended) == (10, True, False)


def test_a_folder_without_room_from_the_start_was_not_taken_away(tmp_path: Path) -> None:
    free = [0]
    limits = RecorderConfig(reserve_bytes=200e6)
    with JournalWriter(
        tmp_path, HEAD, limits, QuickFile, room=lambda _: Room(free[0], 10**12)
    ) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.maintain(0.0)
        assert "taken away" not in writer.status.warning
        assert "full" in writer.status.failed
        assert writer.status.held_frames == 10
        free[0] = 10**12
        writer.maintain(1.0)
        assert (writer.status.failed, writer.status.recorded_frames) == ("", 10)


def test_a_segment_may_be_deleted_once_its_runs_are_in_a_session(tmp_path: Path) -> None:
    (path,) = record(tmp_path, "a", range(2), Event(START_NS, "bump", 1.0, "baseline_bounce_1"))
    retention = Retention(tmp_path, "b" * 32)
    assert retention.choose(1.0, START_NS) == ()
    again = Retention(tmp_path, "b" * 32)
    note_built(tmp_path, "a" * 32, 100, path)
    chosen = again.choose(1.0, START_NS)
    assert chosen is not None
    assert [info.path for info in chosen] == [path]
    again.delete(chosen[0])
    assert not path.exists()
    assert again.bytes == 0


# One recording after the other in the same journal, and what each file of it is worth -------------

LIMITS_OF_NEXT_RECORDING = RecorderConfig(reserve_bytes=0.0)
NEXT_OF_NEXT_RECORDING = replace(HEAD, recording="b" * 32)


def test_one_recording_ends_and_the_next_begins(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS_OF_NEXT_RECORDING, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.cut()
        writer.append(block(10, 10), HopLosses())
        assert writer.begin(NEXT_OF_NEXT_RECORDING)
        assert writer.head == replace(NEXT_OF_NEXT_RECORDING, first_segment=3)
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
        assert not writer.begin(NEXT_OF_NEXT_RECORDING)
        assert writer.head == HEAD
        free[0] = 10**12
        writer.maintain(2.0)
        assert writer.begin(NEXT_OF_NEXT_RECORDING)
    assert [(one.frames, one.ended) for one in recordings(tmp_path)] == [(10, True), (0, False)]


def test_of_the_recording_before_a_segment_without_a_bump_may_go(tmp_path: Path) -> None:
    """Of the present one it is kept for twenty minutes: a bump may come at any moment."""
    limits = RecorderConfig(reserve_bytes=0.0, keep_bytes=1.0)
    with JournalWriter(tmp_path, HEAD, limits, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.cut()
        writer.maintain(1.0)
        assert (tmp_path / "journal_0001.mcap").exists()
        assert writer.begin(NEXT_OF_NEXT_RECORDING)
        writer.append(block(10, 10), HopLosses())
        writer.maintain(2.0)
        assert not (tmp_path / "journal_0001.mcap").exists()


def test_what_was_cut_is_closed_and_all_files_count(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS_OF_NEXT_RECORDING, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.cut()
        writer.append(block(10, 10), HopLosses())
        names = [path.name for path in segments_in(tmp_path)]
        assert names == ["journal_0001.mcap", "open_0002.mcap"]
        sizes = [path.stat().st_size for path in segments_in(tmp_path)]
        assert writer.status.journal_bytes == sum(sizes)
        assert min(sizes) > 0


def test_blocks_carry_their_number_for_other_tools(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS_OF_NEXT_RECORDING, QuickFile) as writer:
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

    writer = JournalWriter(tmp_path, HEAD, LIMITS_OF_NEXT_RECORDING, create)
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
