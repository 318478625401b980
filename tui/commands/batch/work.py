"""Identifies one session file in a worker."""

from __future__ import annotations

from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache
from hashlib import file_digest
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from traceback import extract_tb

from dbc import BumpbenchError
from dbc.errors import printable
from identify.batch import Cell

from .places import local_copy, opened

FAILED = "failed"
"""Verdict of a session that has no identification."""


@dataclass(frozen=True, slots=True)
class Job:
    """One session file."""

    file: str
    """Absolute path, as a cluster's workers have other working directories, or an address."""
    sha256: str
    """Hash of its content; empty if it cannot be read."""


def job_of(file: str) -> Job:
    """Return a file with the hash of its content."""
    try:
        with opened(file) as stream:
            return Job(file, file_digest(stream, "sha256").hexdigest())
    except OSError:
        return Job(file, "")  # the row says why


@cache
def software() -> str:
    """Return the versions on which the results depend."""
    return f"bumpbench {version('bumpbench')}"


def row_of(job: Job) -> dict[str, Cell]:
    """Read and identify a session, and return its row; any error becomes its reason."""
    from daq import read_samples
    from identify.batch import session_row

    began_s = perf_counter()
    try:
        with local_copy(job.file) as path:
            try:
                row = session_row(read_samples(path))
            except BumpbenchError as error:
                row = _failed(str(error).removeprefix(f"{path}: "))  # the row names the file
    except Exception as error:  # one strange session of thousands must not stop the others
        last = extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.lineno}"
        row = _failed(f"{type(error).__name__} in {where}: {error}")
    return _with_provenance(job, row, perf_counter() - began_s)


def row_of_lost(job: Job, future: Future[dict[str, Cell]]) -> dict[str, Cell]:
    """Return the row of a session whose worker could not answer."""
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        row = _failed("its worker process died, most likely for want of memory")
    else:
        row = _failed(f"its worker failed: {type(error).__name__}: {error}")
    return _with_provenance(job, row, 0.0)


def _failed(reason: str) -> dict[str, Cell]:
    return {"verdict": FAILED, "reasons": printable(reason, 800)}


def _with_provenance(job: Job, row: dict[str, Cell], seconds: float) -> dict[str, Cell]:
    import numpy as np
    import scipy

    return {
        # A table holds UTF-8 only, which the name of a file need not be.
        "file": job.file.encode("utf-8", "backslashreplace").decode(),
        "sha256": job.sha256,
        **row,
        "seconds": round(seconds, 3),
        "software": software(),
        "libraries": f"numpy {np.__version__}, scipy {scipy.__version__}",
    }
