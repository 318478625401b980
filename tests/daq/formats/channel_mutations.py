"""Damaged files of channels: one line, bounded time and memory.

``python -m tests.daq.formats.channel_mutations 2000`` makes as many of each format and prints what
came of them, read in a process with limits of time and memory.
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

from .channel_files import WRITERS, Tables
from .mutations import Outcome, mutants

MAX_S, MAX_BYTES = 20.0, 3 << 30
"""Time of one file and memory of the process."""


def whole(suffix: str, folder: Path) -> Path:
    """Write a whole file of a format and return it."""
    path = folder / f"car{suffix}"
    time_s: NDArray[np.float64] = np.arange(60) * np.float64(0.005)
    tables: Tables = {
        "IMU": (time_s, {"az": np.cos(time_s), "roll": np.sin(time_s)}),
        "HUB": (time_s[::2], {"fl": time_s[::2] ** 2}),
    }
    WRITERS[suffix][1](tables, path)
    return path


def read(path: Path) -> str:
    """Read a file as the product does and say what came of it."""
    try:
        read_columns(path, ())
    except InputError as error:
        return "refused" if str(error).isprintable() else f"fault: {str(error)!r}"
    except Exception as error:
        return f"fault: {type(error).__name__}: {error}"
    return "read"


def _work(path: Path, files: Iterator[bytes], answers: Connection) -> None:
    """Read damaged files until there are no more, each in the place of the one before."""
    warnings.simplefilter("ignore")
    logging.disable()
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())  # libraries talk
    resource.setrlimit(resource.RLIMIT_AS, (MAX_BYTES, MAX_BYTES))
    for damaged in files:
        path.write_bytes(damaged)
        printed = StringIO()
        with redirect_stdout(printed):
            end = read(path)
        answers.send("fault: prints" if printed.getvalue() else end)
    answers.send("")


def campaign(count: int, seed: int, report: Callable[[str], None]) -> Outcome:
    """Read `count` damaged files of each format."""
    total = Outcome()
    for suffix in WRITERS:
        outcome = Outcome()
        with tempfile.TemporaryDirectory() as folder:
            _one_format(whole(suffix, Path(folder)), count, seed, outcome)
        report(f"{suffix}: {dict(outcome.ends)}, slowest {outcome.slowest_s:.1f} s")
        total.ends += outcome.ends
        total.slowest_s = max(total.slowest_s, outcome.slowest_s)
        total.faults += [f"{suffix} {fault}" for fault in outcome.faults]
    return total


def _one_format(path: Path, count: int, seed: int, outcome: Outcome) -> None:
    files = list(mutants(path.read_bytes(), count, seed))
    fork = multiprocessing.get_context("fork")
    number = 0
    while number < count:
        receive, send = fork.Pipe(duplex=False)
        worker = fork.Process(target=_work, args=(path, iter(files[number:]), send))
        worker.start()
        send.close()
        end = ""
        while number < count:
            began = time.monotonic()
            end = _answer(receive)
            took_s = time.monotonic() - began
            outcome.slowest_s = max(outcome.slowest_s, took_s)
            outcome.ends[end.partition(":")[0]] += 1
            if end.startswith("fault"):
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
