"""Damaged logs, columns and session files of every format: one line, bounded time and memory.

``python -m tests.daq.test_mutations 2000`` reads as many of each format and prints the outcomes.
It fails if any gives another error than a line, prints, ends or holds up its process (a library may
with MF4 and MAT), or if a session file is read though it was changed.
"""

from __future__ import annotations

import contextlib
import io
import logging
import multiprocessing
import os
import resource
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from daq.formats.columns import read_columns
from daq.formats.log import Log
from daq.session import write_session
from dbc.words import InputError
from tui.cli import run

from .formats.channel_files import WRITERS, Tables
from .formats.mixed import mixed
from .formats.test_logs import write_with_python_can
from .small_session import small_session

MAX_S, MAX_BYTES = 20.0, 3 << 30
"""Time of one file, s, and memory of the process that reads it, bytes."""
_NUMBERS = (0, 1, 0x7F, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**45, 2**63 - 1, 2**64 - 1)
_END = 88
"""Bytes at the end of a session file in which its checksum stands."""

Reader = Callable[[Path], str]


def log(path: Path) -> str:
    """Read a log to its end."""
    found = Log([path])
    for batch in found:
        batch.t_ns.sum()
    return "read with losses" if found.loss.any else "read"


def columns(path: Path) -> str:
    """Read all columns of a file."""
    read_columns(path, ())
    return "read"


def session(path: Path) -> str:
    """Validate a session file by the command, which refuses every changed one in a line."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(["validate", str(path)])
    lines = err.getvalue().splitlines()
    refused = code == 2 and len(lines) == 1 and lines[0].isprintable()
    return "refused" if refused else f"fault: code {code}, {len(lines)} lines"


def seeds(folder: Path) -> dict[str, tuple[bytes, Reader]]:
    """Return a small whole file of each format, and what reads it."""
    found: dict[str, tuple[bytes, Reader]] = {}
    plain = [f for f in mixed(80) if not (f.fd or f.remote or f.error)]
    for suffix in (".blf", ".asc", ".log", ".csv", ".trc"):
        write_with_python_can(folder / f"a{suffix}", plain)
        found[f"log {suffix}"] = (folder / f"a{suffix}").read_bytes(), log
    write_with_python_can(folder / "a.mf4", mixed(80))
    found["log .mf4"] = (folder / "a.mf4").read_bytes(), log
    time_s = np.arange(60) * np.float64(0.005)
    imu, hub = {"az": np.cos(time_s), "roll": np.sin(time_s)}, {"fl": time_s[::2] ** 2}
    tables: Tables = {"IMU": (time_s, imu), "HUB": (time_s[::2], hub)}
    for suffix, (_, write) in WRITERS.items():
        write(tables, folder / f"b{suffix}")
        found[f"columns {suffix}"] = (folder / f"b{suffix}").read_bytes(), columns
    write_session(folder / "c.h5", small_session())
    found["session"] = (folder / "c.h5").read_bytes(), session
    return found


def mutants(raw: bytes, count: int, seed: int, keep: int = 0) -> Iterator[bytes]:
    """Yield damaged copies, each with one to four mutations; the last `keep` bytes stay."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        damaged = bytearray(raw)
        while damaged == raw:
            for _ in range(rng.integers(1, 5)):
                _mutate(damaged, rng, keep)
        yield bytes(damaged)


def _mutate(raw: bytearray, rng: np.random.Generator, keep: int) -> None:
    n = max(len(raw) - max(keep, 64), 1)
    place, other, size = int(rng.integers(n)), int(rng.integers(n)), int(rng.integers(1, 64))
    match rng.integers(8):
        case 0 | 1:
            raw[place] ^= 1 << int(rng.integers(8))
        case 2 | 3:
            number = _NUMBERS[rng.integers(len(_NUMBERS))]
            width = (1, 2, 4, 8)[rng.integers(4)]
            raw[place : place + width] = (number % (1 << 8 * width)).to_bytes(width, "little")
        case 4:
            raw[place : place + size] = bytes(size)
        case 5:
            raw[place : place + size] = raw[other : other + size]
        case 6 if not keep:
            del raw[place : place + size]
        case _:  # the start of a file has the structures that everything hangs on
            raw[int(rng.integers(min(n, 4096)))] = int(rng.integers(256))


def attempt(reader: Reader, path: Path) -> str:
    """Read one file and return what came of it."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            end = reader(path)
        return f"fault: prints {printed.getvalue()[:99]!r}" if printed.getvalue() else end
    except InputError as error:
        return "refused" if str(error).isprintable() else f"fault: {str(error)!r}"
    except Exception as error:
        return f"fault: {type(error).__name__}: {error}"


def _prepare() -> None:
    warnings.simplefilter("ignore")
    logging.disable()
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())  # libraries talk
    resource.setrlimit(resource.RLIMIT_AS, (MAX_BYTES, MAX_BYTES))


def campaign(count: int, seed: int, report: Callable[[str], None] = lambda _: None) -> list[str]:
    """Read `count` damaged files of each format; return what must not be."""
    fork = multiprocessing.get_context("fork")
    faults = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (raw, reader) in seeds(Path(folder)).items():
            path, ends, pool = Path(folder) / "mutant", Counter[str](), fork.Pool(1, _prepare)
            keep = _END if reader is session else 0
            for number, damaged in enumerate(mutants(raw, count, seed, keep)):
                path.write_bytes(damaged)
                try:
                    end = pool.apply_async(attempt, (reader, path)).get(MAX_S)
                except multiprocessing.TimeoutError:
                    # Some of asammdf's and SciPy's compiled code does not check what it reads.
                    library = name.endswith((".mf4", ".mat"))
                    end = "ended" if library else "fault: its process ended, or was held up"
                    pool.terminate()
                    pool = fork.Pool(1, _prepare)
                ends[end.partition(":")[0]] += 1
                if end.startswith("fault"):
                    faults.append(f"{name} {number} of seed {seed}: {end}")
            pool.terminate()
            report(f"{name}: {dict(ends)}")
    return faults


def main() -> int:
    """Run a campaign of so many files a format as the command line says."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    faults = campaign(count, 2, lambda text: print(text, flush=True))
    print("\n".join(faults[:20]) or "no faults")
    return 1 if faults else 0


# Every format reads its whole file, and refuses or reads damaged ones in one line ---------------


@pytest.mark.filterwarnings("ignore")
def test_whole_and_damaged_files_of_every_format(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for name, (raw, reader) in seeds(tmp_path).items():
        path.write_bytes(raw)
        if reader is not session:
            assert attempt(reader, path).startswith("read"), name
        for damaged in [raw[: len(raw) // 2], *mutants(raw, 2, 1, _END * (reader is session))]:
            path.write_bytes(damaged)
            assert attempt(reader, path) in ("read", "read with losses", "refused"), name


if __name__ == "__main__":
    sys.exit(main())
