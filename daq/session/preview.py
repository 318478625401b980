"""Reads the outlines of session files for a list: attributes only, in a process with limits.

Run as ``python -I -m daq.session.preview FILE...``, it writes one line of JSON for each file.  If a
file makes libhdf5 crash or hang, the child ends; the parent reports this for the file and starts
another child at the next file, so that many valid files need only one start of Python.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import h5py

from ..errors import InputError
from ..remarks import notes_of
from .load import open_session, plain_attributes
from .schema import DAMAGED_ADVICE

_FILE_S = 4
"""Longest wall-clock time for one file, s."""
_BYTES = 1 << 30
_MAX_RUNS = 10_000


@dataclass(frozen=True, slots=True)
class Glance:
    """The outline of one session file."""

    path: str
    vehicle: str
    """Name of the vehicle as stated in the file; foreign text."""
    created: str
    """Time of creation as stated in the file; foreign text."""
    accepted: int
    """Number of accepted runs."""
    rejected: int
    """Number of rejected runs."""
    notes: str = ""
    """Notes on the session, one per line."""


def glances(paths: Sequence[Path]) -> Iterator[Glance | InputError]:
    """Yield the outline of each file in order, or the reason why there is none."""
    left = [str(path) for path in paths]
    while left:
        with subprocess.Popen(
            [sys.executable, "-I", "-m", "daq.session.preview", *left],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "HDF5_PLUGIN_PRELOAD": "::"},
        ) as child:
            assert child.stdout is not None
            try:
                for text in child.stdout:
                    body = json.loads(text)
                    left.pop(0)
                    yield InputError(*body["error"]) if "error" in body else Glance(**body)
            finally:
                child.kill()
        if left:
            what = "cannot be read: HDF5 crashes on it or takes too long"
            yield InputError(left.pop(0), what, DAMAGED_ADVICE)


def glance(path: Path) -> Glance:
    """Read the outline of a session file in this process.

    Raises InputError if it is not a session.
    """
    with open_session(path) as file:
        about = plain_attributes(_member(file, "session").id)
        folder = _member(file, "runs")
        runs = [plain_attributes(_member(folder, name).id) for name in islice(folder, _MAX_RUNS)]
    accepted = sum(run.get("status") == "accepted" for run in runs)
    return Glance(
        str(path),
        str(about.get("vehicle", "")),
        str(about.get("provenance_created", "")),
        accepted,
        len(runs) - accepted,
        "\n".join(notes_of({"notes": str(about.get("provenance_notes", ""))})),
    )


def _member(group: h5py.Group, name: str) -> h5py.Group:
    """Return a group that is in this file, because a link could lead to another file."""
    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        raise ValueError(f"{name} is absent or a link")
    return group[name]


def _main(paths: Sequence[str]) -> None:
    with suppress(ModuleNotFoundError):  # Windows has neither limits nor alarm
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    alarm = getattr(signal, "alarm", lambda seconds: None)
    for path in paths:
        alarm(_FILE_S)
        body: dict[str, Any]
        try:
            body = asdict(glance(Path(path)))
        except InputError as error:
            body = {"error": [error.where, error.what, error.advice]}
        except Exception as error:  # h5py raises many kinds of errors on a damaged file
            body = {"error": [path, f"is damaged: {type(error).__name__}", DAMAGED_ADVICE]}
        sys.stdout.write(json.dumps(body) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    _main(sys.argv[1:])
