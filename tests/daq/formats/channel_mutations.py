"""Damaged files of channels and damaged exports: one line, bounded time and memory.

``python -m tests.daq.formats.channel_mutations 2000`` makes as many of each format and prints what
came of them.  They are read in a process with the limits that the product gives its own; if that
process ends, it is a fault of an export alone, for channels are read in a child in any case.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from io import StringIO
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError
from daq.formats.columns import read_columns
from daq.formats.description import sidecar_of
from daq.formats.export import export_session, format_of
from daq.formats.exported import exported_session

from ..small_session import small_session
from .channel_files import WRITERS, Tables
from .logged_session import logged_session
from .mutations import Outcome, mutants

MAX_S, MAX_BYTES = 20.0, 3 << 30
"""Time of one file and memory of the process, as the child of `read_columns` has them."""
_EXPORTS = (".mf4", ".mat", ".parquet", ".uff", ".csv", ".log")

Case = tuple[str, bool]
"""Suffix, and whether it is an export."""


def cases() -> tuple[Case, ...]:
    """Return every format that is read."""
    return (*((suffix, False) for suffix in WRITERS), *((suffix, True) for suffix in _EXPORTS))


def whole(case: Case, folder: Path) -> Path:
    """Write a whole file of a format and return the file that is to be damaged."""
    suffix, is_export = case
    path = folder / f"car{suffix}"
    if is_export:
        session = logged_session() if suffix == ".log" else small_session()
        export_session(session, path, format_of(path))
        return sidecar_of(path) if suffix in (".csv", ".log") else path
    time_s: NDArray[np.float64] = np.arange(60) * np.float64(0.005)
    tables: Tables = {
        "IMU": (time_s, {"az": np.cos(time_s), "roll": np.sin(time_s)}),
        "HUB": (time_s[::2], {"fl": time_s[::2] ** 2}),
    }
    WRITERS[suffix][1](tables, path)
    return path


def read(case: Case, path: Path) -> str:
    """Read a file as the product does and say what came of it."""
    try:
        if not case[1]:
            read_columns(path, ())
        elif exported_session(path.with_name("car.log") if case[0] == ".log" else path) is None:
            return "no export"
    except InputError as error:
        return "refused" if str(error).isprintable() else f"fault: {str(error)!r}"
    except Exception as error:
        return f"fault: {type(error).__name__}: {error}"
    return "read"


def _work(case: Case, path: Path, files: Iterator[bytes], answers: Connection) -> None:
    """Read damaged files until there are no more, each in the place of the one before."""
    warnings.simplefilter("ignore")
    logging.disable()
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())  # libraries talk
    resource.setrlimit(resource.RLIMIT_AS, (MAX_BYTES, MAX_BYTES))
    for damaged in files:
        path.write_bytes(damaged)
        printed = StringIO()
        with redirect_stdout(printed):
            end = read(case, path)
        answers.send("fault: prints" if printed.getvalue() else end)
    answers.send("")


def campaign(count: int, seed: int, report: Callable[[str], None]) -> Outcome:
    """Read `count` damaged files of each format."""
    total = Outcome()
    for case in cases():
        outcome = Outcome()
        with tempfile.TemporaryDirectory() as folder:
            _one_format(case, whole(case, Path(folder)), count, seed, outcome)
        name = f"{'export' if case[1] else 'channels'} {case[0]}"
        report(f"{name}: {dict(outcome.ends)}, slowest {outcome.slowest_s:.1f} s")
        total.ends += outcome.ends
        total.slowest_s = max(total.slowest_s, outcome.slowest_s)
        total.faults += [f"{name} {fault}" for fault in outcome.faults]
    return total


def _one_format(case: Case, path: Path, count: int, seed: int, outcome: Outcome) -> None:
    files = list(mutants(path.read_bytes(), count, seed))
    fork = multiprocessing.get_context("fork")
    number = 0
    while number < count:
        receive, send = fork.Pipe(duplex=False)
        worker = fork.Process(target=_work, args=(case, path, iter(files[number:]), send))
        worker.start()
        send.close()
        end = ""
        while number < count:
            began = time.monotonic()
            end = _answer(receive)
            took_s = time.monotonic() - began
            outcome.slowest_s = max(outcome.slowest_s, took_s)
            outcome.ends[end.partition(":")[0]] += 1
            if end.startswith("fault") or (case[1] and end in ("ended", "hung")):
                outcome.faults.append(f"{number} of seed {seed}: {end}")
            number += 1
            if end in ("ended", "hung"):
                break
        if end == "hung":
            worker.kill()
        worker.join()


def _answer(receive: Connection) -> str:
    try:
        return str(receive.recv()) if receive.poll(MAX_S) else "hung"
    except EOFError:
        return "ended"


def main() -> int:
    """Run a campaign of so many files a format as the command line says."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    outcome = campaign(count, 2, lambda text: print(text, flush=True))
    print(f"{count} mutants a format: {dict(outcome.ends)}, slowest {outcome.slowest_s:.1f} s")
    print("\n".join(outcome.faults[:20]) or "no faults")
    return 1 if outcome.faults else 0


if __name__ == "__main__":
    sys.exit(main())
