"""Reads columns of files of other tools, in a child process with limits of memory and time."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ...samples.columns import Column, Columns
from ...session.sandbox.guard import Reader, read_guarded
from ...session.tree import Group

_MAX_BYTES = 1 << 30
"""Largest size of the arrays that a child may send, bytes: the values of a file, and their
times."""
_MAX_FILE_BYTES = 2 << 30
"""File size, bytes, up to which the time limit of the child grows with the size of its file."""
_READER = Reader(
    "daq.formats.columns.child",
    "the library of its format",
    3 << 30,  # pandas, pyarrow and asammdf reserve much memory and use little
    20,
    "the file is damaged, cut off, or of another kind",
)


def read_columns(path: Path, names: Sequence[str]) -> Columns:
    """Return columns of a CSV, MF4, MAT, TDMS, Parquet or HDF5 file.

    `names`: in full, or from a slash to the end; empty for all columns of numbers.  Raises
    InputError if the file cannot be read within limits, or does not have exactly one column of a
    name.
    """
    size = min(path.stat().st_size, _MAX_FILE_BYTES) if path.is_file() else 0
    tree = read_guarded(_READER, str(path), [json.dumps(list(names))], size, _MAX_BYTES)
    return columns_of(tree, str(path))


def columns_of(tree: Group, where: str) -> Columns:
    """Return the columns in a tree of `child.columns_tree`; `where`: the file, for messages."""
    columns = {
        str(item.attributes["asked"]): Column(
            str(item.attributes["name"]),
            str(item.attributes["unit"]),
            str(item.attributes["clock"]),
            item.values,
        )
        for item in tree.groups["columns"].datasets.values()
    }
    times_s = {
        str(item.attributes["clock"]): item.values
        for item in tree.groups["clocks"].datasets.values()
    }
    return Columns(where, int(str(tree.attributes["start_ns"])), columns, times_s)
