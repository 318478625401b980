"""Damaged logs of every format that loggers write, read whole: one line, bounded time and memory.

``python -m tests.daq.formats.mutations 2000`` makes as many of each format and prints what came of
them; it fails if any gives another error than a line, takes more than 5 s or adds more than 300 MB.
"""

from __future__ import annotations

import gzip
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from daq.errors import InputError
from daq.formats.log import read_log

from .loggers import write_logger_mf4
from .mixed import mixed
from .test_import_round_trips import write_with_python_can

MAX_S, MAX_GROWTH_KIB = 5.0, 300 << 10
_NUMBERS = (0, 1, 0x7F, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**45, 2**63 - 1, 2**64 - 1)


@dataclass(slots=True)
class Outcome:
    """Counts how the logs of a campaign ended."""

    ends: Counter[str] = field(default_factory=Counter)
    """How often logs were read whole, with losses, or refused."""
    faults: list[str] = field(default_factory=list)
    """What must not be: other errors, more than one line, too long, too large."""
    slowest_s: float = 0.0
    """Of all files."""


def seeds(folder: Path) -> dict[str, bytes]:
    """Return a small whole log of each format, one of them packed."""
    plain = [f for f in mixed(80) if not (f.fd or f.remote or f.error)]
    raw = {}
    for suffix in (".blf", ".asc", ".log", ".csv", ".trc"):
        path = folder / f"a{suffix}"
        write_with_python_can(path, plain)
        raw[suffix] = path.read_bytes()
    write_logger_mf4(folder / "a.mf4", mixed(80))
    raw[".mf4"] = (folder / "a.mf4").read_bytes()
    return raw | {"packed": gzip.compress(raw[".log"])}


def mutants(raw: bytes, count: int, seed: int) -> Iterator[bytes]:
    """Yield damaged copies; each has one to four mutations."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        damaged = bytearray(raw)
        for _ in range(rng.integers(1, 5)):
            _mutate(damaged, rng)
        yield bytes(damaged)


def _mutate(raw: bytearray, rng: np.random.Generator) -> None:
    at = int(rng.integers(max(len(raw) - 8, 1)))
    size = int(rng.integers(1, 64))
    match rng.integers(8):
        case 0 | 1:
            raw[at] ^= 1 << int(rng.integers(8))
        case 2 | 3:
            number = _NUMBERS[rng.integers(len(_NUMBERS))]
            width = (1, 2, 4, 8)[rng.integers(4)]
            raw[at : at + width] = (number % (1 << 8 * width)).to_bytes(width, "little")
        case 4:
            raw[at : at + size] = bytes(size)
        case 5:
            other = int(rng.integers(max(len(raw) - 64, 1)))
            raw[at : at + size] = raw[other : other + size]
        case 6:
            del raw[at : at + size]
        case _:
            raw[int(rng.integers(min(len(raw), 4096)))] = int(rng.integers(256))


def campaign(count: int, seed: int = 1) -> Outcome:
    """Read `count` damaged logs of each format."""
    outcome = Outcome()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mutant"
        for name, raw in seeds(Path(folder)).items():
            for number, damaged in enumerate(mutants(raw, count, seed)):
                path.write_bytes(damaged)
                attempt(path, f"{name} {number} of seed {seed}", outcome)
    return outcome


def attempt(path: Path, name: str, outcome: Outcome) -> None:
    """Read a log to its end, and note what came of it."""
    began = time.monotonic()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        if path.stat().st_size:
            log = read_log(path)
            for batch in log:
                batch.t_ns.sum()
            outcome.ends["read with losses" if log.loss.any else "read"] += 1
    except InputError as error:
        outcome.ends["refused"] += 1
        if not str(error).isprintable():
            outcome.faults.append(f"{name}: {str(error)!r}")
    except Exception as error:
        outcome.faults.append(f"{name}: {type(error).__name__}: {error}")
    took_s = time.monotonic() - began
    outcome.slowest_s = max(outcome.slowest_s, took_s)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    if took_s > MAX_S or grown > MAX_GROWTH_KIB:
        outcome.faults.append(f"{name}: took {took_s:.1f} s and {grown >> 10} MiB")


def main() -> int:
    """Run a campaign of so many files a format as the command line says."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    outcome = campaign(count, seed=2)
    print(f"{count} mutants a format: {dict(outcome.ends)}, slowest {outcome.slowest_s:.1f} s")
    print("\n".join(outcome.faults[:20]) or "no faults")
    return 1 if outcome.faults else 0


if __name__ == "__main__":
    sys.exit(main())
