"""Reads columns of a file, in the format that its content shows."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from dbc.errors import printable

from ...errors import InputError
from ...samples.columns import Column, Columns
from .csv_table import open_csv
from .matlab5 import open_matlab5
from .mdf import open_mdf_channels
from .opened import ColumnFile, bounded, found
from .parquet import open_parquet

NAMES = "CSV, MF4, MAT, Parquet"
"""Names of the formats, for messages."""
_MAGIC: dict[bytes, Callable[[Path], AbstractContextManager[ColumnFile]]] = {
    b"PAR1": open_parquet,
    b"MDF     ": open_mdf_channels,
    b"MATLAB 5.0": open_matlab5,
}
_HEAD_BYTES = 4096
_MOST_PROPOSED = 2000
"""Largest number of columns of a file from which a map is proposed."""


def read_columns(path: Path, names: Sequence[str]) -> Columns:
    """Return columns of a CSV, MF4, MAT or Parquet file.

    `names`: in full, or from a slash to the end; empty for all columns of numbers.  Raises
    InputError if the file cannot be read, or does not have exactly one column of a name.
    """
    where = str(path)
    try:
        with warnings.catch_warnings(), open_columns(path) as file:
            warnings.simplefilter("ignore")
            return _columns(file, names, where)
    except InputError:
        raise
    except Exception as error:  # libraries raise many kinds of errors on a damaged file
        lines = str(error).strip().splitlines() or [type(error).__name__]
        advice = "the file is damaged, cut off, or of another kind"
        what = f"cannot be read: {printable(lines[0], 200)}"
        raise InputError(where, what, advice) from error


def _columns(file: ColumnFile, names: Sequence[str], where: str) -> Columns:
    if not file.headings:
        raise InputError(where, "has no column of numbers", "name a file of channels")
    wanted = {each.name: each for each in file.headings[:_MOST_PROPOSED]}
    if names:
        wanted = {name: found(file.headings, name, where) for name in names}
    headings = list({each.name: each for each in wanted.values()}.values())
    bounded(headings, where)
    values = file.read(headings)
    columns = {}
    for name, heading in wanted.items():
        column = values[heading.name]
        if column.dtype.kind not in "iuf" or column.ndim != 1:
            raise InputError(heading.name, "is not a column of numbers", "name another")
        native = np.ascontiguousarray(column, column.dtype.newbyteorder("="))
        columns[name] = Column(heading.name, heading.unit, heading.clock, native)
    clocks = dict.fromkeys(heading.clock for heading in headings)
    times = {clock: file.times(clock) for clock in clocks}
    stated = {clock: time_s for clock, time_s in times.items() if time_s is not None}
    unread = tuple(file.unread) if names else ()
    return Columns(where, file.start_ns, columns, stated, unread)


def open_columns(path: Path) -> AbstractContextManager[ColumnFile]:
    """Return a file of columns, to be used in a `with` statement.

    Raises InputError if it is missing, empty or of no known kind.
    """
    where = str(path)
    if not path.is_file():
        what = "is not a regular file" if path.exists() else "no such file"
        raise InputError(where, what, f"name a file of channels: {NAMES}")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise InputError(where, what, "check rights and disk") from error
    if not head:
        raise InputError(where, "is empty", "check that it is the right file")
    if head.startswith(b"UnFinMF "):
        what = "was not finished by its logger"
        raise InputError(where, what, "finish it with the logger's tool, or import its bus log")
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise InputError(where, "is HDF5, not a table", "save a MAT with -v7, or a Parquet table")
    for magic, opener in _MAGIC.items():
        if head.startswith(magic):
            return opener(path)
    return open_csv(path)
