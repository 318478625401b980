"""A disk that takes nothing or cannot be asked: what the writer makes of it, fault by fault."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.folder import note_built, recordings
from daq.journal.format import JournalHead, head_record, receipt_path
from daq.journal.reader import read_journal
from daq.journal.retention import Retention
from daq.journal.segment import Room, Segment
from daq.journal.writer import JournalWriter
from daq.runs import Event

from ..crash_disk import QuickFile
from ..crash_frames import START_NS, block
from .test_retention import record

HEAD = JournalHead("", "", "test", START_NS, 0, "a" * 32)
NEXT = JournalHead("", "", "test", START_NS, 0, "b" * 32)
LIMITS = RecorderConfig(reserve_bytes=0.0)


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

    with JournalWriter(tmp_path, HEAD, LIMITS, create) as writer:
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

    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, room=room) as writer:
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

    with JournalWriter(tmp_path, HEAD, LIMITS, create) as writer:
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


def test_why_segments_may_not_be_deleted(tmp_path: Path) -> None:
    (path,) = record(tmp_path, "a", range(2), Event(START_NS, "bump", 1.0, "baseline_bounce_1"))
    retention = Retention(tmp_path, "b" * 32)
    assert retention.choose(1.0, START_NS) == ()
    assert "session" in retention.why_not
    # Where it may go, but for a copier's receipt.
    again = Retention(tmp_path, "b" * 32)
    note_built(tmp_path, "a" * 32, 100, path)
    assert again.choose(1.0, START_NS, copied=True) == ()
    assert "receipt" in again.why_not
    receipt_path(path).touch()
    chosen = again.choose(1.0, START_NS, copied=True)
    assert chosen is not None
    assert [info.path for info in chosen] == [path]
    again.delete(chosen[0])
    assert not path.exists()
    assert not receipt_path(path).exists()
    assert again.bytes == 0
