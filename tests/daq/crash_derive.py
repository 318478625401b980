"""R7: session files derived twice are equal, and a kill leaves a whole file or none."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np

from daq.bench.config import BusConfig, RecorderConfig
from daq.bus.source import HopLosses, SourceLosses
from daq.derive.build_session import derive
from daq.journal.folder import segments_in
from daq.journal.format import JournalHead
from daq.journal.reader import JournalReader
from daq.journal.segment import SyncedFile
from daq.journal.writer import JournalWriter
from daq.runs import Event
from dbc.frames import FrameBatch

from .crash_frames import RATE_HZ, QuickFile, block, read_numbers
from .recorder_run import Running, sources
from .small_campaign import LABELS, START_NS, bumps, small_bench, small_codec

_STEP_NS = 62_500
_BLOCK_FRAMES = 1600


def journal_of_runs(folder: Path, frames: int, recording: str = "ab" * 16) -> tuple[Path, ...]:
    """Record 16 000 frames a second with four bumps in them, in several segments."""
    bench = small_bench()
    one = bumps(small_codec(), 10)
    head = JournalHead(bench.text, bench.dbc_text, "test", START_NS, 0, recording)
    places = [round(frames * (k + 0.5) / len(LABELS)) for k in range(len(LABELS))]
    writer = JournalWriter(folder, head, RecorderConfig(segment_bytes=frames * 10.0), QuickFile)
    for first in range(0, frames, _BLOCK_FRAMES):
        n = np.arange(first, min(first + _BLOCK_FRAMES, frames))
        part = one.select(n % len(one))
        writer.append(
            FrameBatch(
                START_NS + n * _STEP_NS, part.can_id, part.flags, part.bus, part.length, part.data
            ),
            HopLosses(),
        )
        for label, place in zip(LABELS, places, strict=True):
            if first <= place < first + _BLOCK_FRAMES:
                writer.append_events([Event(START_NS + place * _STEP_NS, "bump", 9.0, label)])
        writer.maintain(first * 1e-9 * _STEP_NS)
    writer.close(ended=True)
    return writer.paths


def run_derive(target: Path, segments: Sequence[Path]) -> subprocess.Popen[str]:
    """Start the derivation as the recorder does."""
    command = [sys.executable, "-m", "daq.derive.build_session", str(target), *map(str, segments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def contents(path: Path) -> dict[str, bytes]:
    """Return every dataset and attribute of an HDF5 file, as bytes."""
    found: dict[str, bytes] = {}

    def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = np.asarray(item[()]).tobytes()
        for key, value in item.attrs.items():
            if key not in ("DIMENSION_LIST", "REFERENCE_LIST"):  # addresses within the file
                found[f"{name}@{key}"] = repr(value).encode()

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


@dataclass(frozen=True, slots=True)
class DeriveKills:
    """Kills in mid-derivation: how many left no file, a whole one, and how many hit the writing."""

    absent: int
    whole: int
    writing: int


def kill_derive(folder: Path, segments: Sequence[Path], count: int, seed: int = 7) -> DeriveKills:
    """Kill `count` derivations at random moments, every other one while it writes.

    Raises
    ------
    AssertionError
        If a file under the final name differs from the undisturbed one, or no kill hit the writing.
    """
    began_s = time.monotonic()
    with run_derive(folder / "undisturbed.h5", segments) as process:
        assert process.stdout is not None
        written_s = _until_written(process, folder, ".undisturbed.*.tmp.h5")
        reported = json.loads(process.stdout.readline())
    ended_s = time.monotonic()
    assert (reported["loss"], reported["runs"], process.returncode) == ("", len(LABELS), 0)
    true = contents(folder / "undisturbed.h5")
    assert true
    rng = np.random.default_rng(seed)
    absent = whole = writing = 0
    target, part = folder / "killed.h5", ".killed.*.tmp.h5"
    for number in range(count):
        target.unlink(missing_ok=True)
        for left in folder.glob(part):
            left.unlink()
        with run_derive(target, segments) as process:
            if number % 2 == 0:  # of the first one as soon as it writes, so that one is hit
                _until_written(process, folder, part)
                wait_s = rng.uniform(0.0, ended_s - written_s) if number else 0.0
            else:  # most of the time goes to imports; the writing is at the end
                wait_s = rng.uniform(0.5, 1.0) * (ended_s - began_s)
            try:
                process.wait(wait_s)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
        writing += any(folder.glob(part))
        if target.exists():
            whole += 1
            assert contents(target) == true, "half a file under the final name"
        else:
            absent += 1
    assert writing, "no kill hit the writing"
    assert len(derive(segments, target).session.runs) == len(LABELS)
    assert contents(target) == true, "derived twice, and not the same"
    return DeriveKills(absent, whole, writing)


def _until_written(process: subprocess.Popen[str], folder: Path, part: str) -> float:
    """Return the monotonic time at which a derivation has begun to write; or has ended."""
    while not any(folder.glob(part)) and process.poll() is None:
        time.sleep(0.0005)
    return time.monotonic()


def rates(folder: Path, frames: int) -> tuple[float, float]:
    """Return how fast a journal is verified and derived, frames/s."""
    segments = journal_of_runs(folder, frames)
    began_s = time.monotonic()
    reader = JournalReader(segments)
    count = sum(len(block.frames) for block in reader)
    verified_s = time.monotonic() - began_s
    assert count == frames
    assert not reader.lost.any
    began_s = time.monotonic()
    derive(segments, folder / "session.h5")
    return frames / verified_s, frames / (time.monotonic() - began_s)


# R16: every fdatasync takes a second; queue and memory must bridge it ---------------------------


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
