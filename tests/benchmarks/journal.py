"""Reading journals against python-can's reader of BLF, as CPU time.

`python -m tests.benchmarks.journal SECONDS`: the length of the recording.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import can

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.format import JournalHead
from daq.journal.reader import JournalReader
from daq.journal.writer import JournalWriter
from dbc import FrameBatch

from ..daq.crash_disk import QuickFile
from .decode import interleaved_frames
from .import_ import write_log

RATES_HZ = (400, 4_000, 36_000)
"""Frames in a second: a block of the journal holds a tenth of that."""
BLF_FRAMES = 100_000


def write_journal(folder: Path, rate_hz: int, seconds: int) -> tuple[tuple[Path, ...], FrameBatch]:
    """Write a recording with ten blocks a second; return its segments and its frames."""
    frames = interleaved_frames(rate_hz * seconds, seed=1)
    folder.mkdir()
    head = JournalHead("bench", "dbc", "benchmark", 0, 0, "ab" * 16)
    size = rate_hz // 10
    with JournalWriter(folder, head, RecorderConfig(), QuickFile) as writer:
        for first in range(0, len(frames), size):
            writer.append(frames.select(slice(first, first + size)), HopLosses())
            writer.maintain(first / rate_hz)
    return writer.paths, frames


def read_ours(paths: tuple[Path, ...]) -> int:
    """Read a journal with all checks."""
    reader = JournalReader(paths)
    count = sum(len(block.frames) for block in reader)
    assert not reader.lost.any
    return count


def read_blf(path: Path) -> int:
    """Return the number of frames that python-can finds in a BLF file."""
    with can.LogReader(path) as messages:
        return sum(1 for _ in messages)


def main(seconds: int = 300) -> None:
    """Print the rates and their ratios."""
    for rate_hz in RATES_HZ:
        with TemporaryDirectory() as folder:
            paths, frames = write_journal(Path(folder, "journal"), rate_hz, seconds)
            n = len(frames)
            ours = n / _cpu_s(partial(read_ours, paths))
            blf = Path(folder, "log.blf")
            write_log(blf, frames.select(slice(BLF_FRAMES)))
            theirs = min(n, BLF_FRAMES) / _cpu_s(partial(read_blf, blf))
        print(
            f"journal, {n:,} frames in blocks of {rate_hz // 10}: {ours / 1e6:.1f} M frames/s; "
            f"python-can's reader of BLF {theirs / 1e6:.2f}, ratio {ours / theirs:.0f}"
        )


def _cpu_s(work: Callable[[], object]) -> float:
    spent = []
    for _ in range(3):
        began_s = process_time()
        work()
        spent.append(process_time() - began_s)
    return min(spent)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:2]))
