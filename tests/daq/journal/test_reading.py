"""Journals are read back whole, and damaged ones block by block with an exact account."""

from __future__ import annotations

import gc
import os
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.reader import (
    HopCounts,
    JournalLoss,
    SegmentInfo,
    deleted_event,
    last_recording,
    next_segment,
    read_windows,
    recording_of,
    recordings,
    recordings_of,
    scan,
    segments_in,
)
from daq.journal.segment import HEADER, MAGIC, Segment
from daq.journal.writer import JournalWriter
from daq.runs import Event
from dbc.frames import FrameBatch
from dbc.words import InputError

from ..crash_frames import HEAD, START_NS, QuickFile, block, numbers, read_journal

LIMITS = RecorderConfig(reserve_bytes=0.0)


def same(a: FrameBatch, b: FrameBatch) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(FrameBatch))


def segment(folder: Path, blocks: int = 3, *, killed: bool = True) -> tuple[Path, list[int]]:
    """Write blocks of 100 frames; return the file, and where its blocks begin and end.

    `killed`: without the segment's end.
    """
    writer = JournalWriter(folder, HEAD, LIMITS, QuickFile)
    path = segments_in(folder)[-1]
    edges = [path.stat().st_size]
    for k in range(blocks):
        writer.append(block(100 * k, 100), HopLosses())
        edges.append(path.stat().st_size)
    writer.close()
    if killed:
        os.truncate(path, edges[-1])
    return path, edges


def test_what_was_written_is_read(tmp_path: Path) -> None:
    events = (Event(3, "bump", 4.5, "baseline_bounce_1"), Event(9, "run_end", 0.1, "µ\n\0"))
    wide = replace(block(2, 3), data=np.pad(block(2, 3).data, ((0, 0), (0, 56)), mode="wrap"))
    head = replace(HEAD, bench_text="[bus]\n# µ\n")
    with JournalWriter(tmp_path / "new" / "folder", head, LIMITS) as journal:
        journal.append(block(0, 2), HopLosses(1, 2, 3, 4))
        journal.append_events(events[:1])
        journal.append(wide, HopLosses(5, 6, 7, 8))
        journal.append_events(events[1:])
        journal.append(FrameBatch.empty(), HopLosses(5, 6, 7, 9))
    contents = read_journal(journal.paths)
    assert contents.head == head
    assert same(contents.frames, FrameBatch.concatenate([block(0, 2), wide]))
    assert contents.events == events
    assert contents.lost == JournalLoss()
    assert contents.hops.between(0, 2 * START_NS) == HopLosses(5, 6, 7, 9)


def test_windows_of_time_may_overlap_and_be_empty(tmp_path: Path) -> None:
    path, _ = segment(tmp_path, 5)
    t_ns = block(0, 500).t_ns
    windows = [(int(t_ns[90]), int(t_ns[310])), (int(t_ns[300]), int(t_ns[301])), (0, 5)]
    contents = read_windows(recording_of([path]), windows)
    pieces = [numbers(frames).tolist() for frames in contents.windows]
    assert pieces == [list(range(90, 310)), [300], []]


def test_losses_belong_to_the_blocks_they_were_counted_with(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS) as journal:
        for k, dropped in enumerate([0, 0, 5, 5, 7]):
            journal.append(block(10 * k, 10), HopLosses(queue_dropped=dropped))
    hops = read_journal(journal.paths).hops
    t_ns = block(0, 50).t_ns

    def dropped_between(first: int, last: int) -> int:
        return hops.between(int(t_ns[first]), int(t_ns[last])).queue_dropped

    spans = [(0, 19), (12, 22), (29, 30), (30, 39), (30, 49)]
    assert [dropped_between(*span) for span in spans] == [0, 5, 5, 0, 2]
    assert hops.between(0, 10**19).queue_dropped == 7
    assert hops.between(10**19, 10**19 + 1).queue_dropped == 0
    none = HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))
    assert none.between(0, 9) == HopLosses()


def test_another_process_goes_on_with_its_own_counts(tmp_path: Path) -> None:
    path, edges = segment(tmp_path, 3)
    os.truncate(path, edges[-1] - 1)  # killed while it wrote
    tail = last_recording(tmp_path)
    assert tail is not None
    assert (tail.next_number, tail.frames, tail.ended) == (2, 200, False)
    later = replace(HEAD, wall_ns=HEAD.wall_ns + 5)
    with JournalWriter(tmp_path, later, LIMITS, QuickFile, tail) as writer:
        assert writer.status.recorded_frames == 200
        writer.append(block(300, 100), HopLosses(bus_dropped=5))
    contents = read_journal(segments_in(tmp_path))
    assert contents.head == HEAD
    assert numbers(contents.frames).tolist() == [*range(200), *range(300, 400)]
    assert contents.hops.between(0, 2**62).bus_dropped == 5
    # The new block has the number of the one that was cut off, and does not make up for it.
    assert contents.lost.bytes_cut == edges[-1] - edges[-2] - 1


# Damage -------------------------------------------------------------------------------------------


def test_a_tail_torn_at_any_byte_costs_that_block_alone(tmp_path: Path) -> None:
    path, (*_, before, end) = segment(tmp_path, 2)
    whole = path.read_bytes()
    for size in [*range(before, before + HEADER.size + 2, 3), *range(before, end, 401), end - 1]:
        path.write_bytes(whole[:size])
        contents = read_journal([path])
        assert same(contents.frames, block(0, 100))
        assert contents.lost.bytes_cut == size - before
        assert contents.lost.any == (size > before)
        assert (path.name in contents.lost.text) == (size > before)


def test_a_bit_changed_anywhere_costs_at_most_its_block_and_is_counted(tmp_path: Path) -> None:
    path, edges = segment(tmp_path, 12, killed=False)
    whole = path.read_bytes()
    rng = np.random.default_rng(41)
    harmless = 0
    for at in [*range(0, 56, 5), *rng.integers(0, len(whole), 40).tolist()]:
        changed = bytearray(whole)
        changed[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(changed)
        contents = read_journal([path])
        read = numbers(contents.frames)
        block_of = sum(edge <= at for edge in edges) - 1
        gone = [k for k in range(12) if 100 * k not in read]
        assert contents.lost.any == bool(gone), at
        assert gone in ([], [block_of])
        assert np.all(np.diff(read) > 0)
        assert contents.lost.blocks_missing == len(gone)
        assert scan(path).summary.stop == 12
        harmless += not gone
    assert 0 < harmless < 30


@pytest.mark.parametrize("zeros", [40, 3000, 25_000])
@pytest.mark.parametrize("killed", [False, True])
def test_a_beginning_of_zeros_costs_no_other_block(
    tmp_path: Path, zeros: int, killed: bool
) -> None:
    path, edges = segment(tmp_path, 30, killed=killed)
    data = bytearray(path.read_bytes())
    data[:zeros] = bytes(zeros)
    path.write_bytes(data)
    gone = sum(edge < zeros for edge in edges)
    contents = read_journal([path])
    assert contents.head == HEAD
    assert numbers(contents.frames).tolist() == list(range(100 * gone, 3000))
    assert contents.lost.blocks_missing == gone
    assert (path.name in contents.lost.text) == bool(gone)


def test_a_segment_without_any_head_is_read_with_that_of_another(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile) as writer:
        for k in range(4):
            writer.append(block(100 * k, 100), HopLosses())
            writer.cut()
    first, *others = writer.paths
    data = first.read_bytes()
    second = data.index(MAGIC, 1)
    end = data.rindex(MAGIC)
    first.write_bytes(bytes(second) + data[second:end])
    assert len(read_journal(writer.paths).frames) == 400
    assert not read_journal(writer.paths).lost.any
    assert read_journal([first, *others]).head == HEAD
    with pytest.raises(InputError, match=r"holds no recording with a bench.toml"):
        recordings_of([first])
    # Beside another recording, all of it is a loss.
    with JournalWriter(tmp_path / "b", replace(HEAD, recording="b" * 32), LIMITS) as writer:
        writer.append(block(0, 7), HopLosses())
    (info,) = recordings_of([first, *writer.paths])
    lost = read_journal(info.segments).lost
    assert (lost.bytes_cut, info.frames) == (len(bytes(second) + data[second:end]), 7)


@pytest.mark.parametrize("killed", [True, False])
def test_a_hole_and_blocks_cut_out_cost_those_blocks_alone(tmp_path: Path, killed: bool) -> None:
    path, edges = segment(tmp_path, 20, killed=killed)
    whole = path.read_bytes()
    hole = bytes(edges[6] - edges[3] - 12)
    path.write_bytes(whole[: edges[3] + 5] + hole + whole[edges[6] - 7 :])
    contents = read_journal([path])
    assert numbers(contents.frames).tolist() == [*range(300), *range(600, 2000)]
    assert contents.lost.blocks_missing == 3
    path.write_bytes(whole[: edges[3]] + whole[edges[6] :])
    contents = read_journal([path])
    assert numbers(contents.frames).tolist() == [*range(300), *range(600, 2000)]
    assert contents.lost.blocks_missing == 3


def test_magic_numbers_that_begin_no_block_are_passed_over(tmp_path: Path) -> None:
    path, edges = segment(tmp_path, 5)
    data = path.read_bytes()
    path.write_bytes(data[: edges[2]] + 1000 * MAGIC + bytes(2 << 20) + MAGIC + data[edges[2] :])
    contents = read_journal([path])
    assert numbers(contents.frames).tolist() == list(range(500))
    assert not contents.lost.any  # no block is missing


def test_an_end_torn_anywhere_costs_no_block(tmp_path: Path) -> None:
    path, edges = segment(tmp_path, 3, killed=False)
    whole = path.read_bytes()
    for stop in range(edges[-1] + HEADER.size, len(whole), 29):
        path.write_bytes(whole[:stop])
        assert not read_journal([path]).lost.any, stop
        assert scan(path).summary.frames == 300


def test_blocks_between_two_segments_are_missing_unless_they_were_deleted(tmp_path: Path) -> None:
    def written(*blocks: int, event: Event | None = None) -> int:
        for path in tmp_path.iterdir():
            path.unlink()
        with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile) as writer:
            for number in range(5):
                writer.append(block(number, 1), HopLosses())
                writer.cut()
            if event:
                writer.append_events([event])
        kept = [path for k, path in enumerate(writer.paths) if k in blocks or k == 5]
        return read_journal(kept).lost.blocks_missing

    assert written(0, 1, 2, 3, 4) == 0
    assert written(0, 4) == 3
    assert written(0, 4, event=deleted_event(0, [(1, 2), (2, 3)], 2)) == 1
    assert written(0, 4, event=deleted_event(0, [(0, 9)], 2)) == 0


def test_many_notes_on_losses_are_cut_short() -> None:
    assert JournalLoss(notes=("a", "b")).text == "a; b"
    text = JournalLoss(notes=tuple(f"n{k}" for k in range(1000))).text
    assert text.startswith("n0; n1; n2")
    assert len(text) == 2000


# Files that are no segment ------------------------------------------------------------------------


@pytest.mark.parametrize("content", [b"not a journal at all", b"", MAGIC + bytes(100)])
def test_a_file_that_is_no_journal_is_refused_alone_and_a_loss_beside_a_segment(
    tmp_path: Path, content: bytes
) -> None:
    path, _ = segment(tmp_path)
    other = tmp_path / "journal_0002.bbj"
    other.write_bytes(content)
    with pytest.raises(InputError, match="no whole block"):
        read_journal([other])
    (info,) = recordings_of(segments_in(tmp_path))
    assert info.segments == (path, other)
    contents = read_journal(info.segments)
    assert len(contents.frames) == 300
    assert contents.lost.bytes_cut == len(content)
    tail = last_recording(tmp_path)
    assert tail is not None
    assert tail.segments == (path,)


def test_a_missing_file_and_no_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_journal([tmp_path / "journal_0001.bbj"])
    with pytest.raises(InputError, match="holds no recording"):
        read_journal([])


def test_files_of_two_recordings_are_not_mixed(tmp_path: Path) -> None:
    with (
        JournalWriter(tmp_path, HEAD, LIMITS) as one,
        JournalWriter(tmp_path, replace(HEAD, recording="b" * 32), LIMITS) as two,
    ):
        one.append(block(0, 1), HopLosses())
        two.append(block(0, 1), HopLosses())
    with pytest.raises(InputError, match="another recording"):
        read_journal([*one.paths, *two.paths])


# Recordings in a folder: names of segments, one after another, and deleted to make room -----------

SMALL_LIMITS = RecorderConfig(segment_bytes=20_000.0, reserve_bytes=0.0)
BUMP = Event(START_NS, "bump", 1.5, "baseline_bounce_1")
NOTE = Event(START_NS + 7, "note", text="\N{GREEK SMALL LETTER ZETA} \x1b[31m \\ \x00")
A, B = (replace(HEAD, recording=letter * 32) for letter in "ab")


def record(folder: Path, *, ended: bool = False) -> tuple[Path, ...]:
    """Record a bump, 30 blocks of 100 frames and a note in four segments."""
    with JournalWriter(folder, A, SMALL_LIMITS, QuickFile) as writer:
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


def test_a_segment_ends_at_its_size_or_age_but_not_without_blocks(tmp_path: Path) -> None:
    limits = RecorderConfig(segment_bytes=12_000.0, reserve_bytes=0.0)
    with JournalWriter(tmp_path, HEAD, limits, QuickFile) as writer:
        for now_s, frames, files in (
            (0.0, 0, 1),
            (10_000.0, 0, 1),  # silent
            (10_001.0, 1, 2),
            (10_900.9, 400, 2),  # 9.6 kB and the head
            (10_901.0, 0, 3),
            (10_902.0, 500, 4),
        ):
            if frames:
                writer.append(block(0, frames), HopLosses())
            writer.maintain(now_s)
            assert len(segments_in(tmp_path)) == files, now_s


def test_segments_are_numbered_on_and_never_overwritten(tmp_path: Path) -> None:
    assert next_segment(tmp_path) == 1
    (tmp_path / "journal_0007.bbj").write_bytes(b"precious")
    (tmp_path / "journal_old.bbj").write_bytes(b"")
    with JournalWriter(tmp_path, HEAD, SMALL_LIMITS) as journal:
        journal.append(block(0, 1), HopLosses())
        assert [path.name for path in journal.paths] == ["journal_0008.bbj"]
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
        path.write_bytes(whole[:-1])  # without its proper end it is walked through
        assert scan(path) == summarised
        path.write_bytes(whole)


def test_a_segment_without_blocks_takes_none_from_the_one_before_it(tmp_path: Path) -> None:
    segment(tmp_path)  # blocks 0, 1 and 2
    path = tmp_path / "journal_0002.bbj"
    with QuickFile(path) as file:
        Segment(file, path, HEAD, 2)
    tail = last_recording(tmp_path)
    assert tail is not None
    assert tail.frames == 300


def test_one_recording_ends_and_the_next_begins(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, A, SMALL_LIMITS, QuickFile) as writer:
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
        assert [path.name for path in writer.paths] == ["journal_0003.bbj"]
    (tmp_path / "journal_0009.bbj").write_bytes(b"something else")
    first, second = recordings(tmp_path)
    assert second.segments[-1].name == "journal_0009.bbj"
    assert (first.head, first.frames, first.bumps, first.ended) == (A, 20, 1, True)
    assert first.last_ns == block(19, 1).t_ns[0]
    assert [path.name for path in first.segments] == ["journal_0001.bbj", "journal_0002.bbj"]
    assert (second.head.recording, second.frames, second.ended) == (B.recording, 5, False)
    sessions = [recording.head.session_name for recording in (first, second)]
    assert sessions == ["session_0001.h5", "session_0003.h5"]
    assert last_recording(tmp_path) == replace(second, segments=second.segments[:1])
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
        assert old[0] not in [o.path for o in gc.get_objects() if type(o) is SegmentInfo]
    assert [path.exists() for path in old[:2]] == [False, True]
    assert not read_journal(writer.paths).lost.any
    # Of the old recording itself, blocks are missing now.
    assert read_journal(old[1:]).lost.blocks_missing > 0


def test_the_runs_of_the_present_recording_stay_with_the_time_around_them(tmp_path: Path) -> None:
    """A segment every 240 s, a bump in the sixteenth: 1200 s before and after it stay.

    So does the verdict of a person after the bus has become silent, in a segment without frames.
    """
    limits = RecorderConfig(segment_bytes=1.0, keep_bytes=1000.0, reserve_bytes=0.0)
    with JournalWriter(tmp_path, A, limits, QuickFile) as writer:
        for k in range(30):
            part = block(3_840_000 * k, 10)
            writer.append(part, HopLosses())
            if k == 15:
                writer.append_events([Event(int(part.t_ns[0]), "bump", 1.0, "baseline_bounce_1")])
            writer.maintain(240.0 * k)
        writer.append_events([Event(int(part.t_ns[0]), "reject")])
        for k in range(30, 40):
            writer.maintain(240.0 * k)
    contents = read_journal(writer.paths)
    assert not contents.lost.any
    assert {event.code for event in contents.events} == {"bump", "reject", "retention"}
    kept = numbers(contents.frames)[::10] // 3_840_000
    assert kept.tolist() == [*range(10, 21), *range(24, 30)]
