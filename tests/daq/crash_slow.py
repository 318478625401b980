"""R16: every fdatasync takes a second; queue and memory must bridge it."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from daq.bench.config import BusConfig
from daq.bus.source import SourceLosses
from daq.journal.folder import segments_in
from daq.journal.segment import SyncedFile
from dbc.frames import FrameBatch

from .crash_frames import RATE_HZ, block, read_numbers
from .recorder_run import Running, sources
from .small_campaign import small_bench

_READ_S = 0.01


@dataclass(frozen=True, slots=True)
class Slow:
    """Frames read from the bus, and the most that ever stood in the queue, in blocks."""

    frames: int
    queue_high: int
    queue_room: int


class _Bus:
    """Gives out numbered frames at the rate of four full buses, for so many seconds."""

    name = "full"

    def __init__(self, frames: int) -> None:
        self.frames = frames
        self._given = 0
        self._start_s = time.monotonic()

    def read(self, timeout_s: float) -> FrameBatch:
        time.sleep(min(timeout_s, _READ_S))
        due = min(round((time.monotonic() - self._start_s) * RATE_HZ), self.frames)
        first, self._given = self._given, due
        return block(first, due - first)

    def losses(self) -> SourceLosses:
        return SourceLosses()

    def close(self) -> None:
        """Nothing is held."""


class _SlowFile(SyncedFile):
    def sync(self) -> None:
        time.sleep(1.0)
        super().sync()


def slow_disk(folder: Path, seconds: int) -> Slow:
    """Record for so long on a disk whose every sync takes a second.

    Raises
    ------
    AssertionError
        If a frame is lost, doubled or altered.
    """
    frames = seconds * RATE_HZ
    bench = replace(small_bench(), buses=(BusConfig("test", "full", 1_000_000),))
    with Running(bench, folder, sources(_Bus(frames)), create=_SlowFile) as running:
        status = running.until(lambda s: s.disk.recorded_frames == frames)
    assert status.losses.queue_dropped == 0
    assert np.array_equal(read_numbers(segments_in(folder / "journal")), np.arange(frames))
    return Slow(frames, max(s.queue.high for s in running.published), status.queue.room)
