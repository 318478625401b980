"""CPU seconds of the desk's commands, whole processes, beside their limits: median of five.

`python -m tests.benchmarks.desk`; on a busy machine a CPU second does less, so the load is printed.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from daq import write_session

from ..identify.stress import stress_session
from ..tui.batches import refused_session

REPEATS = 5
RATE_HZ = 500.0
RUNS = (6, 12, 24, 42)
REFUSED = {"half a campaign": "half", "no roll run": "no_roll", "a hub upside down": "polarity"}


def main() -> None:
    """Print what each command takes, and how the cost of `identify` grows with the runs."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        demo = _run("demo", "--out", str(folder / "demo")) and folder / "demo" / "session_0001.h5"
        print(f"CPU of whole processes, median of {REPEATS}, load {os.getloadavg()[0]:.1f}")
        _row("--help", 0.15, "--help")
        _row("identify, demo (12 runs, 11 channels)", 1.0, "identify", str(demo))
        _row("report, demo", 2.5, "report", str(demo), "--out", str(folder / "report.html"))
        for runs in RUNS:
            file = folder / f"{runs}.h5"
            session = stress_session("linear", 1, RATE_HZ, travels=True, repeats=runs // 6)
            write_session(file, session)
            limit_s = 3.0 if runs >= 40 else None
            _row(
                f"identify, {runs} runs, 11 channels, {RATE_HZ:.0f} Hz",
                limit_s,
                "identify",
                str(file),
            )
        for what, stress in REFUSED.items():
            file = folder / f"{stress}.h5"
            session = refused_session(1) if stress == "half" else stress_session(stress, 1, RATE_HZ)
            write_session(file, session)
            _row(f"identify, refused: {what}", 1.0, "identify", str(file))


def _row(what: str, limit_s: float | None, *arguments: str) -> None:
    """Print the CPU of a command beside its limit."""
    found_s = median(_cpu_s(*arguments) for _ in range(REPEATS))
    against = "" if limit_s is None else f"  (limit {limit_s:g})"
    print(f"  {what:44s} {found_s:.2f} s{against}", flush=True)


def _cpu_s(*arguments: str) -> float:
    with cpu_of_children() as spent:
        _run(*arguments)
    return spent[0]


def _run(*arguments: str) -> bool:
    """Run a command of bumpbench, its bytecode compiled; return True."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, "-m", "tui", *arguments]
    done = subprocess.run(command, capture_output=True, env=kept, check=False)
    assert done.returncode in (0, 1), done.stderr.decode()
    return True


@contextmanager
def cpu_of_children() -> Iterator[list[float]]:
    """Yield a list that afterwards holds the CPU of the processes that ended meanwhile, s."""
    spent: list[float] = []
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    yield spent
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)


if __name__ == "__main__":
    main()
