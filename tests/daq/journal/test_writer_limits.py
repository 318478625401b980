"""Limits of the writer and of what is believed of a segment, with a test on each side."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.contents import JournalLoss
from daq.journal.folder import last_recording, recordings, scan, segments_in
from daq.journal.format import Gap, JournalHead, gap_event, pack_frames
from daq.journal.reader import read_journal
from daq.journal.segment import Room
from daq.journal.writer import JournalWriter
from daq.runs import Event

from ..crash_disk import FailingDisk, QuickFile
from ..crash_frames import START_NS, block

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
