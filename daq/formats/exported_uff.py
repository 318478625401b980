"""Reads back a session from a universal file and the description next to it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..sessions import Session
from .description import Columns, Description, GroupDescription, RunDescription, session_of

_HEAD_LINES = 11
_MAX_RECORD_BYTES = 1 << 31


def read_exported_uff(path: Path, about: Description) -> Session:
    """Return the session in a universal file; samples that it does not hold are missing values.

    Raises InputError if it is damaged.
    """
    records = {(title, name): (time_s, values) for name, title, time_s, values in _records(path)}

    def samples(run: RunDescription, group: GroupDescription) -> Columns:
        title = f"{run.label} {group.name} ({run.status})"
        found = {name: records[title, name] for name in group.channels if (title, name) in records}
        if not found:
            raise ValueError(f"{run.label}/{group.name} has no record")
        time_s = np.unique(np.concatenate([times for times, _ in found.values()]))
        values = {}
        for name in group.channels:
            values[name] = np.full(len(time_s), np.nan)
            if name in found:
                values[name][np.searchsorted(time_s, found[name][0])] = found[name][1]
        return time_s, None, values

    return session_of(about, samples, str(path))


def _records(path: Path) -> Iterator[tuple[str, str, NDArray[np.float64], NDArray[np.float64]]]:
    """Yield name, title, times and values of each dataset 58 in binary form."""
    with path.open("rb") as file:
        while line := file.readline(256):
            if b"\0" in line:
                raise InputError(str(path), "has content that is not a dataset", "export it again")
            if not line.startswith(b"    58b"):
                continue
            size = int(line[31:43])
            if not 0 <= size < _MAX_RECORD_BYTES:
                raise InputError(str(path), f"a record claims {size} bytes", "export it again")
            head = [file.readline(256).decode("ascii", "replace") for _ in range(_HEAD_LINES)]
            data = file.read(size)
            if len(data) < size:
                raise InputError(str(path), "is cut off", "get the whole file")
            form = head[6]
            even, start, step = int(form[20:30]), float(form[30:43]), float(form[43:56])
            cells = np.frombuffer(data, "<f8")
            if even:
                time_s = (start + step * np.arange(len(cells))).astype(np.float64)
                yield head[0].strip(), head[1].strip(), time_s, cells
            else:
                pairs = cells.reshape(-1, 2)
                yield head[0].strip(), head[1].strip(), pairs[:, 0], pairs[:, 1]
