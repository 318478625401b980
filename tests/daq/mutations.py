"""Session files with damage of every kind, through the command line.

``python -m tests.daq.mutations 2000`` runs a campaign and prints what came of it; it fails if any
file is read though it was changed, gives a traceback, or takes more than 12 s of processor time or
more than 1 GB.
"""

from __future__ import annotations

import contextlib
import io
import multiprocessing
import os
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from daq.session import read_session, write_session
from tui.cli import run

from .small_session import small_session

GOLDEN = Path(__file__).parents[1] / "golden" / "session_v1_2026-11.h5"
MAX_S, MAX_BYTES = 12.0, 1 << 30
_REPORT_EVERY = 100
_NUMBERS = (0, 1, 0x7F, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**45, 2**63 - 1, 2**64 - 1)


@dataclass(slots=True)
class Outcome:
    """Counts how the files of a campaign ended."""

    codes: Counter[int] = field(default_factory=Counter)
    """How often each exit code came."""
    faults: list[str] = field(default_factory=list)
    """What must not be: tracebacks, more than one line, too long."""
    slowest_s: float = 0.0
    """Of all files."""
    peak_bytes: int = 0
    """Most memory that a process held."""


def mutants(count: int, folder: Path, seed: int) -> Iterator[bytes]:
    """Yield damaged session files; every file has one to four mutations."""
    written = folder / "seed.h5"
    write_session(written, small_session())
    seeds = [written.read_bytes()]
    write_session(written, read_session(GOLDEN))
    seeds.append(written.read_bytes())
    rng = np.random.default_rng(seed)
    for _ in range(count):
        raw = bytearray(seeds[rng.integers(len(seeds))])
        while raw in seeds:
            for _ in range(rng.integers(1, 5)):
                _mutate(raw, rng)
        yield bytes(raw)


def _mutate(raw: bytearray, rng: np.random.Generator) -> None:
    at = int(rng.integers(len(raw) - 88))  # not in the checksum at the end
    size = int(rng.integers(1, 64))
    match rng.integers(8):
        case 0 | 1 | 2:
            raw[at] ^= 1 << int(rng.integers(8))
        case 3:
            number = _NUMBERS[rng.integers(len(_NUMBERS))]
            width = (1, 2, 4, 8)[rng.integers(4)]
            raw[at : at + width] = (number % (1 << 8 * width)).to_bytes(width, "little")
        case 4:
            raw[at : at + size] = b"\xff" * size
        case 5:
            raw[at : at + size] = bytes(size)
        case 6:
            other = int(rng.integers(len(raw) - 64))
            raw[at : at + size] = raw[other : other + size]
        case _:  # the start of the file has the structures that everything hangs on
            raw[int(rng.integers(4096))] = int(rng.integers(256))


def campaign(
    count: int, seed: int = 1, jobs: int = 1, report: Callable[[str], None] = lambda text: None
) -> Outcome:
    """Validate `count` damaged files, `jobs` at once; `report` is called every 100 files."""
    total = Outcome()
    fork = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as folder, fork.Pool(jobs) as pool:
        files = enumerate(mutants(count, Path(folder), seed))
        attempt = partial(_try, Path(folder), seed)
        for number, outcome in enumerate(pool.imap(attempt, files), 1):
            total.codes += outcome.codes
            total.faults += outcome.faults
            total.slowest_s = max(total.slowest_s, outcome.slowest_s)
            total.peak_bytes = max(total.peak_bytes, outcome.peak_bytes)
            if number % _REPORT_EVERY == 0:
                report(f"{number}: {dict(sorted(total.codes.items()))}, {len(total.faults)} faults")
    return total


def _try(folder: Path, seed: int, numbered: tuple[int, bytes]) -> Outcome:
    number, raw = numbered
    outcome, name = Outcome(), f"mutant {number} of seed {seed}"
    path = folder / f"mutant_{os.getpid()}.h5"
    path.write_bytes(raw)
    out, err = io.StringIO(), io.StringIO()
    began_s = sum(os.times()[:4])  # a busy machine takes any time by the clock
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = run(["validate", str(path)])
    except Exception as error:
        outcome.faults.append(f"{name}: {type(error).__name__}: {error}")
        return outcome
    outcome.slowest_s = sum(os.times()[:4]) - began_s
    outcome.peak_bytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    outcome.codes[code] += 1
    lines = err.getvalue().splitlines()
    if code != 2 or len(lines) != 1:
        outcome.faults.append(f"{name}: code {code}, {len(lines)} lines on stderr")
    if any(not character.isprintable() for line in lines for character in line):
        outcome.faults.append(f"{name}: control characters on stderr")
    if outcome.slowest_s > MAX_S:
        outcome.faults.append(f"{name}: took {outcome.slowest_s:.1f} s")
    return outcome


def main() -> int:
    """Run a campaign of so many files as the command line says."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    outcome = campaign(count, 2, (os.cpu_count() or 1) + 1, lambda text: print(text, flush=True))
    mib = outcome.peak_bytes / 2**20
    print(f"{count} mutants: exit codes {dict(sorted(outcome.codes.items()))}")
    print(f"slowest {outcome.slowest_s:.1f} s, most memory {mib:.0f} MiB")
    print("\n".join(outcome.faults) or "no faults")
    return 1 if outcome.faults or outcome.peak_bytes > MAX_BYTES else 0


if __name__ == "__main__":
    sys.exit(main())
