"""Segments that are no file of the recorder's, or hold what it never wrote."""

from __future__ import annotations

import logging
import os
import socket
import struct
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer

from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.journal.folder import last_recording, recordings_of, scan, segments_in
from daq.journal.format import BENCH_NAME, DBC_NAME, HEAD_RECORD, PROFILE, head_record
from daq.journal.reader import read_journal
from daq.journal.writer import JournalWriter

from ..crash_disk import QuickFile
from ..crash_frames import HEAD, block, numbers
from .test_journal import LIMITS

BLOCK_FRAMES = 100


def segment(folder: Path, blocks: int = 3) -> tuple[Path, list[int]]:
    """Write a segment as a killed writer leaves it.

    Returns its path and where its blocks begin and end.
    """
    folder.mkdir(exist_ok=True)
    writer = JournalWriter(folder, HEAD, LIMITS, QuickFile)
    path = segments_in(folder)[-1]
    edges = [path.stat().st_size]
    for k in range(blocks):
        writer.append(block(BLOCK_FRAMES * k, BLOCK_FRAMES), HopLosses())
        edges.append(path.stat().st_size)
    writer.close()
    path = segments_in(folder)[-1]  # it has another name now
    os.truncate(path, edges[-1])
    return path, edges


def test_a_hole_of_30_gb_behind_the_last_block_is_not_read(tmp_path: Path) -> None:
    path, (*_, end) = segment(tmp_path)
    os.truncate(path, end + 30_000_000_000)
    began_s = time.process_time()
    tracemalloc.start()
    contents, info = read_journal([path]), scan(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert time.process_time() - began_s < 1.0
    assert peak < 20_000_000
    assert numbers(contents.frames).tolist() == list(range(300))
    assert contents.lost.bytes_cut == 30_000_000_000
    assert f"last 30,000,000,000 bytes are a hole: zeros from byte {end}" in contents.lost.text
    assert info is not None
    assert (info.stop, info.frames, info.sealed) == (3, 300, False)


def test_nothing_behind_a_hole_is_believed(tmp_path: Path) -> None:
    path, (_, second, third, end) = segment(tmp_path)
    data = bytearray(path.read_bytes())
    data[second:third] = bytes(third - second)
    path.write_bytes(data)
    contents = read_journal([path])
    assert numbers(contents.frames).tolist() == list(range(100))
    assert contents.lost.bytes_cut == end - second
    assert "hole" in contents.lost.text


@pytest.mark.parametrize("kind", sorted({*range(16), 0x80 | 5, 255} - {5}))
def test_a_block_whose_kind_was_changed_costs_that_block_alone(tmp_path: Path, kind: int) -> None:
    path, (_, second, *_) = segment(tmp_path)
    data = bytearray(path.read_bytes())
    data[second] = kind
    path.write_bytes(data)
    contents = read_journal([path])
    assert numbers(contents.frames).tolist() == [*range(100), *range(200, 300)]
    assert (contents.lost.blocks_corrupt, contents.lost.bytes_cut) == (1, 0)
    assert "block after 1 is corrupt: its kind was changed" in contents.lost.text
    info = scan(path)
    assert info is not None
    assert (info.stop, info.frames) == (3, 200)


@pytest.mark.parametrize(
    ("size", "found"), [(67_108_864, "checksum does not"), (67_108_865, "torn")]
)
def test_a_record_has_64_mib_at_most(tmp_path: Path, size: int, found: str) -> None:
    path, (*_, end) = segment(tmp_path)
    with path.open("ab") as file:
        file.write(struct.pack("<BQ", 5, size))
    os.truncate(path, end + 9 + size)
    contents = read_journal([path])
    assert numbers(contents.frames).tolist() == list(range(300))
    assert found in contents.lost.text


def chunked(path: Path, compression: CompressionType, megabytes: int) -> None:
    """Write an MCAP file with the journal's head, and zeros in a chunk."""
    writer = Writer(str(path), compression=compression, chunk_size=1 << 40)
    writer.start(PROFILE, HEAD.software)
    channel = writer.register_channel("frames", "bumpbench-frames-1", 0)
    writer.add_metadata(HEAD_RECORD, head_record(HEAD, 1))
    for name, text in ((BENCH_NAME, HEAD.bench_text), (DBC_NAME, HEAD.dbc_text)):
        writer.add_attachment(0, 0, name, "text/plain", text.encode())
    writer.add_message(channel, 0, bytes(megabytes << 20), 0)
    writer.finish()


@pytest.mark.parametrize(
    ("compression", "megabytes"),
    [(CompressionType.NONE, 1), (CompressionType.LZ4, 64), (CompressionType.ZSTD, 64)],
)
def test_chunks_are_refused_and_never_unpacked(
    tmp_path: Path, compression: CompressionType, megabytes: int
) -> None:
    path = tmp_path / "journal_0001.mcap"
    chunked(path, compression, megabytes)
    tracemalloc.start()
    for read in (lambda: read_journal([path]), lambda: scan(path)):
        with pytest.raises(InputError, match="has MCAP chunks, which the recorder never writes"):
            read()
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


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
    "link to a segment": lambda path: path.symlink_to("journal_0001.mcap"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_no_file_is_refused_alone_and_a_loss_beside_a_segment(
    tmp_path: Path, name: str
) -> None:
    one, _ = segment(tmp_path)
    path = tmp_path / "journal_0002.mcap"
    STRANGE[name](path)
    with pytest.raises(InputError, match="is not a regular file") as caught:
        read_journal([path])
    assert str(caught.value).startswith(str(path))
    assert "move it away" in str(caught.value)
    (info,) = recordings_of(segments_in(tmp_path))
    assert info.segments == (one, path)
    contents = read_journal(info.segments)
    assert len(contents.frames) == 300
    assert any(
        note.startswith(f"{path.name}: is not a regular file") for note in contents.lost.notes
    )


def test_a_device_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="/dev/zero: is not a regular file"):
        read_journal([Path("/dev/zero")])


@pytest.mark.parametrize("name", STRANGE)
def test_a_recorder_goes_on_beside_what_is_no_file(
    tmp_path: Path, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    segment(tmp_path)
    STRANGE[name](tmp_path / "journal_0002.mcap")
    tail = last_recording(tmp_path)
    assert tail is not None
    assert tail.frames == 300
    with (
        caplog.at_level(logging.WARNING),
        JournalWriter(tmp_path, HEAD, LIMITS, QuickFile, tail) as writer,
    ):
        writer.append(block(300, 100), HopLosses())
    assert [path.name for path in writer.paths] == ["journal_0003.mcap"]
    (line,) = caplog.messages
    assert line.startswith(str(tmp_path / "journal_0002.mcap"))
    assert "move it away" in line
    assert numbers(read_journal([*tail.segments, *writer.paths]).frames).tolist() == list(
        range(400)
    )
