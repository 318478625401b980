"""Frames that carry their number, so that none can be lost, doubled or altered unseen."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.reader import HopCounts, JournalLoss, read_windows, recording_of
from daq.journal.segment import JournalHead, SyncedFile
from daq.journal.writer import JournalWriter
from daq.runs import Event
from daq.session.build import derive
from dbc.frames import FrameBatch

from .small_campaign import LABELS, bumps, small_bench, small_codec
from .small_campaign import START_NS as BUMPS_START_NS

START_NS = 10**18
RATE_HZ = 16_000
"""Four full buses of 500 kbit/s, 8-byte frames."""
BLOCK_FRAMES = RATE_HZ // 10

HEAD = JournalHead(
    "[bus]\n", 'VERSION ""\n', "crash", START_NS, 1, "0123456789abcdef0123456789abcdef"
)


def numbered(n: NDArray[np.int64]) -> FrameBatch:
    """Return the frames of these numbers: every column and the payload follow from the number."""
    mixed = n.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return FrameBatch(
        START_NS + n * 62_500,
        (mixed % np.uint64(2048)).astype(np.uint32),
        (n % 128).astype(np.uint16),
        (n % 4).astype(np.uint8),
        np.full(len(n), 8, np.uint8),
        n.astype(">u8").view(np.uint8).reshape(-1, 8),
    )


def block(first: int, count: int) -> FrameBatch:
    """Return `count` frames from number `first` on."""
    return numbered(np.arange(first, first + count, dtype=np.int64))


def numbers(frames: FrameBatch) -> NDArray[np.int64]:
    """Return the numbers of frames read back."""
    n = frames.data[:, :8].copy().view(">u8").reshape(-1).astype(np.int64)
    true = numbered(n)
    for name in ("t_ns", "can_id", "flags", "bus", "length", "data"):
        same = np.array_equal(getattr(frames, name), getattr(true, name))
        assert same, f"{name} is not what was written"
    return n


@dataclass(frozen=True, slots=True)
class JournalContents:
    """All that is in the segments of one recording."""

    head: JournalHead
    frames: FrameBatch
    events: tuple[Event, ...]
    hops: HopCounts
    lost: JournalLoss


def read_journal(paths: Sequence[Path]) -> JournalContents:
    """Read all segments of a recording, in any order; raise InputError as `recording_of`."""
    recording = recording_of(paths)
    contents = read_windows(recording, [(-(2**63), 2**63 - 1)])
    (frames,) = contents.windows
    return JournalContents(recording.head, frames, recording.events, contents.hops, contents.lost)


def read_numbers(segments: Sequence[Path]) -> NDArray[np.int64]:
    """Return the numbers of all frames in segments, after the check of each bit."""
    return numbers(read_journal(segments).frames)


# Files that misbehave as disks do: they fail at a chosen operation, run full, or keep a log -----


class QuickFile(SyncedFile):
    """A file that takes the kernel's word for having written: kills and power are not at stake."""

    def sync(self) -> None:
        """Do nothing."""


@dataclass
class FailingDisk:
    """A disk whose operation number `nth` of one kind fails, once."""

    kind: str
    """`eio` or `enospc` (any operation), `short` (a write takes half, then there is no room),
    `sync` (fdatasync fails; the data may be there or not)."""
    nth: int
    """Counted from 1 among the operations that can fail so."""
    count: int = 0
    failed: bool = False

    def create(self, path: Path) -> SyncedFile:
        """Create a file, or fail."""
        if self.kind in ("eio", "enospc"):
            self._operation()
        return _FailingFile(path, self)

    def _operation(self) -> None:
        self.count += 1
        if self.count == self.nth:
            self.failed = True
            number = errno.ENOSPC if self.kind in ("enospc", "short") else errno.EIO
            raise OSError(number, os.strerror(number))


class _FailingFile(QuickFile):
    def __init__(self, path: Path, disk: FailingDisk) -> None:
        super().__init__(path)
        self._disk = disk
        self._broken = False

    def write(self, data: Any) -> int:
        assert not self._broken, "a file was written to after its first error"
        try:
            if self._disk.kind != "sync":
                self._disk._operation()
        except OSError:
            if self._disk.kind != "short":
                self._broken = True
                raise
            self._broken = True
            super().write(data[: len(data) // 2])
            raise
        return super().write(data)

    def sync(self) -> None:
        assert not self._broken, "a file was synced after its first error"
        if self._disk.kind != "short":
            try:
                self._disk._operation()
            except OSError:
                self._broken = True
                raise


@dataclass
class SmallDisk:
    """A disk with so many bytes of room; files on it are cut short when it is full."""

    free: int
    created: list[Path] = field(default_factory=list)

    def create(self, path: Path) -> SyncedFile:
        """Create a file."""
        if self.free <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.created.append(path)
        return _SmallFile(path, self)

    def usage(self, _: Path) -> tuple[int, int, int]:
        """Return its size, nothing, and the room that is left, as `shutil.disk_usage`."""
        return 100_000_000, 0, self.free


class _SmallFile(QuickFile):
    def __init__(self, path: Path, disk: SmallDisk) -> None:
        super().__init__(path)
        self._disk = disk

    def write(self, data: Any) -> int:
        if self._disk.free <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = super().write(data[: self._disk.free])
        self._disk.free -= taken
        return taken


@dataclass
class LoggedDisk:
    """A disk that writes down every write and barrier, for images of what a crash may leave."""

    log: list[tuple[str, str, int, bytes]] = field(default_factory=list)
    """`("write", name, offset, bytes)` and `("sync", name)`, in order."""

    def create(self, path: Path) -> SyncedFile:
        """Create a file."""
        self.log.append(("create", path.name, 0, b""))
        return _LoggedFile(path, self)


class _LoggedFile(QuickFile):
    def __init__(self, path: Path, disk: LoggedDisk) -> None:
        super().__init__(path)
        self._short, self._disk = path.name, disk

    def write(self, data: Any) -> int:
        self._disk.log.append(("write", self._short, self.tell(), bytes(data)))
        return super().write(data)

    def sync(self) -> None:
        self._disk.log.append(("sync", self._short, 0, b""))


# R7: session files derived twice are equal, and a kill leaves a whole file or none --------------


_STEP_NS = 62_500
_BLOCK_FRAMES = 1600


def journal_of_runs(folder: Path, frames: int, recording: str = "ab" * 16) -> tuple[Path, ...]:
    """Record 16 000 frames a second with four bumps in them, in several segments."""
    bench = small_bench()
    one = bumps(small_codec(), 10)
    head = JournalHead(bench.text, bench.dbc_text, "test", BUMPS_START_NS, 0, recording)
    places = [round(frames * (k + 0.5) / len(LABELS)) for k in range(len(LABELS))]
    writer = JournalWriter(folder, head, RecorderConfig(segment_bytes=frames * 10.0), QuickFile)
    for first in range(0, frames, _BLOCK_FRAMES):
        n = np.arange(first, min(first + _BLOCK_FRAMES, frames))
        part = replace(one.select(n % len(one)), t_ns=BUMPS_START_NS + n * _STEP_NS)
        writer.append(part, HopLosses())
        for label, place in zip(LABELS, places, strict=True):
            if first <= place < first + _BLOCK_FRAMES:
                writer.append_events([Event(BUMPS_START_NS + place * _STEP_NS, "bump", 9.0, label)])
        writer.maintain(first * 1e-9 * _STEP_NS)
    writer.close(ended=True)
    return writer.paths


def run_derive(target: Path, segments: Sequence[Path]) -> subprocess.Popen[str]:
    """Start the derivation as the recorder does."""
    command = [sys.executable, "-m", "daq.session.build", str(target), *map(str, segments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


@dataclass(frozen=True, slots=True)
class DeriveKills:
    """Kills in mid-derivation: how many left no file, a whole one, and how many hit the writing."""

    absent: int
    whole: int
    writing: int


def kill_derive(folder: Path, segments: Sequence[Path], count: int, seed: int = 7) -> DeriveKills:
    """Kill `count` derivations at random moments from when they begin to write."""
    began_s = time.monotonic()
    assert len(derive(segments, folder / "undisturbed.h5").session.runs) == len(LABELS)
    lasts_s = time.monotonic() - began_s
    true = (folder / "undisturbed.h5").read_bytes()
    assert true
    rng = np.random.default_rng(seed)
    absent = whole = writing = 0
    target, part = folder / "killed.h5", ".killed.*.tmp.h5"
    for number in range(count):
        target.unlink(missing_ok=True)
        for left in folder.glob(part):
            left.unlink()
        with run_derive(target, segments) as process:
            while not any(folder.glob(part)) and process.poll() is None:
                time.sleep(0.0005)
            # It writes at the end; the first one is killed at once, so that the writing is hit.
            wait_s = rng.uniform(0.0, 0.2) * lasts_s if number else 0.0
            try:
                process.wait(wait_s)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
        writing += any(folder.glob(part))
        if target.exists():
            whole += 1
            assert target.read_bytes() == true, "half a file under the final name"
        else:
            absent += 1
    assert writing, "no kill hit the writing"
    derive(segments, target)
    assert target.read_bytes() == true, "derived twice, and not the same"
    return DeriveKills(absent, whole, writing)
