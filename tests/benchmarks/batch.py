"""Measures what more workers gain a batch, what the executor costs, and what a cluster does.

The time on a shared machine says little: in addition there is what all its processors did in that
time for any program, and the speed of two plain loops at once, which no executor can exceed: two
processors that share a core or a cache are less than twice one.

`python -m tests.benchmarks.batch [SESSIONS]`: of 200 the costs of a start hardly matter.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from daq import read_session, write_session
from identify.batch import session_row
from tests.flow.dask_cluster import cluster
from tests.identify.stress import stress_session
from tui.cli import run

from .desk import cpu_of_children

SESSIONS = 8
_REAPED = """
import ctypes, os, subprocess, sys
ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER: workers outlive what started them
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
try:
    while True:
        os.wait()
except ChildProcessError:
    sys.exit(code)
"""
"""Runs a command and waits for all that it leaves behind, so that its CPU is counted."""
TOLD = 200
"""Number of sessions for which the costs are printed."""


def main(sessions: int = SESSIONS) -> None:
    """Print speed-up, overhead and a cluster's time over a batch of so many sessions."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        files = [folder / "s" / f"car{seed:03}.h5" for seed in range(sessions)]
        files[0].parent.mkdir()
        for seed, file in enumerate(files):
            write_session(file, stress_session("linear", seed))
        print(f"batch of {sessions} sessions, 12 runs x 7 channels x 4 s at 200 Hz each")
        session_row(read_session(files[0]))  # what is loaded once is not counted
        began_cpu_s = time.process_time()
        bare_s = _loop_s(files)
        cpu_s = time.process_time() - began_cpu_s
        print(f"  in a loop: {bare_s:.1f} s, {cpu_s / sessions:.2f} s CPU a session")
        with get_context("spawn").Pool(2) as loops:
            loops.map(_loop_s, [files[:1]] * 4)  # both have everything loaded
            at_once_s = max(loops.map(_loop_s, [files[::2], files[1::2]], chunksize=1))
        print(f"  two loops at once: {bare_s / at_once_s:.2f} times the speed, the machine's limit")
        one = _batch(folder, "one", "--workers", "1")
        two = _batch(folder, "two", "--workers", "2")
        with cluster(folder, 2) as (address, _):
            cluster_s = _batch(folder, "dask", "--scheduler", address)
        print(f"  executor, one worker over the loop: {(one / bare_s - 1) * 100:+.1f} %")
        print(f"  two workers over one: {one / two:.2f} times the speed")
        print(f"  Dask over two processes: {(cluster_s / two - 1) * 100:+.1f} % time")
        _costs(folder, files)


def _loop_s(files: Sequence[Path]) -> float:
    """Return the time to read and identify these sessions one after another, s."""
    began_s = time.perf_counter()
    for file in files:
        session_row(read_session(file))
    return time.perf_counter() - began_s


def _costs(folder: Path, files: Sequence[Path]) -> None:
    """Print what start-up and a session cost on two processes, and on a cluster of two workers."""
    few, many = max(1, len(files) // 4), len(files)
    whole = {}
    for name in ("processes", "a local Dask cluster"):
        cpu_s = [_cost_s(folder, files[:n], name != "processes") for n in (few, many)]
        each_s = (cpu_s[1] - cpu_s[0]) / (many - few)
        start_s = cpu_s[1] - many * each_s
        whole[name] = start_s + TOLD * each_s
        print(
            f"  {name}: {start_s:.1f} s of CPU to start, {each_s:.3f} s a session;"
            f" {whole[name]:.0f} s for {TOLD}"
        )
    one, other = whole.values()
    print(f"  a cluster over processes, {TOLD} sessions: {(other / one - 1) * 100:+.1f} % CPU")


def _cost_s(folder: Path, files: Sequence[Path], on_cluster: bool) -> float:
    """Return the CPU of a batch with all its processes, those of the cluster too, s."""
    out = folder / f"cost{len(files)}{on_cluster}.csv"
    batch = [sys.executable, "-m", "tui", "batch", *map(str, files), "--out", str(out)]
    command = [sys.executable, "-c", _REAPED, *batch]
    with cpu_of_children() as spent:
        if on_cluster:
            with cluster(folder, 2) as (address, _):
                subprocess.run([*command, "--scheduler", address], capture_output=True, check=True)
        else:
            subprocess.run([*command, "--workers", "2"], capture_output=True, check=True)
    return spent[0]


def _batch(folder: Path, name: str, *options: str) -> float:
    """Run a batch and return its wall time, s."""
    out = folder / f"{name}.csv"
    said = io.StringIO()
    busy_s, idle_s = _machine()
    with contextlib.redirect_stdout(said):
        assert run(["batch", str(folder / "s"), "--out", str(out), "--json", *options]) == 0
    busy, idle = (b - a for a, b in zip((busy_s, idle_s), _machine(), strict=True))
    with out.open(newline="") as stream:
        work = sum(float(row["seconds"]) for row in csv.DictReader(stream))
    wall = float(json.loads(said.getvalue())["seconds"])
    print(
        f"  {name}: {wall:.1f} s wall, {work:.1f} s inside sessions; the whole machine: "
        f"{busy:.1f} s of processor time, {busy / (busy + idle) * 100:.0f} % busy"
    )
    return wall


def _machine() -> tuple[float, float]:
    """Return the seconds that all processors of the machine were busy, and idle."""
    numbers = [int(n) for n in Path("/proc/stat").read_text().split("\n")[0].split()[1:9]]
    idle = numbers[3] + numbers[4]
    return (sum(numbers) - idle) / 100.0, idle / 100.0


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
