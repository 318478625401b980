"""The journal: written, crashed, cut and read back."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.stream_reader import StreamReader

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.journal.folder import built_revision, note_built, segments_in
from daq.journal.format import JournalHead, check_frames, pack_events, pack_frames, unpack_events
from daq.journal.reader import JournalReader, read_journal
from daq.journal.records import Kind, SegmentFile
from daq.journal.segment import SyncedFile
from daq.journal.segment_reader import SegmentReader
from daq.journal.writer import JournalWriter
from daq.runs import Event
from dbc.frames import FrameBatch

from ..crash_derive import journal_of_runs, kill_derive
from ..crash_disk import QuickFile
from ..crash_faults import KINDS, faults
from ..crash_frames import HEAD as HEAD_OF_CRASH_FRAMES
from ..crash_frames import block as block_of_crash_frames
from ..crash_full import mounted_disk, run_full, small_disk
from ..crash_images import images
from ..crash_taken import TAKINGS, read_only, take_away

HEAD = JournalHead("[bus]\n# µ\n", 'VERSION ""\n', "bumpbench test", 1_800_000_000_000_000_000, 77)

LIMITS = RecorderConfig(reserve_bytes=0.0)


def block(start: int, count: int = 2, width: int = 8) -> FrameBatch:
    """Frames that carry their number in identifier and payload."""
    n = np.arange(start, start + count)
    data = np.zeros((count, width), np.uint8)
    data[:, :8] = n.astype(">u8").view(np.uint8).reshape(count, 8)
    t_ns, can_id, flags = 10**18 + n * 1_000_000, n % 2048, n % 128
    return FrameBatch(
        t_ns,
        can_id.astype(np.uint32),
        flags.astype(np.uint16),
        (n % 3).astype(np.uint8),
        (n % 9).astype(np.uint8),
        data,
    )


def assert_same(a: FrameBatch, b: FrameBatch) -> None:
    for field in fields(FrameBatch):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


def write(folder: Path, blocks: int) -> tuple[Path, int]:
    """Write blocks of two frames as a writer that is killed: return file, and size before last."""
    journal = JournalWriter(folder, HEAD, LIMITS)
    for k in range(blocks - 1):
        journal.append(block(2 * k), HopLosses())
    size = journal.paths[0].stat().st_size
    journal.append(block(2 * blocks - 2), HopLosses())
    as_killed = journal.paths[0].read_bytes()
    journal.close()
    journal.paths[0].write_bytes(as_killed)
    return journal.paths[0], size


def test_what_was_written_is_read(tmp_path: Path) -> None:
    events = (Event(3, "bump", 4.5, "baseline_bounce_1"), Event(9, "run_end", 0.1, "µ\n\0"))
    with JournalWriter(tmp_path / "new" / "folder", HEAD, LIMITS) as journal:
        journal.append(block(0), HopLosses(1, 2, 3, 4))
        journal.append_events(events[:1])
        journal.append(block(2, 3, 64), HopLosses(5, 6, 7, 8))
        journal.append_events(events[1:])
        journal.append(FrameBatch.empty(), HopLosses(5, 6, 7, 9))

    contents = read_journal(journal.paths)

    assert contents.head == HEAD
    head = contents.head
    assert (head.bench_text, head.dbc_text) == (HEAD.bench_text, HEAD.dbc_text)
    assert_same(contents.frames, FrameBatch.concatenate([block(0), block(2, 3, 64)]))
    assert contents.events == events
    assert contents.lost.text == ""
    assert not contents.lost.any
    assert contents.hops.between(0, 2 * 10**18) == HopLosses(5, 6, 7, 9)


def test_losses_belong_to_the_blocks_they_were_counted_with(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS) as journal:
        for k, dropped in enumerate([0, 0, 5, 5, 7]):
            journal.append(block(10 * k, 10), HopLosses(queue_dropped=dropped))
    hops = read_journal(journal.paths).hops
    at_ns = 10**18 + np.arange(50) * 1_000_000

    def dropped_between(first: int, last: int) -> int:
        return hops.between(int(at_ns[first]), int(at_ns[last])).queue_dropped

    assert dropped_between(0, 19) == 0
    assert dropped_between(12, 22) == 5
    assert dropped_between(29, 30) == 5
    assert dropped_between(30, 39) == 0
    assert dropped_between(30, 49) == 2
    assert hops.between(0, 10**19).queue_dropped == 7
    assert hops.between(10**19, 10**19 + 1).queue_dropped == 0


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_one_changed_byte_of_a_block_is_never_accepted(data: st.DataObject) -> None:
    message = data.draw(
        st.sampled_from(
            [
                pack_frames(7, block(0, 5), HopLosses(1, 2, 3, 4)),
                pack_events(8, [Event(3, "bump", 4.5, "baseline_bounce_1")]),
            ]
        )
    )
    at = data.draw(st.integers(0, len(message) - 1))
    changed = bytearray(message)
    changed[at] ^= data.draw(st.integers(1, 255))
    unpack: Callable[[bytes], object] = unpack_events if message[:1] == b"{" else check_frames
    try:
        read = unpack(bytes(changed))
    except ValueError:
        return
    assert read == unpack(message)  # white space of JSON, a letter of \u00e4
    assert unpack is unpack_events


def test_a_tail_torn_at_any_byte_costs_that_block_alone_and_is_accounted_for(
    tmp_path: Path,
) -> None:
    path, before = write(tmp_path, 3)
    whole = path.read_bytes()
    kept = FrameBatch.concatenate([block(0), block(2)])
    for size in range(before, len(whole)):
        path.write_bytes(whole[:size])
        contents = read_journal([path])
        assert_same(contents.frames, kept)
        assert contents.lost.bytes_cut == size - before
        assert contents.lost.segments_unclosed == 1
        assert contents.lost.any == (size > before)
        assert path.name in contents.lost.text


def test_a_byte_changed_anywhere_in_the_last_block_is_noticed_or_harmless(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS) as journal:
        journal.append(block(0), HopLosses())
        before = journal.paths[0].stat().st_size
        journal.append(block(2), HopLosses())
        after = journal.paths[0].stat().st_size
    whole = journal.paths[0].read_bytes()
    all_frames = FrameBatch.concatenate([block(0), block(2)])
    for at in range(before, after):
        for bits in (1, 0x80, 0xFF):
            changed = bytearray(whole)
            changed[at] ^= bits
            journal.paths[0].write_bytes(changed)
            contents = read_journal(journal.paths)
            if contents.lost.any:
                assert_same(contents.frames, block(0))
            else:
                assert_same(contents.frames, all_frames)
                # MCAP's own channel, sequence number and times, which we do not use
                assert before + 9 <= at < before + 9 + 22


def test_a_journal_cut_within_its_beginning_holds_nothing_and_says_so(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS) as journal:
        (path,) = tmp_path.iterdir()
        whole = path.read_bytes()
        journal.append(FrameBatch.empty(), HopLosses())
    for size in range(len(whole) // 2):  # all of it is there twice
        journal.paths[0].write_bytes(whole[:size])
        with pytest.raises(InputError, match="holds no recording"):
            read_journal(journal.paths)


class FailingFile(SyncedFile):
    """A file on a disk with room for so many writes; the last of them is cut short."""

    def __init__(self, path: Path, writes: int, cut: int) -> None:
        super().__init__(path)
        self.writes = writes
        self.cut = cut

    def write(self, data: Any) -> int:
        self.writes -= 1
        if self.writes < 0:
            raise OSError(28, "No space left on device")
        if self.writes == 0 and self.cut:
            return super().write(data[: self.cut])
        return super().write(data)


def test_blocks_lost_between_others_are_counted(tmp_path: Path) -> None:
    rooms = iter([12, 12, 100])
    with JournalWriter(
        tmp_path, HEAD, LIMITS, lambda path: FailingFile(path, next(rooms), 0)
    ) as journal:
        for k in range(20):
            journal.append(block(2 * k), HopLosses())
    first, second, third = journal.paths
    missing = len(read_journal([second]).frames) // 2
    contents = read_journal([third, first])
    assert missing > 0
    assert contents.lost.blocks_missing == missing
    assert contents.lost.any
    assert len(contents.frames) == 2 * (20 - missing)


@pytest.mark.parametrize("cut", [0, 1, 60])
@pytest.mark.parametrize("writes", range(12, 19))
def test_a_write_that_fails_starts_a_new_file_and_loses_nothing(
    tmp_path: Path, writes: int, cut: int
) -> None:
    rooms = iter([writes, 1000])
    made: list[FailingFile] = []

    def create(path: Path) -> FailingFile:
        made.append(FailingFile(path, next(rooms), cut))
        return made[-1]

    with JournalWriter(tmp_path, HEAD, LIMITS, create) as journal:
        for k in range(10):
            journal.append(block(2 * k), HopLosses())

    assert len(journal.paths) == 2
    assert all(file.closed for file in made)
    contents = read_journal(journal.paths[::-1])
    assert_same(contents.frames, block(0, 20))
    assert contents.lost.blocks_missing == contents.lost.blocks_corrupt == 0
    assert contents.lost.segments_unclosed == 1


def test_a_sync_that_fails_starts_a_new_file_and_stores_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS) as journal:
        journal.append(block(0), HopLosses())
        really, calls = os.fdatasync, [0]

        def sync(fd: int) -> None:
            calls[0] += 1
            if calls[0] == 1:
                raise OSError(5, "Input/output error")
            really(fd)

        monkeypatch.setattr(os, "fdatasync", sync)
        journal.append(block(2), HopLosses())
        journal.append(block(4), HopLosses())
    assert len(journal.paths) == 2
    contents = read_journal(journal.paths)
    assert_same(contents.frames, block(0, 6))
    assert not contents.lost.any


def test_segments_are_numbered_on_and_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "journal_0007.mcap").write_bytes(b"precious")
    (tmp_path / "journal_old.mcap").write_bytes(b"")
    with JournalWriter(tmp_path, HEAD, LIMITS) as journal:
        journal.append(block(0), HopLosses())
        assert [path.name for path in journal.paths] == ["open_0008.mcap"]
    assert [path.name for path in journal.paths] == ["journal_0008.mcap"]
    assert (tmp_path / "journal_0007.mcap").read_bytes() == b"precious"


def test_files_of_two_recordings_are_not_mixed(tmp_path: Path) -> None:
    with (
        JournalWriter(tmp_path, HEAD, LIMITS) as one,
        JournalWriter(tmp_path, replace(HEAD, monotonic_ns=78), LIMITS) as two,
    ):
        one.append(block(0), HopLosses())
        two.append(block(0), HopLosses())
    with pytest.raises(InputError, match="another recording"):
        JournalReader([*one.paths, *two.paths])


@pytest.mark.parametrize("content", [b"not a journal at all", b"\x89HDF\r\n\x1a\n" + bytes(99)])
def test_a_file_that_is_no_journal_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is not a journal"):
        read_journal([path])


def test_a_missing_file_and_no_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_journal([tmp_path / "journal_0001.mcap"])
    with pytest.raises(InputError, match="holds no recording"):
        read_journal([])


def test_any_mcap_tool_can_read_what_the_journal_writes(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS) as journal:
        journal.append(block(0), HopLosses())
        journal.append_events([Event(1, "bump")])
    with journal.paths[0].open("rb") as file:
        kinds = [type(r).__name__ for r in StreamReader(file, validate_crcs=True).records]
    assert kinds.count("Message") == 2
    assert kinds.count("Attachment") == 4  # each text twice
    assert kinds[-1] == "Footer"


# The campaigns of `make crash`, short -------------------------------------------------------------


def test_a_crash_image_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    assert images(tmp_path, 300, seed=12) > 0


def test_an_operation_that_fails_loses_nothing_and_is_reported(tmp_path: Path) -> None:
    operations = [*range(1, 24, 2), *range(30, 201, 34)]
    assert faults(tmp_path, operations) == len(KINDS) * len(operations)


@pytest.mark.parametrize("reserve", [0.0, 100_000.0])
def test_a_full_disk_costs_only_what_it_says(tmp_path: Path, reserve: float) -> None:
    full = run_full(small_disk(tmp_path / "full", 1_234_567), reserve, full_s=90.0)
    assert full.dropped > 0
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
    read_only(tmp_path / "journal")


def test_a_derivation_that_is_killed_leaves_a_whole_file_or_none(tmp_path: Path) -> None:
    segments = journal_of_runs(tmp_path / "journal", 100_000)
    assert len(segments) > 1
    done = kill_derive(tmp_path, segments, 2)
    assert done.writing >= 1
    assert done.absent >= 1, "what is being written has not its final name"


# Segment files: a disk that fails, files of other programs, files that are closed; their notes ----


def _segment(folder: Path) -> Path:
    with JournalWriter(folder, HEAD_OF_CRASH_FRAMES, LIMITS, QuickFile) as writer:
        writer.append(block_of_crash_frames(0, 100), HopLosses())
    return segments_in(folder)[-1]


def _open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def _of_another_program(path: Path) -> Path:
    """Write the head of an MCAP file with the profile of ROS 2."""
    texts = b"".join(struct.pack("<I", len(text)) + text for text in (b"ros2", b"other"))
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 0x01, len(texts)) + texts)
    return path


def test_the_records_have_the_kinds_of_the_mcap_specification(tmp_path: Path) -> None:
    with SegmentFile(_segment(tmp_path)) as file:
        kinds = [record.kind for record in file.records()]
    assert kinds[0] == 0x01  # header
    assert 0x04 in kinds  # channel
    assert 0x05 in kinds  # message
    assert (Kind.HEADER, Kind.CHUNK, Kind.ATTACHMENT) == (0x01, 0x06, 0x09)
    assert (Kind.METADATA, Kind.DATA_END) == (0x0C, 0x0F)


def test_a_disk_that_fails_ends_the_records_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> bytes:
        raise OSError(5, "Input/output error")

    with SegmentFile(_segment(tmp_path)) as file:
        monkeypatch.setattr("daq.journal.records.os.lseek", fail)
        assert list(file.records()) == []
        assert file.why_stopped == "cannot be read (Input/output error)"


def test_a_file_is_closed_behind_its_block(tmp_path: Path) -> None:
    path = _segment(tmp_path)
    before = _open_files()
    with SegmentFile(path):
        assert _open_files() == before + 1
    assert _open_files() == before


def test_a_file_of_another_program_is_refused_and_closed(tmp_path: Path) -> None:
    path = _of_another_program(tmp_path / "other.mcap")
    before = _open_files()
    with pytest.raises(InputError, match="MCAP file of another program"):
        SegmentReader(path)
    assert _open_files() == before


def test_a_recording_is_not_built_once_its_session_file_is_gone(tmp_path: Path) -> None:
    session = tmp_path / "session_0001.h5"
    session.write_bytes(b"12345")
    note_built(tmp_path, "open", 0, session)
    assert built_revision(tmp_path, "open") == 0
    session.unlink()
    assert built_revision(tmp_path, "open") is None
