"""R3: the Nth operation on the disk fails, once, in each way that disks fail."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.reader import read_journal
from daq.journal.writer import JournalWriter

from .crash_disk import FailingDisk
from .crash_frames import HEAD, block, numbers

KINDS = ("eio", "enospc", "short", "sync")
_FRAMES = 20
_LATEST_ALARM_S = 1.0


def fail_once(folder: Path, kind: str, nth: int) -> bool:
    """Record while one operation fails; return whether it came to that.

    Raises
    ------
    AssertionError
        If a frame is lost, doubled or altered, or nothing is said.
    """
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
    contents = read_journal(writer.ledger.paths)
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
