"""Journals are read back whole, and damaged ones block by block with an exact account."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.journal.format import HEADER, MAGIC, Gap, SegmentFile, gap_event
from daq.journal.reader import (
    HopCounts,
    JournalLoss,
    JournalReader,
    last_recording,
    read_journal,
    read_windows,
    recordings,
    recordings_of,
    scan,
    segments_in,
)
from daq.journal.writer import JournalWriter
from daq.runs import Event
from dbc.frames import FrameBatch

from ..crash_frames import HEAD, START_NS, QuickFile, block, numbers

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
    path = segments_in(folder)[-1]  # it has another name now
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
    contents, pieces = read_windows([path], windows)
    assert [numbers(piece).tolist() for piece in pieces] == [list(range(90, 310)), [300], []]
    assert len(contents.frames) == 0


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
    for size in [*range(before, before + 2 * HEADER.size), *range(before, end, 31), end - 1]:
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
    for at in [*range(20), *rng.integers(0, len(whole), 300).tolist()]:
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
        assert (contents.lost.blocks_corrupt, contents.lost.blocks_missing) == (len(gone), 0)
        info = scan(path)
        assert info is not None
        assert info.summary.stop == 12
        harmless += not gone
    assert 0 < harmless < 200


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
    lost = contents.lost
    assert lost.blocks_corrupt + lost.blocks_missing == gone
    assert (path.name in lost.text) == bool(gone)


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
    with pytest.raises(InputError, match=r"every copy of its bench.toml"):
        read_journal([first])
    with pytest.raises(InputError, match=r"every copy of its bench.toml"):
        recordings_of([first])
    # Beside another recording, all of it is a loss.
    with JournalWriter(tmp_path / "b", replace(HEAD, recording="b" * 32), LIMITS) as writer:
        writer.append(block(0, 7), HopLosses())
    (info,) = recordings_of([first, *writer.paths])
    lost = read_journal(info.segments).lost
    assert (lost.bytes_cut, info.frames) == (len(bytes(second) + data[second:end]), 7)


def test_a_hole_costs_the_blocks_in_it_alone(tmp_path: Path) -> None:
    path, edges = segment(tmp_path, 20)
    data = bytearray(path.read_bytes())
    data[edges[3] + 5 : edges[6] - 7] = bytes(edges[6] - edges[3] - 12)
    path.write_bytes(data)
    contents = read_journal([path])
    assert numbers(contents.frames).tolist() == [*range(300), *range(600, 2000)]
    assert (contents.lost.blocks_corrupt, contents.lost.blocks_missing) == (1, 2)
    assert f"from byte {edges[3]} are damaged" in contents.lost.text


def test_blocks_before_a_sound_end_are_missed(tmp_path: Path) -> None:
    path, edges = segment(tmp_path, 5, killed=False)
    data = path.read_bytes()
    path.write_bytes(data[: edges[3]] + data[edges[5] :])
    contents = read_journal([path])
    assert numbers(contents.frames).tolist() == list(range(300))
    assert contents.lost.blocks_missing == 2


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
    for stop in range(edges[-1] + HEADER.size, len(whole), 7):
        path.write_bytes(whole[:stop])
        assert not read_journal([path]).lost.any, stop
        info = scan(path)
        assert info is not None
        assert (bool(info.blocks), info.summary.frames) == (True, 300)


def test_blocks_between_two_segments_are_missing_but_for_known_gaps(tmp_path: Path) -> None:
    def written(*blocks: int, gap: Gap | None = None) -> JournalLoss:
        for path in tmp_path.iterdir():
            path.unlink()
        with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile) as writer:
            for number in range(5):
                writer.append(block(number, 1), HopLosses())
                writer.cut()
            if gap:
                writer.append_events([gap_event("disk_gap", 0, gap)])
        kept = [path for k, path in enumerate(writer.paths) if k in blocks or k == 5]
        return read_journal(kept).lost

    mine = HEAD.recording
    assert written(0, 1, 2, 3, 4).blocks_missing == 0
    assert written(0, 4).blocks_missing == 3
    known = written(0, 4, gap=Gap(mine, 1, 3, 5))
    assert (known.blocks_missing, known.frames_dropped) == (1, 5)
    assert written(0, 4, gap=Gap(mine, 1, 4, 5)).blocks_missing == 0
    assert written(0, 4, gap=Gap("c" * 32, 1, 4, 5)).blocks_missing == 3


def test_a_disk_that_fails_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, _ = segment(tmp_path)
    really = os.read

    def fail(fd: int, size: int) -> bytes:
        if os.lseek(fd, 0, os.SEEK_CUR) >= path.stat().st_size:
            raise OSError(5, "Input/output error")
        return really(fd, min(size, 1000))

    with SegmentFile(path) as file:
        monkeypatch.setattr("daq.journal.format.os.read", fail)
        file.size += 100
        *_, damage = file.blocks()
        assert file.fault == "cannot be read (Input/output error)"
        assert damage[1:3] == (100, True)


def test_the_first_twenty_notes_are_given_and_the_others_counted() -> None:
    notes = tuple(f"n{k}" for k in range(21))
    assert JournalLoss(notes=notes[:20]).text == "; ".join(notes[:20])
    assert JournalLoss(notes=notes).text == "; ".join(notes[:20]) + "; 1 more note"


# Files that are no segment ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"not a journal at all", "is not a journal"),
        (bytes(100), "is not a journal"),
        (b"", "holds no recording"),
        (MAGIC + bytes(100), "holds no recording"),
        (b"\x89MCAP0\r\n" + bytes(100), "this journal was written by Bumpbench 0.1.*that release"),
    ],
)
def test_a_file_that_is_no_journal_is_refused_alone_and_a_loss_beside_a_segment(
    tmp_path: Path, content: bytes, says: str
) -> None:
    path, _ = segment(tmp_path)
    other = tmp_path / "journal_0002.bbj"
    other.write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_journal([other])
    (info,) = recordings_of(segments_in(tmp_path))
    assert info.segments == (path, other)
    contents = read_journal(info.segments)
    assert len(contents.frames) == 300
    assert contents.lost.bytes_cut == len(content)
    assert [one.segments for one in recordings(tmp_path)] == [(path,)]


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
        JournalReader([*one.paths, *two.paths])


def _bind(path: Path) -> None:
    place = os.open(path.parent, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(f"/proc/self/fd/{place}/{path.name}")  # a socket's path has 107 bytes at most
    os.close(place)


STRANGE: dict[str, Callable[[Path], object]] = {
    "FIFO": os.mkfifo,
    "directory": os.mkdir,
    "socket": _bind,
    "link to nothing": lambda path: path.symlink_to("nothing"),
    "link to a segment": lambda path: path.symlink_to("journal_0001.bbj"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_no_file_is_refused_and_a_recorder_goes_on_beside_it(
    tmp_path: Path, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    one, _ = segment(tmp_path)
    path = tmp_path / "journal_0002.bbj"
    STRANGE[name](path)
    with pytest.raises(InputError, match=r"is not a regular file.*move it away"):
        read_journal([path])
    (info,) = recordings_of(segments_in(tmp_path))
    assert info.segments == (one, path)
    contents = read_journal(info.segments)
    assert len(contents.frames) == 300
    assert f"{path.name}: is not a regular file" in contents.lost.text
    tail = last_recording(tmp_path)
    assert tail is not None
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, tail) as writer:
        writer.append(block(300, 100), HopLosses())
    assert [each.name for each in writer.paths] == ["journal_0003.bbj"]
    (line,) = caplog.messages
    assert line.startswith(str(path))
    assert "move it away" in line
    assert len(read_journal([*tail.segments, *writer.paths]).frames) == 400
