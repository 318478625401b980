"""The limits of the journal in numbers, with a case on each side of every one."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal import folder as journal_scan
from daq.journal.contents import HopCounts, JournalLoss
from daq.journal.folder import (
    SegmentInfo,
    _grouped,
    built_recordings,
    built_revision,
    is_outdated,
    last_recording,
    next_segment,
    note_built,
    scan,
    segments_in,
    state_of,
)
from daq.journal.format import FRAMES_TOPIC, Gap, JournalHead, gap_event, parse_gap, segment_number
from daq.journal.reader import read_journal
from daq.journal.records import SegmentFile, Summary, read_summary
from daq.journal.retention import Retention, expendable, parting_events
from daq.journal.segment import (
    Backlog,
    Block,
    DiskWatch,
    Room,
    WriteLedger,
    low_text,
    taken_away,
    too_little,
)
from daq.journal.segment_reader import SegmentReader
from daq.journal.writer import JournalWriter
from daq.runs import Event

from ..crash_disk import QuickFile
from ..crash_frames import START_NS, block

S = 1_000_000_000
GB = 1_000_000_000
LIMITS = RecorderConfig(reserve_bytes=200e6)


def segment(number: int, first_ns: int, last_ns: int, *events: Event) -> SegmentInfo:
    numbered = tuple((0, event) for event in events)
    path = Path(f"journal_{number:04d}.mcap")
    return SegmentInfo(path, "open", number, 1, 100, 0, 1, 10, first_ns, last_ns, numbered, True)


@pytest.mark.parametrize(
    ("gap_s", "goes"), [(1199, False), (1200, False), (1201, True), (2400, True)]
)
def test_twenty_minutes_before_and_after_a_bump_are_kept(gap_s: int, goes: bool) -> None:
    now_ns = 100_000 * S
    bump = segment(2, 50_000 * S, 50_000 * S, Event(50_000 * S, "bump"))
    before = segment(1, 40_000 * S, (50_000 - gap_s) * S)
    after = segment(3, (50_000 + gap_s) * S, 60_000 * S)
    before_now = segment(4, 70_000 * S, (100_000 - gap_s) * S)
    for info in (before, after, before_now):
        found = expendable([bump, info], "open", set(), now_ns)
        assert (info in found) is goes, info.number
        assert bump not in found


@pytest.mark.parametrize("code", ["verdict", "accept", "reject", "undo", "note", "override"])
def test_a_segment_with_an_event_of_the_run_log_is_kept(code: str) -> None:
    plain = segment(1, 0, S, Event(0, "alarm"))
    logged = segment(2, 0, S, Event(0, code))
    assert expendable([plain, logged], "open", set(), 100_000 * S) == (plain,)


def test_eight_old_segments_are_scanned_in_one_call(tmp_path: Path) -> None:
    limits = RecorderConfig(segment_bytes=1.0, reserve_bytes=0.0)
    with JournalWriter(
        tmp_path, JournalHead("", "", "test", 0, 0, "a" * 32), limits, QuickFile
    ) as w:
        for k in range(8):  # and an empty one
            w.append(block(k, 1), HopLosses())
            w.maintain(0.0)
    nine = Retention(tmp_path, "b" * 32)
    assert nine.choose(1.0, 0) is None
    going = nine.choose(1.0, 0)
    assert going is not None
    assert [info.number for info in going] == [1]
    for info in going:
        nine.delete(info)
    eight = Retention(tmp_path, "b" * 32)
    assert eight.choose(1.0, 0) is not None
    assert eight.bytes == sum(path.stat().st_size for path in tmp_path.glob("journal_*"))


def test_a_deleted_segment_reports_its_own_gap_and_those_it_knew_of() -> None:
    def gap(first: int, stop: int, recording: str = "open") -> Gap:
        return Gap(recording, first, stop, 7, f"journal_{first}.mcap")

    before = gap_event("retention", 1, gap(10, 20))
    apart = gap_event("retention", 1, gap(1, 5))
    foreign = gap_event("disk_gap", 1, gap(1, 5, "other"))
    lost = gap_event("disk_gap", 1, gap(30, 31))
    path = Path("journal_0009.mcap")
    events = tuple((20, event) for event in (before, apart, foreign, lost, Event(2, "alarm")))
    info = SegmentInfo(path, "open", 9, 1, 100, 20, 30, 70, 0, 1, events, True)
    *kept, own = parting_events(info, "open", 5)
    assert kept == [apart, lost]
    assert own.t_ns == 5
    name = "journal_10.mcap to journal_0009.mcap"
    assert parse_gap(own) == Gap("open", 10, 30, 77, name)
    assert own.value == 77


@pytest.mark.parametrize(
    ("free", "stopped", "stops"),
    [(199e6, False, True), (200e6, False, False), (209e6, True, True), (211e6, True, False)],
)
def test_recording_stops_at_the_reserve_and_goes_on_five_percent_above(
    free: float, stopped: bool, stops: bool
) -> None:
    assert too_little(Room(int(free), 10**12), LIMITS, stopped) is stops


@pytest.mark.parametrize(
    ("free", "total", "warned"),
    [
        (1_999_000_000, 4 * GB, True),
        (2_001_000_000, 4 * GB, False),
        (9_990_000_000, 100 * GB, True),
        (10_010_000_000, 100 * GB, False),
    ],
)
def test_little_room_is_ten_reserves_or_a_tenth_of_the_disk(
    free: int, total: int, warned: bool
) -> None:
    assert bool(low_text(Room(free, total), LIMITS)) is warned


def test_little_room_is_given_in_gigabytes_and_percent() -> None:
    text = "1,500 MB (3%) left on the disk; recording stops at 200 MB"
    assert low_text(Room(1_500_000_000, 50 * GB), LIMITS) == text
    assert "(0%)" in low_text(Room(0, 0), LIMITS)


def test_a_file_that_was_deleted_replaced_or_cut_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"123")
    with path.open("rb") as file:
        opened = os.fstat(file.fileno())
        assert taken_away(path, opened, 3) == ""
        assert taken_away(path, opened, 4) == "was truncated"
        path.rename(tmp_path / "b")
        assert taken_away(path, os.fstat(file.fileno()), 3) == "was deleted"
        path.write_bytes(b"123")
        assert taken_away(path, os.fstat(file.fileno()), 3) == "was replaced by another file"


def test_a_folder_that_was_replaced_is_noticed(tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    folder.mkdir()
    watch = DiskWatch(folder, lambda _: Room(1, 2))
    watch.settle()
    assert watch.taken_text(None) == ""
    folder.rename(tmp_path / "moved")
    assert "journal was removed" in watch.taken_text(None)
    folder.mkdir()
    assert "journal was removed" in watch.taken_text(None)
    watch.settle()
    assert watch.taken_text(None) == ""


def waiting(number: int, size: int, frames: int = 1) -> Block:
    return Block(number, "frames" if frames else "events", 0, bytes(size), frames)


def test_frames_wait_in_32_megabytes_and_events_in_4_more() -> None:
    backlog = Backlog("a")
    backlog.put(waiting(0, 31_999_599, 10), 5.0)
    assert backlog.bytes == 31_999_999  # 400 bytes for the block itself
    backlog.put(waiting(1, 1, 3), 6.0)
    assert (backlog.frames, backlog.dropped) == (13, 0)
    backlog.put(waiting(2, 1, 4), 7.0)
    assert (backlog.frames, backlog.dropped, len(backlog)) == (13, 4, 2)
    backlog.put(waiting(3, 3_998_000, 0), 8.0)
    assert len(backlog) == 3
    backlog.put(waiting(4, 4_000, 0), 8.0)
    assert len(backlog) == 3
    assert backlog.since_s() == 5.0
    backlog.remove(3)
    assert (len(backlog), backlog.bytes, backlog.frames) == (0, 0, 0)
    assert backlog.since_s() is None
    assert backlog.take_gap() == Gap("a", 2, 5, 4)
    assert backlog.take_gap() is None


def test_one_gap_has_all_frames_until_the_disk_takes_blocks_again() -> None:
    backlog = Backlog("a")
    backlog.put(waiting(0, 40_000_000, 9), 0.0)
    backlog.put(waiting(1, 1, 2), 0.0)  # there is room, but it would make a second gap
    assert (backlog.dropped, len(backlog)) == (11, 0)
    assert backlog.take_gap() == Gap("a", 0, 2, 11)
    backlog.put(waiting(2, 1, 2), 0.0)
    assert len(backlog) == 1


def test_blocks_are_taken_up_to_a_size_and_at_least_one() -> None:
    backlog = Backlog("a")
    for number in range(4):
        backlog.put(waiting(number, 100), 0.0)
    assert [b.number for b in backlog.first(1)] == [0]
    assert [b.number for b in backlog.first(200)] == [0, 1]
    assert [b.number for b in backlog.first(299)] == [0, 1]
    assert [b.number for b in backlog.first(10**9)] == [0, 1, 2, 3]


def test_a_session_file_counts_as_built_with_its_size_and_all_blocks(tmp_path: Path) -> None:
    session = tmp_path / "session_0001.h5"
    session.write_bytes(b"12345")
    infos = [segment(1, 0, 1)]  # one block: 0
    assert built_revision(tmp_path, "open") is None
    assert not is_outdated(tmp_path, "open", 1)
    note_built(tmp_path, "open", 1, session, 3)
    assert built_recordings(tmp_path, infos) == {"open"}
    assert built_revision(tmp_path, "open") == 3
    assert not is_outdated(tmp_path, "open", 1)
    assert is_outdated(tmp_path, "open", 2)
    note_built(tmp_path, "open", 0, session, 3)
    assert built_recordings(tmp_path, infos) == set()
    note_built(tmp_path, "open", 1, session, 3)
    session.write_bytes(b"123456")
    assert built_recordings(tmp_path, infos) == set()
    assert built_revision(tmp_path, "open") is None
    assert is_outdated(tmp_path, "open", 2)
    (tmp_path / "derived_open.json").write_text("[]")
    assert not is_outdated(tmp_path, "open", 2)


def test_the_note_of_an_older_version_without_a_revision_is_read(tmp_path: Path) -> None:
    session = tmp_path / "session_0001.h5"
    session.write_bytes(b"12345")
    note = {"stop": 4, "session": str(session), "bytes": 5}
    (tmp_path / "derived_open.json").write_text(json.dumps(note))
    assert built_revision(tmp_path, "open") == -1
    assert is_outdated(tmp_path, "open", 5)
    assert not is_outdated(tmp_path, "open", 4)


def test_the_first_twenty_notes_are_given_and_the_others_counted() -> None:
    notes = tuple(f"n{k}" for k in range(21))
    assert JournalLoss(notes=notes[:20]).text == "; ".join(notes[:20])
    assert JournalLoss(notes=notes).text == "; ".join(notes[:20]) + "; 1 more note"


def test_each_kind_of_loss_is_a_loss() -> None:
    assert JournalLoss(bytes_cut=1).any
    assert JournalLoss(blocks_corrupt=1).any
    assert JournalLoss(blocks_missing=1).any
    assert JournalLoss(frames_dropped=1).any
    assert not JournalLoss(segments_unclosed=1, notes=("not closed",)).any


def test_losses_between_two_times_are_those_of_the_blocks_that_overlap() -> None:
    hops = HopCounts(np.array([10, 20, 30]), np.array([[1, 0, 0, 0], [3, 0, 0, 0], [7, 0, 0, 0]]))
    assert [hops.between(a, b).bus_dropped for a, b in [(0, 10), (10, 10), (11, 20), (20, 21)]] == [
        1,
        1,
        2,
        6,
    ]
    assert hops.between(21, 30).bus_dropped == 4
    assert hops.between(31, 40).bus_dropped == 0
    assert HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64)).between(0, 9) == HopLosses()


def test_numbers_of_segments(tmp_path: Path) -> None:
    assert next_segment(tmp_path) == 1
    (tmp_path / "journal_0041.mcap").touch()
    (tmp_path / "journal_x.mcap").touch()
    assert segment_number(tmp_path / "journal_x.mcap") == 0
    assert next_segment(tmp_path) == 42


def test_segments_are_in_the_order_of_their_numbers_not_of_their_names(tmp_path: Path) -> None:
    names = ["journal_0002.mcap", "open_9998.mcap", "journal_9999.mcap", "journal_10000.mcap"]
    for name in reversed(names):
        (tmp_path / name).touch()
    assert [path.name for path in segments_in(tmp_path)] == names
    ledger = WriteLedger("r")
    for number, name in enumerate(reversed(names)):
        ledger.note(tmp_path / name, [Block(number, FRAMES_TOPIC, 0, b"", 5)])
    assert [path.name for path in ledger.paths] == names


def test_a_session_file_has_the_number_of_the_segment_with_which_its_recording_began() -> None:
    """In journals of older versions each segment states its own number."""
    infos = [replace(segment(number, 0, 1), first_segment=number) for number in (8, 7)]
    (recording,) = _grouped(infos)
    assert (recording.first_segment, recording.session_name) == (7, "session_0007.h5")


# The state of a recording is read from the ends of its segments, not from all of their blocks -----

BUMP = Event(START_NS, "bump", 1.5, "baseline_bounce_1")
NOTE = Event(START_NS + 7, "note", text="\N{GREEK SMALL LETTER ZETA} \x1b[31m \\ \x00")


def record(folder: Path, ended: bool = False) -> tuple[Path, ...]:
    head = JournalHead("bench", "dbc", "test", START_NS, 0, "a" * 32)
    limits = RecorderConfig(segment_bytes=20_000.0, reserve_bytes=0.0)
    writer = JournalWriter(folder, head, limits, QuickFile)
    writer.append_events([BUMP])
    for k in range(30):
        writer.append(block(100 * k, 100), HopLosses())
        writer.maintain(0.1 * k)
        if k == 20:
            writer.append_events([NOTE])
    writer.close(ended)
    return writer.paths


def test_a_sealed_segment_states_what_walking_through_it_finds(tmp_path: Path) -> None:
    for path in record(tmp_path):
        whole = path.read_bytes()
        summarised = scan(path)
        assert summarised is not None
        assert summarised.sealed
        path.write_bytes(whole[:-1])  # without its proper end it is walked through
        walked = scan(path)
        assert walked == replace(summarised, bytes=summarised.bytes - 1)
        path.write_bytes(whole)


def test_to_go_on_no_block_of_a_sealed_segment_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    *_, last = paths = record(tmp_path)
    last.write_bytes(last.read_bytes()[:-100])  # the recorder was killed
    walked: list[Path] = []

    def walking(segment: SegmentReader) -> tuple[Summary, tuple[tuple[int, int], ...]]:
        walked.append(segment.file.path)
        return walk(segment)

    walk = journal_scan._walk
    monkeypatch.setattr(journal_scan, "_walk", walking)
    tail = last_recording(tmp_path)
    assert tail is not None
    assert (tail.segments, tail.frames, tail.ended) == (paths, 3000, False)
    assert tail.events == (BUMP, NOTE)
    assert walked == [last]


def test_the_end_of_a_recording_is_in_its_last_summary(tmp_path: Path) -> None:
    record(tmp_path, ended=True)
    tail = last_recording(tmp_path)
    assert tail is not None
    assert tail.ended


def test_each_event_counts_once_though_the_last_block_is_in_the_next_segment_too(
    tmp_path: Path,
) -> None:
    info = scan(record(tmp_path)[0])
    assert info is not None
    first, second, *others = (Event(START_NS + k, "note", text=f"{k}") for k in range(5))
    infos = [
        replace(info, events=((0, first), (0, second), (1, others[0]), (2, others[1]))),
        replace(info, events=((2, others[1]), (3, others[2]))),
    ]
    assert state_of(infos).events == (first, second, *others)


def test_events_before_the_first_frame_are_at_no_time(tmp_path: Path) -> None:
    hops = read_journal(record(tmp_path)).hops
    assert hops.t_ns[0] == 0
    assert hops.t_ns[1] > START_NS


def test_a_changed_byte_of_the_summary_is_never_believed(tmp_path: Path) -> None:
    path = record(tmp_path)[0]
    whole = path.read_bytes()
    begin = whole.index(b"bumpbench_summary")
    summarised = scan(path)
    for at in range(begin, len(whole)):
        changed = bytearray(whole)
        changed[at] ^= 0x10
        path.write_bytes(changed)
        with SegmentFile(path) as file:
            summary = read_summary(file)
        found = scan(path)
        assert found is not None
        assert summarised is not None
        assert summary is None or found == summarised, at
        assert replace(found, sealed=True, blocks=()) == summarised, at
    path.write_bytes(whole)
    assert read_journal([path]).lost.text == ""


def test_an_end_torn_anywhere_costs_no_block(tmp_path: Path) -> None:
    path = record(tmp_path)[0]
    whole = path.read_bytes()
    begin = whole.index(b"bumpbench_summary") - 13
    for stop in range(begin, len(whole), 7):
        path.write_bytes(whole[:stop])
        assert not read_journal([path]).lost.any, stop


def test_a_footer_of_another_kind_or_place_is_none(tmp_path: Path) -> None:
    *_, last = record(tmp_path)
    whole = last.read_bytes()
    at = len(whole) - 37  # kind, length, start of the index, two numbers more, the magic

    def found(raw: bytes) -> Summary | None:
        last.write_bytes(raw)
        with SegmentFile(last) as file:
            return read_summary(file)

    assert found(whole) is not None
    for place in (at, at + 1, len(whole) - 1):
        assert found(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :]) is None
    for start in (0, len(whole), 1 << 60):
        assert found(whole[: at + 9] + start.to_bytes(8, "little") + whole[at + 17 :]) is None
