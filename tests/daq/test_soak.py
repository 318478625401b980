"""R8: weeks of recording in minutes, `python -m tests.daq.test_soak [FRAMES [STOPS]]`."""

from __future__ import annotations

import gc
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self
from unittest import mock

import numpy as np
import pytest

from daq.bench.config import Bench, bench_codec, load_bench, parse_bench
from daq.bus.source import HopLosses
from daq.control.exchange import Client, Server
from daq.control.messages import (
    Accept,
    Arm,
    AskStatus,
    Note,
    Order,
    Phase,
    Reject,
    Reply,
    SessionState,
    Start,
    Status,
    Stop,
    Until,
)
from daq.journal.reader import segments_in
from daq.recorder import recorder as engine_module
from daq.recorder.readers import PieceQueue
from daq.recorder.recorder import Recorder
from daq.runs import RunStatus
from dbc import Codec, FrameBatch

from .small_campaign import frames_at

PERIOD_S = 1.024
"""A whole number of turns of every counter, so one bump can follow itself."""
START_NS = 1_800_000_000_000_000_000
CHUNK = 1024
_BUMP_S, _DECAY_S, _RATE_HZ = 0.2, 0.06, 4.0
_HEIGHT = {"acc_f": 2.0, "acc_r": 2.0, "trave": 30.0, "acc_z": 5.0}
"""By the first letters of a signal: of hubs in g, of travel in mm, of the body in m/s2."""
_QUEUED = 4
_PAUSE_S = 0.002


def one_bump(codec: Codec, seed: int = 1) -> FrameBatch:
    """Return all frames of one period: rest, the car on all wheels up and down, and rest."""
    rng = np.random.default_rng(seed)
    parts = []
    for place, layout in enumerate(codec.messages):
        assert layout.cycle_s is not None
        n = round(PERIOD_S / layout.cycle_s)
        t_s = np.arange(n) * layout.cycle_s
        since_s = np.maximum(t_s - _BUMP_S, 0.0)
        bump = 2 * np.exp(-since_s / _DECAY_S) * np.sin(2 * np.pi * _RATE_HZ * since_s)
        values = {
            signal.name: _HEIGHT.get(signal.name[:5], 0.0) * bump
            + 5 * signal.factor * rng.standard_normal(n)
            for signal in layout.signals
            if signal.name not in ("counter", "crc")
        }
        t_ns = np.rint(t_s * 1e9) + place * 100_000
        data = codec.encode(layout.name, values)
        parts.append(frames_at(t_ns, data, layout.can_id, layout.length))
    return FrameBatch.concatenate(parts).by_time()


class TirelessBench:
    """The same bump for ever, each with stamps of its own, while it is let run.

    `bump`: of one period.  `pieces`: the recorder's; the bench waits while some pieces are in it.
    """

    name = "tireless"

    def __init__(self, bump: FrameBatch, pieces: PieceQueue) -> None:
        self.given = 0
        self.resting = threading.Event()
        self._bump, self._pieces = bump, pieces
        self._limit = 0
        self._run = threading.Event()
        self._closed = threading.Event()

    def run(self, limit: int) -> None:
        """Bump until so many frames were given in all, or ordered to rest."""
        self._limit = limit
        self.resting.clear()
        self._run.set()

    def rest(self, patience_s: float) -> None:
        """Give no more frames; return when the last one was given."""
        self._run.clear()
        assert self.resting.wait(patience_s)

    def read(self, timeout_s: float) -> FrameBatch:
        if self.given == self._limit:
            self._run.clear()
        if not self._run.is_set():
            self.resting.set()
            self._run.wait(timeout_s)
            return FrameBatch.empty()
        if self._pieces.status.blocks >= _QUEUED:
            self._closed.wait(min(timeout_s, _PAUSE_S))
            return FrameBatch.empty()
        turn, first = divmod(self.given, len(self._bump))
        part = self._bump.select(slice(first, first + min(CHUNK, self._limit - self.given)))
        self.given += len(part)
        return replace(part, t_ns=part.t_ns + START_NS + turn * round(PERIOD_S * 1e9))

    def losses(self) -> HopLosses:
        return HopLosses()

    def close(self) -> None:
        self._closed.set()


# The recording --------------------------------------------------------------------------------


FRAMES = 10_000_000
FIRST_SHARE = 0.5
"""Share after which nothing may grow: by then the journal is as large as it may be, and the
recorder has an account of each of its segments."""
STOPS = 5
MOST_BYTES = 4_000_000
MOST_OBJECTS = 200
PATIENCE_S = 300.0
BLOCK_S = 0.02
"""In place of a tenth of a second: five times as many blocks, for a leak to show in each."""
_TURN_S = 0.02
_SETTINGS = {
    'excitations = ["bounce", "pitch", "roll"]': 'excitations = ["bounce"]',
    "accept_after_s = 3.0": "accept_after_s = 0.05",
    "pre_s = 1.0": "pre_s = 0.1",
    "post_s = 2.5": "post_s = 0.75",
    "rest_s = 0.3": "rest_s = 0.1",
    "segment_mb = 64.0": "segment_mb = 1.2",
    "keep_gb = 100.0": "keep_gb = 0.1",
}


@dataclass(frozen=True, slots=True)
class Held:
    """Counts what the process holds while nothing is recorded."""

    frames: int
    rss_bytes: int
    objects: int
    files: int
    threads: int


@dataclass(slots=True)
class Tally:
    """Counts what was done so far."""

    recordings: int = 0
    runs: int = 0
    notes: int = 0
    lost: int = 0
    segments: set[str] = field(default_factory=set)


class Soak(AbstractContextManager["Soak"]):
    """A recorder with its server, a bench that never tires, and an operator.

    `folder`: for all files.  `frames`: how many are to come: recordings are the longer.
    """

    def __init__(self, folder: Path, frames: int) -> None:
        bench = soak_bench(frames)
        pieces = PieceQueue()
        self.tally = Tally()
        self.bench = TirelessBench(one_bump(bench_codec(bench)), pieces)
        self._folder = folder
        self._engine = Recorder(
            bench, folder, lambda *_: self.bench, software="soak", pieces=pieces
        )
        address = folder / "socket"
        self._server = Server(self._engine.submit, address)
        self._stop = threading.Event()
        self._writer = threading.Thread(target=self._record)
        self._writer.start()
        self._client = Client(address, "soak", control=True)
        self._recording, self._seen = "", 0

    def __exit__(self, *_: object) -> None:
        self._client.close()
        self._stop.set()
        self._writer.join(PATIENCE_S)
        self._server.close()

    def __enter__(self) -> Self:
        return self

    def record(self, goal: int) -> None:
        """Record campaign after campaign until so many frames were given; then stop."""
        while self.bench.given < goal:
            started = self._ask(Start()).status
            assert started is not None
            self._recording, self._seen = started.recording, 0
            self._ask(Arm(Until.COMPLETE))
            self.tally.recordings += 1
            before = self.bench.given
            self.bench.run(goal)
            self._until(
                lambda status: status.phase is Phase.COMPLETE or self.bench.resting.is_set()
            )
            self.bench.rest(PATIENCE_S)
            own = self.bench.given - before
            status = self._until_recorded(own)
            lost = status.losses
            self.tally.lost += own - status.disk.recorded_frames + lost.counter_gaps
            self.tally.lost += lost.queue_dropped + status.disk.dropped_frames
            self.tally.runs += len(status.runs)
            self.tally.notes += len(status.notes)
        self._ask(Stop())
        self._recording = ""
        self._until(lambda status: status.session.state is SessionState.READY)

    def held(self) -> Held:
        """Return what is held now."""
        gc.collect()
        files = len(list(Path("/proc/self/fd").iterdir()))
        return Held(
            self.bench.given,
            rss_bytes(),
            len(gc.get_objects()),
            files,
            threading.active_count(),
        )

    def _record(self) -> None:
        with mock.patch.object(engine_module, "BLOCK_S", BLOCK_S):
            self._engine.run(self._stop, self._server.publish)

    def _until(self, reached: Callable[[Status], bool]) -> Status:
        """Do what an operator does until something is reached; patience is for progress."""
        seen, patient_s = (-1, -1, -1), time.monotonic() + PATIENCE_S
        while True:
            status = self._ask(AskStatus()).status
            assert status is not None
            self._note_segments()
            if status.recording == self._recording:  # else it is older than the last order
                if reached(status):
                    return status
                self._look_at(status)
            sessions = len(list(self._folder.glob("*.h5")))
            done = (self.bench.given, status.disk.recorded_frames, sessions)
            if done != seen:
                seen, patient_s = done, time.monotonic() + PATIENCE_S
            assert time.monotonic() < patient_s, status
            time.sleep(_TURN_S)

    def _until_recorded(self, frames: int) -> Status:
        return self._until(lambda status: status.disk.recorded_frames >= frames)

    def _look_at(self, status: Status) -> None:
        """Note something on each run; every eighth one is rejected, then accepted after all."""
        if not self._recording:
            return
        for run in status.runs[self._seen :]:
            if run.status is RunStatus.OPEN:
                break
            self._seen += 1
            self._ask(Note(f"{run.label}: {len(run.findings)} findings", run.label))
            if self._seen % 8 == 0:
                self._ask(Reject(run.label, "a second look"))
                self._ask(Accept(run.label, "a third look"))

    def _ask(self, order: Order) -> Reply:
        return self._client.ask(order, PATIENCE_S)

    def _note_segments(self) -> None:
        self.tally.segments |= {path.name for path in segments_in(self._folder / "journal")}


def soak_bench(frames: int) -> Bench:
    """Return the shipped bench with short runs, small segments, little room and many repeats."""
    text = load_bench(None).text
    repeats = min(max(frames // 400_000, 4), 24)
    for old, new in {**_SETTINGS, "repeats = 2": f"repeats = {repeats}"}.items():
        assert old in text
        text = text.replace(old, new)
    return parse_bench(text, "soak.toml", Path(), None)


def rss_bytes() -> int:
    """Return the memory that this process has resident."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def soak(
    folder: Path, frames: int, stops: int, progress: Callable[[Held], None] = lambda _: None
) -> tuple[Held, Held, Tally]:
    """Record so many frames; return what was held at the first stop and the end, and was done."""
    with Soak(folder, frames) as running:
        held = []
        for share in np.linspace(FIRST_SHARE, 1.0, stops):
            running.record(round(share * frames))
            held.append(running.held())
            progress(held[-1])
        return held[0], held[-1], running.tally


def grown(first: Held, last: Held) -> dict[str, bool]:
    """Return what grew, in words, and whether it is more than may be."""
    grown_bytes, objects = last.rss_bytes - first.rss_bytes, last.objects - first.objects
    return {
        f"memory {grown_bytes / 1e6:+.1f} MB": grown_bytes > MOST_BYTES,
        f"objects {objects:+d}": objects > MOST_OBJECTS,
        f"files {last.files - first.files:+d}": last.files != first.files,
        f"threads {last.threads - first.threads:+d}": last.threads != first.threads,
    }


def main() -> int:
    """Soak, and print what was held and done."""
    frames, stops, *_ = (*map(int, sys.argv[1:]), *(FRAMES, STOPS)[len(sys.argv) - 1 :])
    began_s = time.monotonic()

    def report(held: Held) -> None:
        sys.stdout.write(
            f"{held.frames:12,} frames  RSS {held.rss_bytes / 1e6:6.1f} MB  "
            f"{held.objects} objects  {held.files} files  {held.threads} threads  "
            f"[{time.monotonic() - began_s:.0f} s]\n"
        )
        sys.stdout.flush()

    with tempfile.TemporaryDirectory() as folder:
        first, last, tally = soak(Path(folder), frames, stops, report)
    bars = grown(first, last) | {f"{tally.lost} lost": tally.lost != 0}
    failed = [text for text, is_missed in bars.items() if is_missed]
    sys.stdout.write(
        f"R8  {last.frames:,} frames, {tally.recordings} recordings, {tally.runs:,} bumps, "
        f"{tally.notes:,} notes, {len(tally.segments)} segments: {tally.lost} lost; from "
        f"{first.frames:,} frames on {', '.join(bars)}  {f'FAILED: {failed}' if failed else ''}\n"
    )
    return int(bool(failed))


# R8 in small, in a process of its own; the long form is `make soak` -----------------------------


@pytest.mark.long  # half a minute; `make soak` has the whole of it
def test_a_recorder_holds_no_more_after_many_bumps_than_after_few() -> None:
    command = [sys.executable, "-m", "tests.daq.test_soak", "30000", "2"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    reported = re.search(
        r"30,000 frames, (\d+) recordings, (\d+) bumps, (\d+) notes, (\d+) segments: 0 lost",
        done.stdout,
    )
    assert reported, done.stdout
    recordings, bumps, notes, segments = map(int, reported.groups())
    assert recordings >= 2  # one was stopped
    assert bumps >= 3
    assert notes >= 3
    assert segments > recordings


if __name__ == "__main__":
    sys.exit(main())
