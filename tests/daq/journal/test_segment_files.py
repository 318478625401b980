"""Segment files: a disk that fails, files of other programs, files that are closed; their notes."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.journal.folder import built_revision, note_built, segments_in
from daq.journal.records import Kind, SegmentFile
from daq.journal.segment_reader import SegmentReader
from daq.journal.writer import JournalWriter

from ..crash_disk import QuickFile
from ..crash_frames import HEAD, block
from .test_journal import LIMITS


def _segment(folder: Path) -> Path:
    with JournalWriter(folder, HEAD, LIMITS, QuickFile) as writer:
        writer.append(block(0, 100), HopLosses())
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
