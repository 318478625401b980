"""R3: the Nth operation on the disk fails, once, in each way that disks fail."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.reader import last_recording, segments_in
from daq.journal.segment import SyncedFile
from daq.journal.writer import JournalWriter
from daq.runs import Event
from dbc.words import InputError

from .crash_frames import (
    BLOCK_FRAMES,
    HEAD,
    FailingDisk,
    LoggedDisk,
    QuickFile,
    SmallDisk,
    block,
    numbers,
    read_journal,
    read_numbers,
)

KINDS = ("eio", "enospc", "short", "sync")
_FRAMES = 20
_LATEST_ALARM_S = 1.0


def fail_once(folder: Path, kind: str, nth: int) -> bool:
    """Record while one operation fails; return whether it came to that."""
    disk = FailingDisk(kind, nth)
    limits = RecorderConfig(segment_bytes=6_000.0, reserve_bytes=0.0)
    writer = JournalWriter(folder, HEAD, limits, disk.create)
    n, k, noticed = 0, 0, bool(writer.status.failed)
    while not disk.failed or k < 15:
        if k > 400:
            break  # there were not so many operations
        writer.append(block(n, _FRAMES), HopLosses())
        n += _FRAMES
        writer.maintain(0.1 * k)
        noticed |= bool(writer.status.failed or writer.status.warning)
        assert noticed == disk.failed, f"{kind} {nth}: nothing is said"
        k += 1
    for _ in range(2):  # a second at the latest, and what was held is stored
        k += round(_LATEST_ALARM_S / 0.1)
        writer.maintain(0.1 * k)
    assert not writer.status.failed
    assert writer.status.recorded_frames == n
    writer.close()
    contents = read_journal(writer.paths)
    assert np.array_equal(numbers(contents.frames), np.arange(n)), f"{kind} {nth}"
    assert not contents.lost.any, contents.lost.text
    return disk.failed


def faults(folder: Path, operations: Iterable[int]) -> int:
    """Let each of these operations fail, in each way; return how many did."""
    failed = 0
    for nth in operations:
        for kind in KINDS:
            place = folder / f"{kind}{nth}"
            failed += fail_once(place, kind, nth)
            shutil.rmtree(place)
    return failed


# R2: what a crash may leave of the writes since the last barrier: some of them, some torn -------


SECTOR = 512
IMAGE_KINDS = ("prefix", "subset", "torn")
_COUNT = 40


@dataclass(frozen=True, slots=True)
class History:
    """All that was written to a disk; `acknowledged[k]` frames were so after the k-th operation."""

    log: Sequence[tuple[str, str, int, bytes]]
    acknowledged: Sequence[int]


def history(folder: Path, blocks: int, rng: np.random.Generator) -> History:
    """Record blocks, with changes of segment in between, and write everything down."""
    disk = LoggedDisk()
    acknowledged: list[int] = []
    writer = JournalWriter(folder, HEAD, RecorderConfig(segment_bytes=12_000.0), disk.create)
    n = 0
    for k in range(blocks):
        acknowledged += [n] * (len(disk.log) - len(acknowledged))
        count = int(rng.integers(1, 2 * _COUNT))
        writer.append(block(n, count), HopLosses())
        n += count
        # The last operation of `append` is the barrier: from then on it is acknowledged.
        acknowledged += [acknowledged[-1]] * (len(disk.log) - len(acknowledged) - 1) + [n]
        if k % 5 == 0:
            writer.append_events([Event(k, "note", float(n), "in between")])
        writer.maintain(0.1 * k)
    acknowledged += [n] * (len(disk.log) - len(acknowledged))
    writer.close()
    return History(tuple(disk.log[: len(acknowledged)]), tuple(acknowledged))


def leave(
    folder: Path, history: History, operations: int, kind: str, rng: np.random.Generator
) -> None:
    """Write into `folder` what a crash after so many operations may leave."""
    done = history.log[:operations]
    barrier = {name: k for k, (what, name, _, _) in enumerate(done) if what == "sync"}
    images: dict[str, bytearray] = {}
    pending: list[tuple[str, int, bytes]] = []
    for k, (what, name, offset, data) in enumerate(done):
        if what == "create" and (name in barrier or rng.random() < 0.5):
            images[name] = bytearray()
        elif what == "write" and k < barrier.get(name, -1):
            _apply(images[name], offset, data)
        elif what == "write" and name in images:
            pending.append((name, offset, data))
    if kind == "prefix":
        chosen = pending[: int(rng.integers(0, len(pending) + 1))]
    elif kind == "subset":
        chosen = [write for write in pending if rng.random() < 0.5]
    else:
        chosen = [s for w in pending for s in _sectors(*w) if rng.random() < 0.6]
    for name, offset, data in chosen:
        _apply(images[name], offset, data)
    folder.mkdir()
    for name, image in images.items():
        (folder / name).write_bytes(image)


def _sectors(name: str, offset: int, data: bytes) -> list[tuple[str, int, bytes]]:
    edges = [*range(offset + SECTOR - offset % SECTOR, offset + len(data), SECTOR)]
    edges = [offset, *edges, offset + len(data)]
    return [(name, a, data[a - offset : b - offset]) for a, b in pairwise(edges)]


def _apply(image: bytearray, offset: int, data: bytes) -> None:
    image.extend(bytes(max(0, offset + len(data) - len(image))))
    image[offset : offset + len(data)] = data


def images(folder: Path, count: int, seed: int = 2) -> int:
    """Check `count` images; return how many held more than was acknowledged.

    Each is read, then taken up again by a recorder, and read once more.
    """
    rng = np.random.default_rng(seed)
    beyond = 0
    past = history(folder / "history", 60, rng)
    for i in range(count):
        if i % 500 == 499:
            past = history(folder / f"history{i}", 60, rng)
        operations = int(rng.integers(0, len(past.log) + 1))
        acknowledged = past.acknowledged[operations - 1] if operations else 0
        place = folder / f"image{i}"
        leave(place, past, operations, IMAGE_KINDS[i % 3], rng)
        beyond += _check(place, acknowledged)
        shutil.rmtree(place)
    return beyond


def _check(place: Path, acknowledged: int) -> bool:
    try:
        read = len(_in_order(segments_in(place), acknowledged))
    except InputError:
        assert not acknowledged, "a journal with acknowledged frames cannot be read"
        read = 0
    tail = last_recording(place)
    head = replace(HEAD, wall_ns=HEAD.wall_ns + 5)
    with JournalWriter(place, head, RecorderConfig(), QuickFile, tail) as writer:
        writer.append(block(10**9, 7), HopLosses())
        again = read_numbers(segments_in(place))
    assert len(again) == read + 7, "taken up again, the recording lost frames"
    assert again[-7] == 10**9
    assert writer.status.recorded_frames == read + 7
    return read > acknowledged


def _in_order(segments: Sequence[Path], acknowledged: int) -> NDArray[np.int64]:
    read = read_numbers(segments)
    assert np.array_equal(read, np.arange(len(read))), "frames are missing, doubled or in disorder"
    assert len(read) >= acknowledged, f"{acknowledged - len(read)} acknowledged frames lost"
    return read


# R4: a disk that runs full, stays so beyond what memory holds, and gets room again --------------


BLOCK_S = 0.1
_BALLAST_BYTES = 100_000_000


@dataclass(frozen=True, slots=True)
class Disk:
    """A small disk: what a writer needs of it, and how to give room back."""

    folder: Path
    create: Callable[[Path], SyncedFile]
    usage: Callable[[Path], tuple[int, int, int]]
    give_back: Callable[[], None]
    kind: str


@dataclass(frozen=True, slots=True)
class Full:
    """One disk that ran full: frames dropped, and times on the recorder's clock."""

    kind: str
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

    return Disk(folder, disk.create, disk.usage, give_back, "files of our own")


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
        yield Disk(folder / "journal", SyncedFile, shutil.disk_usage, ballast.unlink, "tmpfs")
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def run_full(disk: Disk, reserve_bytes: float, full_s: float) -> Full:
    """Record on a disk until it is full, `full_s` longer, and on when it has room again."""
    limits = RecorderConfig(segment_bytes=2e6, reserve_bytes=reserve_bytes)
    writer = JournalWriter(disk.folder, HEAD, limits, disk.create, disk_usage=disk.usage)
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
        read = numbers(read_journal(writer.paths).frames)
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
    contents = read_journal(writer.paths)
    read = numbers(contents.frames)
    assert len(read) == writer.status.recorded_frames == clock.offered - dropped
    assert np.all(np.diff(read) > 0), "frames are doubled or in disorder"
    assert contents.hops.between(0, 2**62).queue_dropped == dropped
    assert contents.lost.any == (dropped > 0)
    return Full(disk.kind, dropped, alarm_s, resumed_s, largest - before)


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


# R6: file deleted, folder removed or replaced, disk read-only or unmounted under the recorder ---


_TAKEN_FRAMES = 50


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
    """Take file or folder away in mid-recording; return when it was reported, s."""
    # What was recorded before falls into two segments: the first is whole, the second is taken.
    limits = RecorderConfig(segment_bytes=15_000.0, reserve_bytes=0.0)
    writer = JournalWriter(folder, HEAD, limits, QuickFile)
    for k in range(20):
        writer.append(block(k * _TAKEN_FRAMES, _TAKEN_FRAMES), HopLosses())
        writer.maintain(0.1 * k)
    assert len(writer.paths) == 2
    assert not writer.status.warning.startswith("journal")
    how(folder)
    k = 20
    while "lost" not in writer.status.warning:
        writer.append(block(k * _TAKEN_FRAMES, _TAKEN_FRAMES), HopLosses())
        writer.maintain(0.1 * k)
        k += 1
        assert k < 60, "not noticed"
    told_s = 0.1 * (k - 20)
    until = k + 20
    while k < until:
        writer.append(block(k * _TAKEN_FRAMES, _TAKEN_FRAMES), HopLosses())
        writer.maintain(0.1 * k)
        k += 1
    offered = until * _TAKEN_FRAMES
    recorded = writer.status.recorded_frames
    writer.close(ended=True)
    ours = [path for path in segments_in(folder) if path.read_bytes()[:1] == b"\xb5"]
    contents = read_journal(ours)
    read = numbers(contents.frames)
    assert len(read) == recorded
    assert read[-1] == offered - 1
    assert np.all(np.diff(read) > 0)
    assert contents.hops.between(0, 2**62).queue_dropped == offered - recorded
    assert contents.lost.blocks_missing > 0
    return told_s


def read_only_disk(folder: Path) -> Disk:
    """Return a disk that refuses every write from the 40th operation on."""
    operations = itertools.count()
    room = threading.Event()

    def refuse() -> None:
        if next(operations) >= 40 and not room.is_set():
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    class ReadOnlyFile(QuickFile):
        def write(self, data: Any) -> int:
            refuse()
            return super().write(data)

    def create(path: Path) -> SyncedFile:
        refuse()
        return ReadOnlyFile(path)

    return Disk(folder, create, shutil.disk_usage, room.set, "read-only")


def unmounted(folder: Path) -> float | None:
    """Unmount the disk lazily in mid-recording; None where mounting is not allowed."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        return None
    return take_away(
        folder / "journal", lambda _: subprocess.run(["umount", "-l", str(folder)], check=True)
    )
