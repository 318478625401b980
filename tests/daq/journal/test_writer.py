"""The writer of the journal beside disks that fail, fill up or disappear, and its limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.reader import last_recording, recordings
from daq.journal.segment import Segment
from daq.journal.writer import JournalError, JournalWriter
from daq.runs import Event

from ..crash_frames import (
    HEAD,
    FailingDisk,
    QuickFile,
    block,
    numbers,
    read_journal,
)
from ..crash_writer import (
    KINDS,
    TAKINGS,
    faults,
    images,
    mounted_disk,
    read_only_disk,
    run_full,
    small_disk,
    take_away,
)

LIMITS = RecorderConfig(reserve_bytes=200e6)
NO_RESERVE = RecorderConfig(reserve_bytes=0.0)
NEXT = replace(HEAD, recording="b" * 32)


class Checks:
    """A disk whose free space is set, and that may fail to answer."""

    def __init__(self, free: int = 10**12) -> None:
        self.free = free
        self.fails = False

    def usage(self, _: Path) -> tuple[int, int, int]:
        if self.fails:
            raise OSError(5, "Input/output error")
        return 10**12, 0, self.free


class StubbornFile(QuickFile):
    """A file that takes `left` bytes, in pieces of `piece`, and nothing after that."""

    def __init__(self, path: Path, left: int, piece: int = 1 << 20) -> None:
        super().__init__(path)
        self.left, self.piece = left, piece

    def write(self, data: Any) -> int:
        size = min(self.left, self.piece, len(data))
        self.left -= size
        return super().write(data[:size]) if size else 0


# The campaigns of `make crash`, short -------------------------------------------------------------


def test_a_crash_image_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    assert images(tmp_path, 24, seed=12) > 0


def test_an_operation_that_fails_loses_nothing_and_is_reported(tmp_path: Path) -> None:
    operations = [1, 2, 3, 5, 13, 60]
    assert faults(tmp_path, operations) == len(KINDS) * len(operations)


@pytest.mark.parametrize(("reserve", "full_s"), [(0.0, 90.0), (100_000.0, 5.0)])
def test_a_full_disk_costs_only_what_it_says(tmp_path: Path, reserve: float, full_s: float) -> None:
    full = run_full(small_disk(tmp_path / "full", 1_234_567), reserve, full_s)
    assert bool(full.dropped) == (full_s > 60.0)
    assert full.alarm_s <= 1.0
    assert full.resumed_s <= 5.0
    assert full.grown_bytes < 50_000_000


def test_a_mounted_disk_that_is_full_costs_nothing_while_memory_holds(tmp_path: Path) -> None:
    with mounted_disk(tmp_path / "mounted", 800_000) as mounted:
        disk = mounted or small_disk(tmp_path / "full", 800_000)
        assert run_full(disk, 0.0, full_s=5.0).dropped == 0


@pytest.mark.parametrize("how", TAKINGS.values(), ids=TAKINGS)
def test_what_is_taken_away_is_reported(tmp_path: Path, how: Callable[[Path], object]) -> None:
    assert take_away(tmp_path / "journal", how) <= 2.0


def test_a_disk_that_turns_read_only_is_waited_for(tmp_path: Path) -> None:
    full = run_full(read_only_disk(tmp_path / "journal"), 0.0, full_s=3.0)
    assert (full.kind, full.dropped) == ("read-only", 0)
    assert full.alarm_s <= 1.0


# Files that fail ----------------------------------------------------------------------------------


def test_a_file_that_takes_a_few_bytes_at_a_time_has_all_of_them(tmp_path: Path) -> None:
    def create(path: Path) -> StubbornFile:
        return StubbornFile(path, 1 << 30, 7)

    with JournalWriter(tmp_path, HEAD, NO_RESERVE, create) as writer:
        writer.append(block(0, 30), HopLosses())
        assert writer.paths[0].stat().st_size == writer.status.journal_bytes
    assert len(read_journal(writer.paths).frames) == 30


def test_a_file_that_takes_nothing_is_a_full_disk_and_leaves_no_trace(tmp_path: Path) -> None:
    path = tmp_path / "journal_0001.bbj"
    with pytest.raises(OSError, match="No space left"):
        Segment(StubbornFile(path, 20, 7), path, HEAD, 0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("nth", [3, 4, 9])
def test_a_block_that_is_in_two_segments_counts_once(tmp_path: Path, nth: int) -> None:
    # Its first fdatasync failed: it may be on the disk or not, and was written again.
    writer = JournalWriter(tmp_path, HEAD, NO_RESERVE, FailingDisk("sync", nth).create)
    for k in range(12):
        writer.append(block(10 * k, 10), HopLosses())
        writer.append_events([Event(k, "note")])
    assert len(writer.paths) == 2
    assert writer.status.recorded_frames == 120
    for close in (False, True):
        if close:
            writer.close()
        tail = last_recording(tmp_path)
        assert tail is not None
        assert (tail.frames, [event.t_ns for event in tail.events]) == (120, list(range(12)))
    contents = read_journal(writer.paths)
    assert (len(contents.frames), len(contents.events), contents.lost.any) == (120, 12, False)


def test_a_warning_lasts_a_minute(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, NO_RESERVE, FailingDisk("eio", 2).create) as writer:
        warning = "the first file could not be written: Input/output error"
        for now_s, says in ((5000.0, warning), (5060.0, warning), (5061.0, "")):
            writer.append(block(0, 10), HopLosses())
            writer.maintain(now_s)
            assert (writer.status.failed, writer.status.warning) == ("", says)
        writer.paths[0].unlink()
        writer.maintain(5062.0)
        assert "was removed or replaced: 30 recorded frames are lost" in writer.status.warning
        assert writer.status.recorded_frames == 0


def test_a_recording_goes_on_if_its_end_cannot_be_written(tmp_path: Path) -> None:
    files: list[StubbornFile] = []

    def create(path: Path) -> StubbornFile:
        if files and files[0].left == 0:
            raise OSError(28, "No space left on device")
        files.append(StubbornFile(path, 1 << 30))
        return files[-1]

    with JournalWriter(tmp_path, HEAD, NO_RESERVE, create) as writer:
        writer.append(block(0, 10), HopLosses())
        files[0].left = 0
        assert not writer.begin(NEXT)
        assert writer.head == HEAD
        files[0].left = 1
        writer.append_events([Event(1, "bump", 1.0, "baseline_bounce_1")])
        assert writer.flush()
        assert not recordings(tmp_path)[0].ended  # a recorder resumes it
        assert writer.begin(NEXT)
        assert writer.head.recording == NEXT.recording
    first, second = recordings(tmp_path)
    assert (first.frames, first.ended, second.ended) == (10, True, False)


# The disk and its room ----------------------------------------------------------------------------


@pytest.mark.parametrize(("free", "goes"), [(399_000_000, True), (401_000_000, False)])
def test_old_segments_go_below_twice_the_reserve(tmp_path: Path, free: int, goes: bool) -> None:
    with JournalWriter(tmp_path, NEXT, LIMITS, QuickFile, disk_usage=Checks().usage) as writer:
        writer.append(block(0, 10), HopLosses())
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, disk_usage=Checks(free).usage) as writer:
        writer.maintain(0.0)
        assert (tmp_path / "journal_0001.bbj").exists() is not goes


def test_a_full_disk_stops_recording_and_frames_wait(tmp_path: Path) -> None:
    disk = Checks(300_000_000)
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, disk_usage=disk.usage) as writer:
        writer.maintain(0.0)
        disk.free = 200_000_000
        writer.maintain(1.0)
        assert writer.status.failed == ""
        disk.free = 199_000_000
        writer.maintain(2.0)
        assert writer.status.failed == "the disk is full except for the reserve of 200 MB"
        writer.append(block(0, 10), HopLosses())
        disk.free = 209_000_000  # five percent more than the reserve are needed to go on
        writer.maintain(4.5)
        assert (writer.status.held_frames, writer.status.recorded_frames) == (10, 0)
        assert writer.status.lag_s == 2.5
        assert not writer.begin(NEXT)  # what waits belongs to this recording
        assert writer.head == HEAD
        disk.free = 211_000_000
        writer.maintain(5.5)
        assert (writer.status.held_frames, writer.status.recorded_frames) == (0, 10)
        assert (writer.status.failed, writer.status.lag_s) == ("", 0.0)
        assert writer.begin(NEXT)
    assert [(one.frames, one.ended) for one in recordings(tmp_path)] == [(10, True), (0, False)]


def test_no_block_overtakes_those_that_wait(tmp_path: Path) -> None:
    """A folder that lost its files is written anew, though its disk has no room yet."""
    disk = Checks()
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, disk_usage=disk.usage) as writer:
        for now_s, free in ((0.0, 10**12), (1.0, 0), (2.0, 0), (3.0, 10**12)):
            disk.free = free
            writer.maintain(now_s)
            writer.append(block(round(10 * now_s), 10), HopLosses())
            if now_s == 1.0:
                writer.paths[0].unlink()
                assert writer.status.held_frames == 10
            elif now_s == 2.0:
                assert "10 recorded frames are lost" in writer.status.warning
                assert writer.status.held_frames == 20
    assert numbers(read_journal(writer.paths).frames).tolist() == list(range(10, 40))


def test_a_disk_that_cannot_be_asked_is_said_and_asked_again(tmp_path: Path) -> None:
    disk = Checks()
    with JournalWriter(tmp_path, HEAD, NO_RESERVE, QuickFile, disk_usage=disk.usage) as writer:
        writer.maintain(0.0)
        assert writer.status.failed == ""
        disk.fails = True
        writer.maintain(1.0)
        assert "Input/output error" in writer.status.failed
        assert writer.status.free_bytes == writer.status.total_bytes == 10**12  # as it was last
        writer.append(block(0, 10), HopLosses())
        assert writer.status.recorded_frames == 10
        writer.maintain(2.0)
        disk.fails = False
        writer.maintain(3.0)
        assert writer.status.failed == ""


def test_a_folder_without_room_from_the_start_was_not_taken_away(tmp_path: Path) -> None:
    disk = Checks(0)
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, disk_usage=disk.usage) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.maintain(5000.0)
        assert writer.status.warning == ""
        assert "full" in writer.status.failed
        assert (writer.status.held_frames, writer.status.lag_s) == (10, 0.0)
        disk.free = 10**12
        writer.maintain(5001.0)
        assert (writer.status.failed, writer.status.recorded_frames) == ("", 10)


def test_a_place_that_is_none_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(JournalError, match="choose another folder"):
        JournalWriter(tmp_path / "file" / "below", HEAD)
