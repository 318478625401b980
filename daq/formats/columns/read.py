"""Reads columns of a file, in the format that its content shows: CSV, MF4, MAT or Parquet."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import printable

from ...errors import InputError, optional
from ...samples.columns import Column, Columns
from ..mf4 import open_mdf
from .csv_table import read_csv
from .table import Choose, Heading, Table, bounded, named

NAMES = "CSV, MF4, MAT, Parquet"
"""Names of the formats, for messages."""
_MOST_PROPOSED = 2000
"""Largest number of columns of a file from which a map is proposed."""
_MOST_COLUMNS = 256
"""Largest number of columns of a MATLAB matrix that is a table."""
_DEEPEST = 12
"""Deepest nesting of MATLAB structs that is read."""
_UNIT_KEYS = (b"unit", b"units", b"Unit")


def read_columns(path: Path, names: Sequence[str]) -> Columns:
    """Return columns of a CSV, MF4, MAT or Parquet file.

    `names`: in full, or from a slash to the end; empty for all columns of numbers.  Raises
    InputError if the file cannot be read, or does not have exactly one column of a name.
    """
    where = str(path)
    wanted: dict[str, Heading] = {}  # by the name under which a column is returned

    def choose(headings: Sequence[Heading]) -> Sequence[Heading]:
        if not headings:
            raise InputError(where, "has no column of numbers", "name a file of channels")
        wanted.update({each.name: each for each in headings[:_MOST_PROPOSED]})
        if names:
            wanted.clear()
            wanted.update({name: named(headings, name, where) for name in names})
        chosen = list(dict.fromkeys(wanted.values()))
        bounded(sum(each.samples for each in chosen), where)
        return chosen

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table = _reader(path)(path, choose)
    except InputError:
        raise
    except Exception as error:  # libraries raise many kinds of errors on a damaged file
        lines = str(error).strip().splitlines() or [type(error).__name__]
        advice = "the file is damaged, cut off, or of another kind"
        what = f"cannot be read: {printable(lines[0], 200)}"
        raise InputError(where, what, advice) from error
    columns = {}
    for name, heading in wanted.items():
        values = table.values[heading.name]
        if values.dtype.kind not in "iuf" or values.ndim != 1:
            raise InputError(heading.name, "is not a column of numbers", "name another")
        native = np.ascontiguousarray(values, values.dtype.newbyteorder("="))
        columns[name] = Column(heading.name, heading.unit, heading.clock, native)
    unread = table.unread if names else ()
    return Columns(where, table.start_ns, columns, table.times_s, unread)


def _reader(path: Path) -> Callable[[Path, Choose], Table]:
    """Return what reads a file; raises InputError if it is missing, empty or of no known kind."""
    where = str(path)
    if not path.is_file():
        what = "is not a regular file" if path.exists() else "no such file"
        raise InputError(where, what, f"name a file of channels: {NAMES}")
    try:
        with path.open("rb") as file:
            head = file.read(16)
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
    readers = {b"PAR1": _read_parquet, b"MDF     ": _read_mdf, b"MATLAB 5.0": _read_matlab}
    return next((reader for magic, reader in readers.items() if head.startswith(magic)), read_csv)


def _read_parquet(path: Path, choose: Choose) -> Table:
    """Return columns of a Parquet table, all on one clock; times of day are in ns."""
    pa = optional("pyarrow", "data")
    kinds = (pa.types.is_timestamp, pa.types.is_floating, pa.types.is_integer)
    with optional("pyarrow.parquet", "data").ParquetFile(path) as file:
        rows = file.metadata.num_rows
        headings = [
            Heading(field.name, _parquet_unit(pa, field), "table", rows)
            for field in file.schema_arrow
            if any(is_kind(field.type) for is_kind in kinds)
        ]
        chosen = choose(headings)
        table = file.read(columns=[each.name for each in chosen], use_threads=False)
        return Table({each.name: _parquet_numbers(pa, table[each.name]) for each in chosen})


def _parquet_unit(pa: Any, field: Any) -> str:
    """Return the unit of a column: ns for times of day, else that in its metadata, "" for none."""
    if pa.types.is_timestamp(field.type):
        return "ns"
    about = field.metadata or {}
    texts = (about[key].decode("utf-8", "replace") for key in _UNIT_KEYS if key in about)
    return next(texts, "")


def _parquet_numbers(pa: Any, column: Any) -> NDArray[Any]:
    """Return a column as numbers; its gaps (nulls) are NaN."""
    if pa.types.is_timestamp(column.type):
        # Whole ns; where there are gaps, `to_numpy` makes float64 of them, in steps of 256 ns.
        column = column.cast(pa.timestamp("ns")).cast(pa.int64())
    elif column.null_count or pa.types.is_float16(column.type):
        column = column.cast(pa.float64())  # only floats have NaN; float16 has too few digits
    return np.asarray(column.to_numpy(zero_copy_only=False))


def _read_mdf(path: Path, choose: Choose) -> Table:
    """Return channels of an MDF file; those of a group have the times of its master."""
    with open_mdf(path, str(path)) as mdf, redirect_stdout(StringIO()):
        places: dict[str, tuple[int, int]] = {}
        headings, clocks = [], {}
        for number, group in enumerate(mdf.groups):
            about = group.channel_group
            source = getattr(about, "acq_source", None)
            name = getattr(about, "acq_name", "") or getattr(source, "name", "")
            name = name or f"group {number}"
            clock = f"{name} (group {number})"
            clocks[clock] = number
            for index, channel in enumerate(group.channels):
                full = f"{name}/{channel.name}"
                full = full if full not in places else f"{clock}/{channel.name}"
                if index == mdf.masters_db.get(number) or full in places:
                    continue
                places[full] = number, index
                rule = getattr(channel, "conversion", None)
                unit = str(channel.unit or getattr(rule, "unit", "") or "")
                headings.append(Heading(full, unit, clock, int(about.cycles_nr)))
        chosen = choose(headings)
        values = {}
        for each in chosen:
            group, index = places[each.name]
            signal = mdf.get(group=group, index=index, ignore_invalidation_bits=True)
            samples, invalid = np.asarray(signal.samples), signal.invalidation_bits
            if invalid is not None and samples.dtype.kind in "iuf":
                bits = np.asarray(getattr(invalid, "bits", invalid), bool)
                samples = np.where(bits, np.nan, samples)
            values[each.name] = samples
        times = {
            clock: np.asarray(mdf.get_master(number), np.float64)
            for clock, number in clocks.items()
            if number in mdf.masters_db and any(each.clock == clock for each in chosen)
        }
        start_ns = round(mdf.header.start_time.timestamp() * 1e6) * 1000
        return Table(values, times, max(start_ns, 0))


def _read_matlab(path: Path, choose: Choose) -> Table:
    """Return variables of a MATLAB file before 7.3: `struct/field`, and `name:2` of a matrix.

    An element of an array of structs is named by its `Name`, if it has one, else by its number.
    """
    from scipy.io import loadmat

    variables = loadmat(path, simplify_cells=True)
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in variables.items():
        if not name.startswith("__"):
            _collect(name, value, arrays, 0)
    headings = [
        Heading(name, _matlab_unit(name, variables), name.rpartition("/")[0], len(values))
        for name, values in arrays.items()
    ]
    return Table({each.name: arrays[each.name] for each in choose(headings)})


def _collect(name: str, value: Any, arrays: dict[str, NDArray[Any]], depth: int) -> None:
    """Add the columns in a variable to `arrays`, by their full names."""
    if depth > _DEEPEST:
        return
    if isinstance(value, dict):
        for key, item in value.items():
            _collect(f"{name}/{key}", item, arrays, depth + 1)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for number, item in enumerate(np.ravel(np.array(value, object)), start=1):
            if isinstance(item, dict):
                texts = (item[k] for k in ("Name", "name") if isinstance(item.get(k), str))
                _collect(f"{name}/{next(texts, number)}", item, arrays, depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        values = np.squeeze(value)
        if values.ndim == 1:
            arrays[name] = values
        elif values.ndim == 2 and min(values.shape) <= _MOST_COLUMNS:
            columns = values.T if values.shape[0] >= values.shape[1] else values
            arrays.update({f"{name}:{i + 1}": column for i, column in enumerate(columns)})


def _matlab_unit(name: str, variables: Mapping[str, Any]) -> str:
    """Return the unit of a column: from `x/units/channel`, or the `unit` of its struct."""
    *folders, last = name.split("/")
    node: Any = variables
    for folder in folders:
        node = node.get(folder) if isinstance(node, Mapping) else None
    if not isinstance(node, Mapping):
        return ""
    units = node.get("units", node.get("unit", node.get("Unit", "")))
    unit = units.get(last, "") if isinstance(units, Mapping) else units
    return unit if isinstance(unit, str) else ""
