"""R6: file deleted, folder removed or replaced, disk read-only or unmounted under the recorder."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.folder import segments_in
from daq.journal.format import FILE_GONE
from daq.journal.reader import read_journal
from daq.journal.segment import SyncedFile
from daq.journal.writer import JournalWriter

from .crash_disk import QuickFile
from .crash_frames import HEAD, block, numbers

_FRAMES = 50


def _delete(folder: Path) -> None:
    segments_in(folder)[-1].unlink()


def _replace(folder: Path) -> None:
    path = segments_in(folder)[-1]
    path.unlink()
    path.write_bytes(b"another's")


def _remove(folder: Path) -> None:
    shutil.rmtree(folder)


def _rename(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))


TAKINGS: dict[str, Callable[[Path], object]] = {
    "file deleted": _delete,
    "file replaced": _replace,
    "folder removed": _remove,
    "folder renamed": _rename,
}


def take_away(folder: Path, how: Callable[[Path], object]) -> float:
    """Take file or folder away in mid-recording; return when it was reported, s.

    Raises
    ------
    AssertionError
        If it is not reported with the exact count, or what comes after is not recorded.
    """
    # What was recorded before falls into two segments: the first is whole, the second is taken.
    limits = RecorderConfig(segment_bytes=15_000.0, reserve_bytes=0.0)
    writer = JournalWriter(folder, HEAD, limits, QuickFile)
    for k in range(20):
        writer.append(block(k * _FRAMES, _FRAMES), HopLosses())
        writer.maintain(0.1 * k)
    assert len(writer.ledger.paths) == 2
    assert not writer.status.warning.startswith("journal")
    how(folder)
    k = 20
    while "lost" not in writer.status.warning:
        writer.append(block(k * _FRAMES, _FRAMES), HopLosses())
        writer.maintain(0.1 * k)
        k += 1
        assert k < 60, "not noticed"
    told_s = 0.1 * (k - 20)
    until = k + 20
    while k < until:
        writer.append(block(k * _FRAMES, _FRAMES), HopLosses())
        writer.maintain(0.1 * k)
        k += 1
    offered = until * _FRAMES
    recorded = writer.status.recorded_frames
    writer.close(ended=True)
    ours = [path for path in segments_in(folder) if path.read_bytes()[:1] == b"\xb5"]
    contents = read_journal(ours)
    read = numbers(contents.frames)
    assert len(read) == recorded
    assert read[-1] == offered - 1
    assert np.all(np.diff(read) > 0)
    gone = [event for event in contents.events if event.code == FILE_GONE]
    assert sum(event.value for event in gone) == offered - recorded == contents.lost.frames_dropped
    assert contents.lost.blocks_missing == 0
    return told_s


def read_only(folder: Path) -> None:
    """Refuse every write for three seconds: nothing is lost, and it is said.

    Raises
    ------
    AssertionError
        If a frame is lost or nothing is said.
    """
    refuse = [False]

    class ReadOnlyFile(QuickFile):
        def write(self, data: Any) -> int:
            _refuse()
            return super().write(data)

    def _refuse() -> None:
        if refuse[0]:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    def create(path: Path) -> SyncedFile:
        _refuse()
        return ReadOnlyFile(path)

    writer = JournalWriter(folder, HEAD, RecorderConfig(reserve_bytes=0.0), create)
    _refused(writer, lambda: refuse.__setitem__(0, True), lambda: refuse.__setitem__(0, False))


def _refused(writer: JournalWriter, begin: Callable[[], object], end: Callable[[], object]) -> None:
    for k in range(80):
        if k == 20:
            begin()
        if k == 50:
            assert "ead-only" in writer.status.failed
            assert writer.status.held_frames > 0
            assert writer.status.lag_s > 2.0
            end()
        writer.append(block(k * _FRAMES, _FRAMES), HopLosses())
        writer.maintain(0.1 * k)
    assert not writer.status.failed
    assert writer.status.recorded_frames == 80 * _FRAMES
    writer.close()
    contents = read_journal(writer.ledger.paths)
    assert np.array_equal(numbers(contents.frames), np.arange(80 * _FRAMES))
    assert not contents.lost.any, contents.lost.text


def unmounted(folder: Path) -> float | None:
    """Unmount the disk lazily in mid-recording; None where mounting is not allowed."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        return None
    return take_away(
        folder / "journal", lambda _: subprocess.run(["umount", "-l", str(folder)], check=True)
    )
