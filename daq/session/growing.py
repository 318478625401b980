"""Writes a session file run by run, before the verdicts on the runs are known.

The measured data of a run are written once and never change, so that they need not be read or
packed again when the next run is added.  A file that grew over hours and one that was written at
once are the same, byte for byte: both are made by the same steps.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py

from ..runs import Run
from ..sessions import Session
from .write import check_names, write_head, write_provenance, write_run, write_verdict

_SPARE_BYTES = 4 << 20
"""Free space required on the disk in addition to the written data, bytes."""
_CACHE = {"rdcc_nslots": 1, "rdcc_nbytes": 0}
"""Settings without a cache for chunks: they are packed here, and HDF5 would allocate 64 KB for each
dataset."""


def begin_session(path: Path, session: Session) -> None:
    """Write a new file with a session without its runs; an existing file is overwritten.

    Raises OSError if the disk has no room or fails, and InputError as `write_session`.
    """
    check_names(session, ())
    _check_room(path, 0)
    path.open("wb").close()  # HDF5 would report a refusal in its own words
    with h5py.File(path, "w", **_CACHE) as file:
        write_head(file, session)


def add_run(path: Path, number: int, run: Run, session: Session) -> None:
    """Write the measured data of a run; `number` counts from one.  Raises as `begin_session`."""
    check_names(session, (run,))
    _check_room(path, _run_bytes(run))
    with h5py.File(path, "r+", **_CACHE) as file:
        write_run(file, number, run, session.channels)


def finish_session(path: Path, runs: Sequence[Run], provenance: Mapping[str, str]) -> None:
    """Write the verdict on each run, and the provenance.

    `runs`: in order; their groups, frames and events are not used.  Raises as `begin_session`.
    """
    _check_room(path, 0)
    with h5py.File(path, "r+", **_CACHE) as file:
        for number, run in enumerate(runs, start=1):
            write_verdict(file, number, run)
        write_provenance(file, provenance)


def _run_bytes(run: Run) -> int:
    samples = sum(v.nbytes for group in run.groups for v in group.values.values())
    return samples + 2 * run.frames.data.nbytes + 16 * len(run.frames)


def _check_room(path: Path, size: int) -> None:
    """Raise OSError if the disk is full, because HDF5 crashes the process in this case."""
    if shutil.disk_usage(path.parent).free < size + _SPARE_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
