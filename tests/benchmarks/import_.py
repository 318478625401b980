"""Importing a log against python-can's reader alone on it: `python -m tests.benchmarks.import_ N`.

Importing is everything up to the session's nouns: reading, decoding, watching counters, finding
bumps, keeping what lies around them.  CPU time, for the machine may be shared.
"""

from __future__ import annotations

import gc
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import can
import numpy as np

from daq.bench.config import Bench, load_bench
from daq.formats.log import read_log
from daq.session.from_frames import Intake, LogPart
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import Codec, FrameBatch, parse_codec

FRAMES = 100_000
SUFFIXES = (".blf", ".asc", ".log")
START_NS = 1_760_000_000_000_000_000


def log_frames(bench: Bench, codec: Codec, n: int) -> FrameBatch:
    """Return n frames: a simulated campaign, again and again."""
    batches = list(campaign_frames(bench, codec, SimulatedCar(), 1, START_NS))
    campaign = FrameBatch.concatenate(batches)
    length_ns = int(campaign.t_ns[-1] - campaign.t_ns[0]) + 1_000_000
    turns = range(-(-n // len(campaign)))
    repeated = [replace(campaign, t_ns=campaign.t_ns + turn * length_ns) for turn in turns]
    return FrameBatch.concatenate(repeated).select(slice(n))


def write_log(path: Path, frames: FrameBatch) -> None:
    """Write frames with python-can's writer."""
    with can.Logger(path) as log:
        columns = (frames.t_ns.tolist(), frames.can_id.tolist(), frames.length.tolist())
        for t_ns, can_id, length, row in zip(*columns, frames.data, strict=True):
            data = row[:length].tobytes()
            log(can.Message(t_ns * 1e-9, can_id, is_extended_id=False, data=data))


def imported(bench: Bench, codec: Codec, path: Path) -> LogPart:
    """Read, decode and cut a log."""
    intake, log = Intake(bench, codec), read_log(path)
    for batch in log:
        intake.take(batch, log.hops)
    return intake.part()


def read_ours(path: Path) -> int:
    """Read a log, and do nothing with it."""
    return sum(len(batch) for batch in read_log(path))


def read_theirs(path: Path) -> int:
    """Read a log with python-can's reader, and do nothing with it."""
    with can.LogReader(path) as messages:
        return sum(1 for _ in messages)


def main(n: int = FRAMES) -> None:
    """Print cost and ratio for each format, and how memory grows with the length of the log."""
    bench = load_bench(None)
    codec = parse_codec(bench.dbc_text, bench.dbc_name)
    frames = log_frames(bench, codec, n)
    with TemporaryDirectory() as folder:
        for suffix in SUFFIXES:
            path, half = Path(folder) / f"log{suffix}", Path(folder) / f"half{suffix}"
            write_log(path, frames)
            write_log(half, frames.select(slice(n // 2)))
            ours = _fastest(partial(imported, bench, codec, path))
            reading = _fastest(partial(read_ours, path))
            theirs = _fastest(partial(read_theirs, path))
            print(
                f"import {suffix}, {n:,} frames: {ours / n * 1e6:.2f} us/frame (reading alone "
                f"{reading / n * 1e6:.2f}), python-can's reader alone {theirs / n * 1e6:.2f}, "
                f"ratio {ours / theirs:.2f}"
            )
            peaks = [_peak_mb(partial(read_ours, p)) for p in (half, path)]
            print(f"import {suffix}, peak memory of reading: {peaks[0]:.1f} MB for half, "
                  f"{peaks[1]:.1f} MB for all of it")  # fmt: skip


def _fastest(work: Callable[[], object]) -> float:
    spent = []
    for _ in range(3):
        gc.collect()
        start = process_time()
        work()
        spent.append(process_time() - start)
    return min(spent)


def _peak_mb(work: Callable[[], object]) -> float:
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return float(np.round(peak / 1e6, 1))


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:2]))
