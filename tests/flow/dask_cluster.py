"""A Dask cluster on this machine: scheduler and workers as processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_DASK = [sys.executable, "-m", "dask"]
_HERE = ["--host", "127.0.0.1", "--no-dashboard"]
_SAID = "Scheduler at:"
_SET = {"OPENBLAS_NUM_THREADS": "1", "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
"""As docs/engineer.md has workers started."""


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, dict[str, subprocess.Popen[str]]]]:
    """Yield the scheduler's address and the worker processes by name, one thread each.

    The workers have no nanny: one that is killed stays dead.
    """
    with (folder / "dask.log").open("w") as log:
        scheduler = subprocess.Popen(
            [*_DASK, "scheduler", *_HERE, "--port", "0"], stderr=subprocess.PIPE, text=True
        )
        started = [scheduler]
        try:
            assert scheduler.stderr is not None
            line = next(line for line in scheduler.stderr if _SAID in line)
            address = line.split(_SAID)[1].strip()
            options = ["--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]
            command = [*_DASK, "worker", address, *options, *_HERE]
            named = {
                f"worker-{i}": subprocess.Popen(
                    [*command, "--name", f"worker-{i}"],
                    stdout=log,
                    stderr=log,
                    text=True,
                    env=os.environ | _SET,
                )
                for i in range(workers)
            }
            started += named.values()
            yield address, named
        finally:
            for process in reversed(started):
                process.kill()
                process.communicate()
