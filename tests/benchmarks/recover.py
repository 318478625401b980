"""Measures `recover` on an hour of 4,000 frames a second, and the work after the last run.

`python -m tests.benchmarks.recover SECONDS`: the length of the recording.

The bench is the simulated one, which sends exactly that many frames.  It has a run every 15 s, and
goes on sending between; a block of the journal holds a tenth of a second.  Costs are CPU time of
processes of their own, kernel included, the least of some rounds: other work on the machine can
only add to them.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from daq.bench.config import Bench, RecorderConfig, bench_codec, load_bench, parse_bench
from daq.bus.source import HopLosses
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from daq.runlog import Code, verdict_entry
from daq.runs import Event
from daq.session.build import derive
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch

from ..daq.crash_frames import QuickFile

SECONDS = 3375
"""13.5 million frames."""
RATE_HZ = 4_000
PERIOD_S = 15
BUMP_S = 1.2
"""When a run has its bump, s after its beginning; the window reaches from 0.2 to 3.7 s."""
DIFFERENT_RUNS = 6
ROUNDS = 3
START_NS = 1_800_000_000_000_000_000
_IMPORTS = "import tui; from daq.session.build import *"
"""What a process needs in any case, to be taken off."""
_DERIVE = f"""{_IMPORTS}
derive([Path(name) for name in sys.argv[2:]], Path(sys.argv[1]))
"""
_MEASURE = """
import os, subprocess, sys, time
began_s = time.monotonic()
child = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(child.pid, 0)
assert status == 0
print(time.monotonic() - began_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3)
"""
"""Runs a command; a small process of its own, for the peak of a child counts that of its parent."""


@dataclass(frozen=True, slots=True)
class Spent:
    """Cost of a process."""

    wall_s: float
    """From its start to its end, s."""
    cpu_s: float
    """CPU time, kernel included, s."""
    peak_mb: float
    """Most memory that it held, MB."""


def main(seconds: int = SECONDS) -> None:
    """Print what recovering costs, and how long the session takes after the last run."""
    with TemporaryDirectory() as name:
        grown, recovered = Path(name, "session_0001.h5"), Path(name, "recovered.h5")
        paths, last = _recorded(Path(name, "journal"), seconds, grown)
        segments = [str(path) for path in paths]
        rounds = [_spent("-c", _DERIVE, str(recovered), *segments) for _ in range(ROUNDS)]
        same = recovered.read_bytes() == grown.read_bytes()
        command = _spent("-m", "tui", "recover", *segments, "--out", str(recovered))
    start_s = min(_spent("-c", _IMPORTS).cpu_s for _ in range(ROUNDS))
    frames, cpu_s = seconds * RATE_HZ, min(each.cpu_s for each in rounds) - start_s
    print(
        f"recover, {frames:,} frames in {seconds // PERIOD_S} runs: {cpu_s:.2f} CPU s, "
        f"{frames / cpu_s / 1e6:.2f} M frames/s, at most {rounds[0].peak_mb:.0f} MB, "
        f"{'the same bytes' if same else 'OTHER BYTES'} as run by run; "
        f"the command from its start to its table {command.cpu_s:.1f} CPU s"
    )
    print(
        f"recover, session after the last run: {last.wall_s:.2f} s, {last.cpu_s:.2f} CPU s, "
        f"{last.peak_mb:.0f} MB"
    )


def _recorded(folder: Path, seconds: int, target: Path) -> tuple[tuple[Path, ...], Spent]:
    """Write a recording and its session, and return what the session cost after the last run."""
    bench = _bench()
    head = JournalHead(bench.text, bench.dbc_text, "benchmark", START_NS, 0, "ab" * 16, 1)
    states = [state.name for state in bench.mass_states]
    steps = [f"{state}_{kind}" for state in states for kind in ("bounce", "pitch", "roll")]
    runs = _runs(bench)
    with JournalWriter(folder, head, RecorderConfig(), QuickFile) as writer:
        for number in range(seconds // PERIOD_S):
            if number == seconds // PERIOD_S - 1:
                derive(writer.paths, target)
            start_ns = START_NS + number * PERIOD_S * 10**9
            frames = runs[number % len(runs)]
            for first in range(0, len(frames), RATE_HZ // 10):
                block = frames.select(slice(first, first + RATE_HZ // 10))
                writer.append(replace(block, t_ns=block.t_ns + start_ns), HopLosses())
                writer.maintain(number * PERIOD_S + first / RATE_HZ)
            bump_ns = start_ns + round(BUMP_S * 1e9)
            label = f"{steps[number % len(steps)]}_{number // len(steps) + 1}"
            writer.append_events([Event(bump_ns, Code.BUMP, 20.0, label)])
            writer.append_events([verdict_entry(bump_ns + 2_600_000_000, label, [])])
            writer.cut()  # as the recorder does, so that the run can be read
        segments = [str(path) for path in writer.paths]
        last = _spent("-m", "daq.session.build", str(target), *segments)
        return writer.paths, last


def _bench() -> Bench:
    """Return the bench that `demo` has, with as many runs as an hour holds."""
    text = load_bench(None).text.replace("\nrepeats = 2", "\nrepeats = 50")
    return parse_bench(text, "bench.toml", Path(), load_bench(None).dbc_text)


def _runs(bench: Bench) -> list[FrameBatch]:
    """Return the frames of some runs with those until the next, their times from 0 on."""
    found = []
    for frames in campaign_frames(bench, bench_codec(bench), SimulatedCar(), 1, 0):
        turn, row = np.divmod(np.arange(PERIOD_S * RATE_HZ), len(frames))
        t_ns = frames.t_ns - frames.t_ns[0]
        length_ns = len(frames) * 10**9 // RATE_HZ
        found.append(replace(frames.select(row), t_ns=t_ns[row] + turn * length_ns))
        if len(found) == DIFFERENT_RUNS:
            break
    return found


def _spent(*arguments: str) -> Spent:
    """Return what a Python costs."""
    command = [sys.executable, "-S", "-c", _MEASURE, sys.executable, *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    return Spent(*map(float, done.stdout.split()))


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:2]))
