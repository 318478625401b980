"""The state of a recording is read from the ends of its segments, not from all of their blocks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal import folder as journal_scan
from daq.journal.folder import last_recording, scan, state_of
from daq.journal.format import JournalHead
from daq.journal.reader import read_journal
from daq.journal.records import SegmentFile, Summary, read_summary
from daq.journal.segment_reader import SegmentReader
from daq.journal.writer import JournalWriter
from daq.runs import Event

from ..crash_disk import QuickFile
from ..crash_frames import START_NS, block

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
