"""R4: a disk that runs full, stays so beyond what memory holds, and gets room again."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.reader import read_journal
from daq.journal.segment import Room, SyncedFile, room_on
from daq.journal.writer import JournalWriter

from .crash_disk import SmallDisk
from .crash_frames import BLOCK_FRAMES, HEAD, block, numbers

BLOCK_S = 0.1
_BALLAST_BYTES = 100_000_000


@dataclass(frozen=True, slots=True)
class Disk:
    """A small disk: what a writer needs of it, and how to give room back."""

    folder: Path
    create: Callable[[Path], SyncedFile]
    room: Callable[[Path], Room]
    give_back: Callable[[], None]
    kind: str


@dataclass(frozen=True, slots=True)
class Full:
    """One disk that ran full: frames by what became of them, and times on the recorder's clock."""

    kind: str
    offered: int
    recorded: int
    dropped: int
    alarm_s: float
    resumed_s: float
    grown_bytes: int


def small_disk(folder: Path, size: int) -> Disk:
    """Return a disk of our own making with room for `size` bytes."""
    disk = SmallDisk(size)
    folder.mkdir()

    def give_back() -> None:
        disk.free += _BALLAST_BYTES

    return Disk(folder, disk.create, disk.room, give_back, "files of our own")


@contextmanager
def mounted_disk(folder: Path, size: int) -> Iterator[Disk | None]:
    """Mount a disk with room for `size` bytes; None where that is not allowed."""
    folder.mkdir()
    options = f"size={(size + _BALLAST_BYTES + 4095) // 4096 * 4096}"
    mount = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        yield None
        return
    try:
        ballast = folder / "ballast"
        with ballast.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, _BALLAST_BYTES)
        yield Disk(folder / "journal", SyncedFile, room_on, ballast.unlink, "tmpfs")
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def run_full(disk: Disk, reserve_bytes: float, full_s: float) -> Full:
    """Record on a disk until it is full, `full_s` longer, and on when it has room again.

    Raises
    ------
    AssertionError
        If a recorded frame cannot be read, the gap is not reported exactly, or nothing is said.
    """
    limits = RecorderConfig(segment_bytes=2e6, reserve_bytes=reserve_bytes)
    writer = JournalWriter(disk.folder, HEAD, limits, disk.create, room=disk.room)
    clock = _Clock(writer)
    before = _resident_bytes()
    while not writer.status.held_frames:
        clock.turn()
    full_at_s = clock.now_s
    while not writer.status.failed:
        clock.turn()
    alarm_s = clock.now_s - full_at_s
    largest = before
    while clock.now_s < full_at_s + full_s:
        clock.turn()
        largest = max(largest, _resident_bytes()) if clock.block % 50 == 0 else largest
    recorded, dropped = writer.status.recorded_frames, writer.status.dropped_frames
    if recorded:
        read = numbers(read_journal(writer.ledger.paths).frames)
        assert np.array_equal(read[:recorded], np.arange(recorded)), "acknowledged frames lost"
    disk.give_back()
    given_s = clock.now_s
    while writer.status.held_frames or writer.status.failed:
        clock.turn()
        assert clock.now_s < given_s + 10.0, "does not take up again"
    resumed_s = clock.now_s - given_s
    for _ in range(20):
        clock.turn()
    dropped = writer.status.dropped_frames
    writer.close(ended=True)
    contents = read_journal(writer.ledger.paths)
    read = numbers(contents.frames)
    assert len(read) == writer.status.recorded_frames == clock.offered - dropped
    assert np.all(np.diff(read) > 0), "frames are doubled or in disorder"
    assert contents.lost.frames_dropped == dropped, contents.lost.text
    assert contents.lost.blocks_missing == contents.lost.blocks_corrupt == 0
    assert contents.hops.between(0, 2**62).queue_dropped == dropped
    assert contents.lost.any == (dropped > 0)
    return Full(disk.kind, clock.offered, len(read), dropped, alarm_s, resumed_s, largest - before)


class _Clock:
    """Offers a block each tenth of a second of the recorder's clock, as fast as can be."""

    def __init__(self, writer: JournalWriter) -> None:
        self._writer = writer
        self.block = 0
        self.now_s = 0.0
        self.offered = 0

    def turn(self) -> None:
        self._writer.append(block(self.offered, BLOCK_FRAMES), HopLosses())
        self.offered += BLOCK_FRAMES
        self.block += 1
        self.now_s = self.block * BLOCK_S
        self._writer.maintain(self.now_s)


def _resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def disks_full(folder: Path, sizes: int, full_s: float) -> list[Full]:
    """Run disks of so many sizes full, with and without a reserve."""
    results = []
    for i in range(sizes):
        size = 150_000 + i * 393_216 + 977 * i * i
        reserve = 100_000.0 if i % 2 else 0.0
        with mounted_disk(folder / f"mounted{i}", size) as mounted:
            if mounted is not None:
                results.append(run_full(mounted, reserve, full_s))
        if mounted is None or i < 2:
            results.append(run_full(small_disk(folder / f"small{i}", size), reserve, full_s))
    return results
