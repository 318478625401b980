"""A Dask cluster on this machine: scheduler and workers as processes of their own."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_DASK = [sys.executable, "-m", "dask"]
_QUIET = ["--no-dashboard"]


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Yield the scheduler's address and the worker processes, one thread each.

    The workers have no nanny: one that is killed stays dead.
    """
    file = folder / "scheduler.json"
    with (folder / "dask.log").open("wb") as log:
        where = ["--scheduler-file", str(file)]
        here = ["--host", "127.0.0.1", "--port", "0"]
        processes = [
            subprocess.Popen([*_DASK, "scheduler", *where, *here, *_QUIET], stdout=log, stderr=log)
        ]
        try:
            while not file.exists():
                assert processes[0].poll() is None, (folder / "dask.log").read_text()
                time.sleep(0.02)
            options = ["--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]
            worker = [*_DASK, "worker", *where, *options, "--host", "127.0.0.1", *_QUIET]
            processes += [subprocess.Popen(worker, stdout=log, stderr=log) for _ in range(workers)]
            yield json.loads(file.read_text())["address"], processes[1:]
        finally:
            for process in reversed(processes):
                process.kill()
                process.wait()
