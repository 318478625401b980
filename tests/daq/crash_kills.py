"""R1: a recorder's journal under SIGKILL at random moments, paced and unthrottled."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.folder import last_recording, segments_in
from daq.journal.writer import JournalWriter

from .crash_frames import BLOCK_FRAMES, HEAD, RATE_HZ, block, read_numbers

SEGMENT_BYTES = 400_000.0
"""Small, so that kills fall into the change of segments too."""


@dataclass(frozen=True, slots=True)
class Kill:
    """One kill: frames acknowledged, read back, and received but lost (paced only)."""

    hot: bool
    acknowledged: int
    read: int
    in_flight: int
    segments: int


def write_forever(folder: Path, hot: bool) -> None:
    """Write numbered blocks and tell after each how many frames are acknowledged."""
    writer = JournalWriter(folder, HEAD, RecorderConfig(segment_bytes=SEGMENT_BYTES))
    n, start_s = 0, time.monotonic()
    os.write(1, f"start {start_s!r}\n".encode())
    while True:
        if not hot:
            time.sleep(max(0.0, start_s + (n + BLOCK_FRAMES) / RATE_HZ - time.monotonic()))
        writer.append(block(n, BLOCK_FRAMES), HopLosses())
        writer.maintain(time.monotonic())
        n += BLOCK_FRAMES
        os.write(1, f"{writer.status.recorded_frames}\n".encode())


def kill_once(folder: Path, hot: bool, after_s: float) -> Kill:
    """Start a writer, kill it, read its journal with nothing but the reader.

    Raises
    ------
    AssertionError
        If an acknowledged frame is lost, or a frame is not what was written.
    """
    command = [sys.executable, "-m", "tests.daq.crash_kills", str(folder), "hot" if hot else ""]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        start_s = float(writer.stdout.readline().split()[1])
        deadline_s = time.monotonic() + after_s
        told = []
        while time.monotonic() < deadline_s:  # each line is an acknowledgement: 10 /s at least
            told.append(writer.stdout.readline())
        writer.send_signal(signal.SIGKILL)
        killed_s = time.monotonic()
        told += writer.stdout.readlines()
    acknowledged = int([line for line in told if line.endswith("\n")][-1])
    segments = segments_in(folder)
    read = read_numbers(segments)
    assert np.array_equal(read, np.arange(len(read))), "frames are missing, doubled or in disorder"
    assert len(read) >= acknowledged, f"{acknowledged - len(read)} acknowledged frames lost"
    tail = last_recording(folder)
    assert tail is not None
    assert tail.frames == len(read)
    assert not tail.ended
    received = len(read) if hot else round((killed_s - start_s) * RATE_HZ)
    return Kill(hot, acknowledged, len(read), max(0, received - len(read)), len(segments))


def kills(folder: Path, count: int, seed: int = 1) -> list[Kill]:
    """Kill `count` writers at random moments, every other one unthrottled, two at a time."""
    rng = np.random.default_rng(seed)
    moments = [rng.uniform(0.15, 0.6) if i % 2 else rng.uniform(0.2, 2.0) for i in range(count)]

    def one(i: int) -> Kill:
        place = folder / f"kill{i}"
        try:
            return kill_once(place, i % 2 == 1, moments[i])
        finally:
            shutil.rmtree(place, ignore_errors=True)

    with ThreadPoolExecutor(2) as lanes:
        return list(lanes.map(one, range(count)))


if __name__ == "__main__":
    write_forever(Path(sys.argv[1]), sys.argv[2] == "hot")
