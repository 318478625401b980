from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.folder import (
    SegmentInfo,
    built_recordings,
    last_recording,
    note_built,
    recordings,
    scan,
    segments_in,
)
from daq.journal.format import JournalHead
from daq.journal.reader import read_journal
from daq.journal.retention import expendable, oldest
from daq.journal.writer import JournalError, JournalWriter
from daq.runs import Event

from ..crash_disk import QuickFile
from ..crash_frames import START_NS, block, numbers

HOUR_NS = 3_600_000_000_000


def info(number: int, recording: str, hour: float, *codes: str) -> SegmentInfo:
    """Return a segment of a minute, with events in the middle of it."""
    first_ns = round(hour * HOUR_NS)
    last_ns = first_ns + 60_000_000_000
    events = tuple((number, Event(first_ns + 30_000_000_000, code)) for code in codes)
    path = Path(f"journal_{number:04d}.mcap")
    return SegmentInfo(path, recording, number, 1, 100, 0, 1, 10, first_ns, last_ns, events, True)


def names(infos: tuple[SegmentInfo, ...]) -> list[int]:
    return [one.number for one in infos]


def test_of_old_recordings_those_go_that_are_derived_or_without_a_run() -> None:
    segments = [
        info(3, "idle", 3.0),
        info(1, "kept", 1.0, "bump"),
        info(2, "kept", 2.0),
        info(4, "derived", 4.0, "bump", "verdict"),
        info(5, "derived", 5.0),
    ]
    may = expendable(segments, "open", {"derived"}, 100 * HOUR_NS)
    assert names(may) == [3, 4, 5]
    assert names(oldest(may, 150.0)) == [3, 4]
    assert oldest(may, 0.0) == ()


def test_of_the_open_recording_nothing_goes_that_a_run_needs() -> None:
    reach_h = 1 / 3  # 1200 s
    segments = [
        info(1, "open", 0.0, "bench"),
        info(2, "open", 1.0, "alarm"),
        info(3, "open", 5.0 - reach_h - 0.1),
        info(4, "open", 5.0 - reach_h / 2),
        info(5, "open", 5.0, "bump"),
        info(6, "open", 5.0 + reach_h / 2),
        info(7, "open", 5.0 + reach_h + 0.1),
        info(8, "open", 9.0 - reach_h / 2),
    ]
    assert names(expendable(segments, "open", {"open"}, 9 * HOUR_NS)) == [2, 3, 7]


def head(recording: str) -> JournalHead:
    return JournalHead("", "", "test", START_NS, 0, recording * 32)


def record(folder: Path, recording: str, blocks: range, *events: Event) -> tuple[Path, ...]:
    limits = RecorderConfig(segment_bytes=20_000.0, reserve_bytes=0.0)
    with JournalWriter(folder, head(recording), limits, QuickFile) as writer:
        if events:
            writer.append_events(events)
        for k in blocks:
            writer.append(block(100 * k, 100), HopLosses())
            writer.maintain(0.1 * k)
    return writer.paths


def test_the_oldest_goes_when_there_is_too_much_and_it_is_no_loss(tmp_path: Path) -> None:
    old = record(tmp_path, "a", range(30), Event(START_NS, "bump", 1.0, "baseline_bounce_1"))
    session = tmp_path / "session.h5"
    session.write_bytes(b"whole")
    stop = max(found.stop for path in old if (found := scan(path)))
    infos = [found for path in old if (found := scan(path))]
    note_built(tmp_path, "a" * 32, stop - 1, session)
    assert built_recordings(tmp_path, infos) == set()  # there is more than was derived
    note_built(tmp_path, "a" * 32, stop, session)
    assert built_recordings(tmp_path, infos) == {"a" * 32}

    total = sum(path.stat().st_size for path in old)
    limits = RecorderConfig(segment_bytes=1e6, keep_bytes=total - 1, reserve_bytes=0.0)
    with JournalWriter(tmp_path, head("b"), limits, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        for k in range(3):
            writer.maintain(float(k))
        assert writer.status.warning == ""
    assert [path.exists() for path in old[:2]] == [False, True]
    contents = read_journal(writer.paths)
    assert not contents.lost.any
    (event,) = [e for e in contents.events if e.code == "retention"]
    gone = next(one for one in infos if one.path == old[0])
    assert event.value == gone.frames
    assert old[0].name in event.text
    # Of the old recording itself, blocks are missing now.
    assert read_journal(old[1:]).lost.blocks_missing == gone.stop
    session.write_bytes(b"cut")
    assert built_recordings(tmp_path, infos) == set()


def test_what_may_not_go_stays_and_is_warned_of(tmp_path: Path) -> None:
    old = record(tmp_path, "a", range(30), Event(START_NS, "bump", 1.0, "baseline_bounce_1"))
    limits = RecorderConfig(keep_bytes=1000.0, reserve_bytes=0.0)
    with JournalWriter(tmp_path, head("b"), limits, QuickFile) as writer:
        writer.append(block(0, 10), HopLosses())
        writer.maintain(0.0)
        assert "none of it may be deleted" in writer.status.warning
        writer.append(block(10, 10), HopLosses())
        assert writer.status.recorded_frames == 20
    assert all(path.exists() for path in old)


def test_hours_without_a_run_go_from_the_open_recording_and_are_no_loss(tmp_path: Path) -> None:
    limits = RecorderConfig(segment_bytes=15_000.0, keep_bytes=60_000.0, reserve_bytes=0.0)
    with JournalWriter(tmp_path, head("a"), limits, QuickFile) as writer:
        for k in range(60):
            # A hundred frames every four minutes.
            frames = block(3_840_000 * k, 100)
            writer.append(frames, HopLosses())
            writer.maintain(240.0 * k)
    assert writer.paths == segments_in(tmp_path)  # a session is derived of these
    contents = read_journal(segments_in(tmp_path))
    read = numbers(contents.frames)
    assert len(read) < 60 * 100
    assert read[-1] == 3_840_000 * 59 + 99
    assert not contents.lost.any
    assert "deleted to make room" in contents.lost.text
    # What the deleted files reported of files before them is reported still, and once.
    assert sum(event.value for event in contents.events) == 60 * 100 - len(read)
    assert {event.code for event in contents.events} == {"retention"}


def test_recordings_in_a_folder_are_distinguished(tmp_path: Path) -> None:
    bump = Event(START_NS, "bump", 1.0, "baseline_bounce_1")
    first = record(tmp_path, "a", range(5), bump)
    with JournalWriter(tmp_path, head("b"), RecorderConfig(), QuickFile) as writer:
        writer.append(block(500, 7), HopLosses())
        writer.close(ended=True)
    (tmp_path / "journal_0009.mcap").write_bytes(b"something else")
    a, b = recordings(tmp_path)
    assert (a.recording, a.segments, a.frames, a.bumps, a.ended) == ("a" * 32, first, 500, 1, False)
    assert (a.first_ns, a.last_ns) == (block(0, 1).t_ns[0], block(499, 1).t_ns[0])
    assert a.bytes == sum(path.stat().st_size for path in first)
    assert (b.recording, b.frames, b.bumps, b.ended) == ("b" * 32, 7, 0, True)
    tail = last_recording(tmp_path)
    assert tail is not None
    assert (tail.head, tail.frames, tail.ended) == (head("b"), 7, True)
    assert last_recording(tmp_path / "nothing") is None


def test_a_recording_goes_on_in_another_process(tmp_path: Path) -> None:
    record(tmp_path, "a", range(3), Event(START_NS, "mark", 0.0, "before"))
    tail = last_recording(tmp_path)
    assert tail is not None
    later = JournalHead("", "", "test", START_NS + 10**12, 9, "a" * 32)
    with JournalWriter(tmp_path, later, RecorderConfig(), QuickFile, tail) as writer:
        assert writer.status.recorded_frames == 300
        writer.append(block(300, 100), HopLosses(bus_dropped=5))
        writer.append_events([Event(START_NS, "resumed")])
    contents = read_journal(segments_in(tmp_path))
    assert len(numbers(contents.frames)) == 400
    assert [event.code for event in contents.events] == ["mark", "resumed"]
    assert contents.hops.between(0, 2**62).bus_dropped == 5
    assert not contents.lost.any


def test_a_segment_ends_by_size_and_by_age_but_not_without_blocks(tmp_path: Path) -> None:
    limits = RecorderConfig(segment_bytes=1e9, segment_s=10.0, reserve_bytes=0.0)
    with JournalWriter(tmp_path, head("a"), limits, QuickFile) as writer:
        writer.maintain(0.0)
        for k in range(1, 40):
            writer.maintain(float(k))  # silent
        assert len(segments_in(tmp_path)) == 1
        writer.append(block(0, 10), HopLosses())
        writer.maintain(40.0)
        writer.append(block(10, 10), HopLosses())
        assert len(writer.paths) == 2
    assert [info.frames for path in writer.paths if (info := scan(path))] == [10, 10]


def test_a_place_that_is_none_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(JournalError, match="choose another folder"):
        JournalWriter(tmp_path / "file" / "below", head("a"))
