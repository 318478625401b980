"""Recordings in a folder: names of segments, one after another, and deleted to make room."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.format import SegmentFile
from daq.journal.reader import (
    last_campaign,
    last_recording,
    next_segment,
    read_journal,
    recordings,
    scan,
    seal_left_open,
    segments_in,
)
from daq.journal.writer import JournalWriter
from daq.runs import Event

from ..crash_frames import HEAD, START_NS, FailingDisk, QuickFile, block, numbers

LIMITS = RecorderConfig(segment_bytes=20_000.0, reserve_bytes=0.0)
BUMP = Event(START_NS, "bump", 1.5, "baseline_bounce_1")
NOTE = Event(START_NS + 7, "note", text="\N{GREEK SMALL LETTER ZETA} \x1b[31m \\ \x00")
A, B = (replace(HEAD, recording=letter * 32) for letter in "ab")


def record(folder: Path, *, ended: bool = False) -> tuple[Path, ...]:
    """Record a bump, 30 blocks of 100 frames and a note in four segments."""
    with JournalWriter(folder, A, LIMITS, QuickFile) as writer:
        writer.append_events([BUMP])
        for k in range(30):
            writer.append(block(100 * k, 100), HopLosses())
            writer.maintain(0.1 * k)
            if k == 20:
                writer.append_events([NOTE])
        if ended:
            writer.close(ended=True)
    return writer.paths


def names(folder: Path) -> list[str]:
    return [path.name for path in segments_in(folder)]


# Names and ends of segments -----------------------------------------------------------------------


def test_the_open_segment_is_the_only_one_of_its_name(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile) as writer:
        for k in range(12):
            writer.append(block(100 * k, 100), HopLosses())
            writer.maintain(0.1 * k)
        assert names(tmp_path) == ["journal_0001.bbj", "open_0002.bbj"]
        sizes = [path.stat().st_size for path in segments_in(tmp_path)]
        assert writer.status.journal_bytes == sum(sizes)
        assert [path.name for path in writer.paths] == names(tmp_path)
        listed = segments_in(tmp_path)
        assert numbers(read_journal(listed).frames).tolist() == list(range(1200))
    assert names(tmp_path) == ["journal_0001.bbj", "journal_0002.bbj"]
    assert writer.paths == segments_in(tmp_path)
    # A reader that had listed the files before finds the one that has another name now.
    assert numbers(read_journal(listed).frames).tolist() == list(range(1200))


@pytest.mark.parametrize(("size", "files"), [(9_000.0, 2), (12_000.0, 1)])
def test_a_segment_ends_at_its_size(tmp_path: Path, size: float, files: int) -> None:
    limits = RecorderConfig(segment_bytes=size, reserve_bytes=0.0)
    with JournalWriter(tmp_path, HEAD, limits, QuickFile) as writer:
        writer.append(block(0, 400), HopLosses())  # 9.6 kB and the head
        writer.maintain(0.0)
        assert len(segments_in(tmp_path)) == files


def test_a_segment_ends_at_its_age_but_not_without_blocks(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, RecorderConfig(reserve_bytes=0.0), QuickFile) as writer:
        writer.maintain(0.0)
        writer.maintain(10_000.0)  # silent
        writer.append(block(0, 1), HopLosses())
        writer.maintain(10_001.0)
        writer.append(block(1, 1), HopLosses())
        writer.maintain(10_900.9)
        assert len(segments_in(tmp_path)) == 2
        writer.maintain(10_901.0)
        assert len(segments_in(tmp_path)) == 3


def test_a_segment_with_a_failed_write_never_changes_again_either(tmp_path: Path) -> None:
    writer = JournalWriter(tmp_path, HEAD, LIMITS, FailingDisk("eio", 30).create)
    for k in range(20):
        writer.append(block(10 * k, 10), HopLosses())
    assert names(tmp_path) == ["journal_0001.bbj", "open_0002.bbj"]
    first = scan(tmp_path / "journal_0001.bbj")
    assert first is not None
    assert first.blocks
    writer.close()


def test_what_a_killed_recorder_left_open_is_named_as_it_is(tmp_path: Path) -> None:
    writer = JournalWriter(tmp_path, HEAD, LIMITS, QuickFile)
    writer.append(block(0, 100), HopLosses())
    os.mkfifo(tmp_path / "open_0007.bbj")
    (tmp_path / "open_0009.bbj").write_bytes(b"mine")
    (tmp_path / "journal_0009.bbj").write_bytes(b"yours")
    seal_left_open(tmp_path)
    assert (tmp_path / "open_0007.bbj").is_fifo()
    assert (tmp_path / "journal_0009.bbj").read_bytes() == b"yours"
    assert (tmp_path / "open_0009.bbj").read_bytes() == b"mine"
    tail = last_recording(tmp_path)
    assert tail is not None
    assert (tail.frames, [path.name for path in tail.segments]) == (100, ["journal_0001.bbj"])
    writer.close()


def test_segments_are_numbered_on_and_never_overwritten(tmp_path: Path) -> None:
    assert next_segment(tmp_path) == 1
    (tmp_path / "journal_0007.bbj").write_bytes(b"precious")
    (tmp_path / "journal_old.bbj").write_bytes(b"")
    (tmp_path / "journal_0041.mcap").touch()  # of Bumpbench 0.1, with its session_0041.h5
    with JournalWriter(tmp_path, HEAD, LIMITS) as journal:
        journal.append(block(0, 1), HopLosses())
        assert [path.name for path in journal.paths] == ["open_0042.bbj"]
    assert (tmp_path / "journal_0007.bbj").read_bytes() == b"precious"


def test_segments_are_in_the_order_of_their_numbers_not_of_their_names(tmp_path: Path) -> None:
    in_order = ["journal_0002.bbj", "open_9998.bbj", "journal_9999.bbj", "journal_10000.bbj"]
    for name in reversed(in_order):
        (tmp_path / name).touch()
    assert names(tmp_path) == in_order


# The state of recordings --------------------------------------------------------------------------


def test_a_sealed_segment_states_what_walking_through_it_finds(tmp_path: Path) -> None:
    for path in record(tmp_path):
        whole = path.read_bytes()
        summarised = scan(path)
        assert summarised is not None
        assert not summarised.blocks
        path.write_bytes(whole[:-1])  # without its proper end it is walked through
        walked = scan(path)
        assert walked is not None
        assert walked.blocks
        assert replace(walked, blocks=()) == summarised
        path.write_bytes(whole)


def test_to_go_on_no_block_of_a_sealed_segment_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    *_, last = paths = record(tmp_path)
    last.write_bytes(last.read_bytes()[:-100])  # the recorder was killed
    walked: list[Path] = []
    really = SegmentFile.blocks

    def blocks(file: SegmentFile) -> object:
        walked.append(file.path)
        return really(file)

    monkeypatch.setattr(SegmentFile, "blocks", blocks)
    tail = last_recording(tmp_path)
    assert tail is not None
    assert (tail.segments, tail.frames, tail.ended) == (paths, 3000, False)
    assert tail.events == (BUMP, NOTE)
    assert set(walked) == {last}


def test_one_recording_ends_and_the_next_begins(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, A, LIMITS, QuickFile) as writer:
        writer.append_events([BUMP])
        writer.append(block(0, 10), HopLosses())
        writer.cut()
        writer.append(block(10, 10), HopLosses())
        between = replace(B, campaign=False)
        assert writer.begin(between)
        assert writer.head == replace(between, first_segment=3)
        assert writer.status.recorded_frames == 0
        writer.append(block(20, 5), HopLosses())
        assert (writer.status.recorded_frames, writer.stored_frames) == (5, 25)
        assert [path.name for path in writer.paths] == ["open_0003.bbj"]
    (tmp_path / "journal_0009.bbj").write_bytes(b"something else")
    first, second = recordings(tmp_path)
    assert (first.head, first.frames, first.bumps, first.ended) == (A, 20, 1, True)
    assert (first.first_ns, first.last_ns) == (block(0, 1).t_ns[0], block(19, 1).t_ns[0])
    assert [path.name for path in first.segments] == ["journal_0001.bbj", "journal_0002.bbj"]
    assert (second.head.recording, second.frames, second.ended) == (B.recording, 5, False)
    assert (first.session_name, second.session_name) == ("session_0001.h5", "session_0003.h5")
    assert last_recording(tmp_path) == second
    assert last_campaign(tmp_path) == first
    assert last_recording(tmp_path / "nothing") is None


# Room ---------------------------------------------------------------------------------------------


def test_the_oldest_goes_when_there_is_too_much_and_it_is_no_loss(tmp_path: Path) -> None:
    old = record(tmp_path)
    total = sum(path.stat().st_size for path in old)
    limits = RecorderConfig(segment_bytes=1e6, keep_bytes=total - 1, reserve_bytes=0.0)
    with JournalWriter(tmp_path, B, limits, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        for k in range(3):
            writer.maintain(float(k))
        assert writer.status.warning == ""
    assert [path.exists() for path in old[:2]] == [False, True]
    assert not read_journal(writer.paths).lost.any
    # Of the old recording itself, blocks are missing now.
    assert read_journal(old[1:]).lost.blocks_missing > 0


def test_the_runs_of_the_present_recording_stay_with_the_time_around_them(tmp_path: Path) -> None:
    """A segment every 240 s, a bump in the sixteenth: 1200 s before and after it stay."""
    limits = RecorderConfig(segment_bytes=1.0, keep_bytes=1000.0, reserve_bytes=0.0)
    with JournalWriter(tmp_path, A, limits, QuickFile) as writer:
        for k in range(30):
            part = block(3_840_000 * k, 10)
            writer.append(part, HopLosses())
            if k == 15:
                writer.append_events([Event(int(part.t_ns[0]), "bump", 1.0, "baseline_bounce_1")])
            writer.maintain(240.0 * k)
        for k in range(30, 40):
            writer.maintain(240.0 * k)
    contents = read_journal(writer.paths)
    assert not contents.lost.any
    kept = numbers(contents.frames)[::10] // 3_840_000
    assert kept.tolist() == [*range(10, 21), *range(24, 30)]


def test_what_may_not_go_stays_and_is_warned_of(tmp_path: Path) -> None:
    limits = RecorderConfig(keep_bytes=1000.0, reserve_bytes=0.0)
    with JournalWriter(tmp_path, B, limits, QuickFile) as writer:
        writer.append_events([BUMP])
        writer.append(block(0, 50), HopLosses())
        writer.cut()
        writer.maintain(0.0)
        assert "none of it may be deleted" in writer.status.warning
        writer.append(block(10, 10), HopLosses())
        assert writer.status.recorded_frames == 60
    assert all(path.exists() for path in writer.paths)


def test_hours_without_a_run_go_from_the_open_recording_and_are_no_loss(tmp_path: Path) -> None:
    limits = RecorderConfig(segment_bytes=15_000.0, keep_bytes=60_000.0, reserve_bytes=0.0)
    with JournalWriter(tmp_path, A, limits, QuickFile) as writer:
        for k in range(60):
            writer.append(block(3_840_000 * k, 100), HopLosses())
            writer.maintain(240.0 * k)
    assert writer.paths == segments_in(tmp_path)  # a session is derived of these
    assert sum(path.stat().st_size for path in writer.paths) < 80_000
    contents = read_journal(segments_in(tmp_path))
    read = numbers(contents.frames)
    assert len(read) < 60 * 100
    assert read[-1] == 3_840_000 * 59 + 99
    assert not contents.lost.any
    assert "deleted to make room" in contents.lost.text
    # What the deleted files reported of files before them is reported still, and once.
    assert sum(event.value for event in contents.events) == 60 * 100 - len(read)
    assert {event.code for event in contents.events} == {"retention"}
