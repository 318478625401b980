"""The child of `read_columns`: reads some columns of one file and sends them to stdout.

Run as ``python -I -m daq.formats.columns.child FILE MAX_BYTES MAX_S NAMES``; NAMES is a JSON list,
empty for all columns.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...session.sandbox.child import limit
from ...session.sandbox.wire import send_error, send_tree
from ...session.tree import Dataset, Group
from .open_file import open_columns
from .opened import MAX_VALUES, ColumnFile, Heading, bounded, found

DAMAGED_ADVICE = "the file is damaged, cut off, or of another kind"
_MAX_FILE_BYTES = 4096
"""Largest file that this process may write, bytes: asammdf tests where it can write temporary
files."""
_MOST_PROPOSED = 2000
"""Largest number of columns of a file from which a map is proposed."""


def main(out: BinaryIO, path: str, max_bytes: int, max_s: int, names: Sequence[str]) -> None:
    """Read columns within limits and send them, or the reason of a failure."""
    limit(max_bytes, max_s, _MAX_FILE_BYTES)
    warnings.simplefilter("ignore")
    try:
        tree = read_tree(path, names)
    except InputError as error:
        send_error(out, error)
    else:
        send_tree(out, tree)


def read_tree(path: str, names: Sequence[str]) -> Group:
    """Return columns of a file as `columns_tree` does; raises InputError for every failure."""
    try:
        # asammdf prints its problems; stdout is for the columns.
        with redirect_stdout(StringIO()), open_columns(Path(path)) as file:
            return columns_tree(file, names, path)
    except InputError:
        raise
    except Exception as error:  # libraries raise many kinds of errors on a damaged file
        what = f"cannot be read: {_reason(error)}"
        raise InputError(path, what, DAMAGED_ADVICE) from error


def _reason(error: Exception) -> str:
    """Return the first line of an exception's text, or its kind."""
    lines = str(error).splitlines()
    return lines[0][:200] if lines and lines[0].strip() else type(error).__name__


def columns_tree(file: ColumnFile, names: Sequence[str], where: str) -> Group:
    """Return columns and the times of their clocks as a tree of datasets.

    `names`: the columns; empty for all.
    """
    if not file.headings:
        raise InputError(where, "has no column of numbers", "name a file of channels")
    if names:
        wanted = {name: found(file.headings, name, where) for name in names}
    else:
        some = file.headings[:_MOST_PROPOSED]
        wanted = {each.name: each for each in some}
    headings = list({each.name: each for each in wanted.values()}.values())
    bounded(headings, where)
    values = file.read(headings)
    columns = {
        str(i): _dataset(values[heading.name], replace(heading, samples=0), name)
        for i, (name, heading) in enumerate(wanted.items())
    }
    clocks = dict.fromkeys(heading.clock for heading in headings)
    times = ((clock, file.times(clock)) for clock in clocks)
    own = {
        str(i): Dataset(time_s, {"clock": clock})
        for i, (clock, time_s) in enumerate(times)
        if time_s is not None
    }
    return Group(
        {"start_ns": file.start_ns},
        {"columns": Group({}, {}, columns), "clocks": Group({}, {}, own)},
        {},
    )


def _dataset(values: NDArray[Any], heading: Heading, name: str) -> Dataset:
    if values.dtype.kind not in "iuf" or values.ndim != 1:
        raise InputError(heading.name, "is not a column of numbers", "name another")
    if len(values) > MAX_VALUES:
        raise InputError(heading.name, f"has {len(values)} values", "cut the file")
    about = {"asked": name, "name": heading.name, "unit": heading.unit, "clock": heading.clock}
    return Dataset(np.ascontiguousarray(values, values.dtype.newbyteorder("=")), about)


if __name__ == "__main__":
    main(
        sys.stdout.buffer, sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), json.loads(sys.argv[4])
    )
