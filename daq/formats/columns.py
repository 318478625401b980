"""Reads columns of numbers from files of other tools, by content: CSV, MF4, MAT or Parquet."""

from __future__ import annotations

import codecs
import csv
import re
import warnings
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.units import known_si
from dbc.words import InputError, counted, printable

from ..files import input_bytes
from ..samples.mapping import Column, Columns
from .mf4 import open_mdf
from .reader import optional

_UNREAD = np.zeros(0)
"""Values of a column that is not yet read."""
Choose = Callable[[Sequence[Column]], Sequence[Column]]
"""Chooses which of all columns of a file are read."""


def _column_named(headings: Sequence[Column], wanted: str, where: str) -> Column:
    """Return the column of a name, given in full or from a slash to the end.

    Raises InputError if there is not exactly one.
    """
    exact = [each for each in headings if each.name == wanted]
    matching = exact or [each for each in headings if each.name.endswith(f"/{wanted}")]
    if len(matching) == 1:
        return matching[0]
    quoted = printable(wanted, 100)
    if matching:
        full = printable(", ".join(each.name for each in matching[:4]), 300)
        raise InputError(where, f"has {len(matching)} columns {quoted!r}", f"write one of {full}")
    names = printable(", ".join(each.name for each in headings), 300)
    raise InputError(where, f"has no column {quoted!r}", f"it has {names}")


NAMES = "CSV, MF4, MAT, Parquet"
"""Names of the formats, for messages."""


def read_columns(path: Path, names: Sequence[str]) -> Columns:
    """Return columns of a CSV, MF4, MAT or Parquet file.

    `names`: in full, or from a slash to the end; empty for the first 2000 columns.  Raises
    InputError if the file cannot be read, or does not have exactly one column of a name.
    """
    where, head = str(path), input_bytes(path, f"name a file of channels: {NAMES}", 16)
    if head.startswith(b"UnFinMF "):
        what = "was not finished by its logger"
        raise InputError(where, what, "finish it with the logger's tool, or import its bus log")
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise InputError(where, "is HDF5, not a table", "save a MAT with -v7, or a Parquet table")
    readers = {b"PAR1": _read_parquet, b"MDF     ": _read_mdf, b"MATLAB 5.0": _read_matlab}
    read = next((read for magic, read in readers.items() if head.startswith(magic)), _read_csv)
    wanted: dict[str, Column] = {}  # by the name under which a column is returned; see `choose`

    def choose(headings: Sequence[Column]) -> Sequence[Column]:
        """Return the columns to read, each once, and remember them in `wanted`."""
        if not headings:
            raise InputError(where, "has no column of numbers", "name a file of channels")
        if names:
            wanted.update({name: _column_named(headings, name, where) for name in names})
        else:
            wanted.update({each.name: each for each in headings[:2000]})  # enough for a proposal
        return list(dict.fromkeys(wanted.values()))

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table = read(path, choose)
    except InputError:
        raise
    except Exception as error:  # libraries raise many kinds of errors on a damaged file
        lines = str(error).strip().splitlines() or [type(error).__name__]
        advice = "the file is damaged, cut off, or of another kind"
        what = f"cannot be read: {printable(lines[0], 200)}"
        raise InputError(where, what, advice) from error
    columns = {}
    for name, heading in wanted.items():
        values = table.columns[heading.name].values
        if values.dtype.kind not in "iuf" or values.ndim != 1:
            raise InputError(heading.name, "is not a column of numbers", "name another")
        native = np.ascontiguousarray(values, values.dtype.newbyteorder("="))
        columns[name] = replace(heading, values=native)
    # Without names the values are only looked through for a proposal: none is missed.
    return replace(table, columns=columns, unread=table.unread if names else ())


def _read_parquet(path: Path, choose: Choose) -> Columns:
    """Return columns of a Parquet table, all on one clock; times of day are in ns."""
    pa = optional("pyarrow", "data")
    kinds = (pa.types.is_timestamp, pa.types.is_floating, pa.types.is_integer)
    with optional("pyarrow.parquet", "data").ParquetFile(path) as file:
        headings = []
        for column in file.schema_arrow:
            if any(is_kind(column.type) for is_kind in kinds):
                metadata = column.metadata or {}
                units = [metadata[key] for key in (b"unit", b"units", b"Unit") if key in metadata]
                unit = units[0].decode("utf-8", "replace") if units else ""
                unit = "ns" if pa.types.is_timestamp(column.type) else unit
                headings.append(Column(column.name, unit, "table", _UNREAD))
        chosen = choose(headings)
        table = file.read(columns=[each.name for each in chosen], use_threads=False)
    columns = {}
    for each in chosen:
        column = table[each.name]
        if pa.types.is_timestamp(column.type):
            # Whole ns; where there are gaps, `to_numpy` makes float64 of them, in steps of 256 ns.
            column = column.cast(pa.timestamp("ns")).cast(pa.int64())
        elif column.null_count or pa.types.is_float16(column.type):
            column = column.cast(pa.float64())  # only floats have NaN; float16 has too few digits
        values = np.asarray(column.to_numpy(zero_copy_only=False))
        columns[each.name] = replace(each, values=values)
    return Columns(str(path), 0, columns, {})


def _read_mdf(path: Path, choose: Choose) -> Columns:
    """Return channels of an MDF file; those of a group have the times of its master."""
    with open_mdf(path, str(path)) as mdf, redirect_stdout(StringIO()):
        numbers: dict[str, tuple[int, int]] = {}  # of group and channel, by full name
        headings, clocks = [], {}
        for number, group in enumerate(mdf.groups):
            name = getattr(group.channel_group, "acq_name", "") or f"group {number}"
            clock = f"{name} (group {number})"
            clocks[clock] = number
            for index, channel in enumerate(group.channels):
                full = f"{name}/{channel.name}"
                full = full if full not in numbers else f"{clock}/{channel.name}"
                if index == mdf.masters_db.get(number) or full in numbers:
                    continue
                numbers[full] = number, index
                conversion = getattr(channel, "conversion", None)
                unit = str(channel.unit or getattr(conversion, "unit", "") or "")
                headings.append(Column(full, unit, clock, _UNREAD))
        chosen = choose(headings)
        columns = {}
        for each in chosen:
            group, index = numbers[each.name]
            signal = mdf.get(group=group, index=index, ignore_invalidation_bits=True)
            samples, invalid = np.asarray(signal.samples), signal.invalidation_bits
            if invalid is not None and samples.dtype.kind in "iuf":
                is_invalid = np.asarray(getattr(invalid, "bits", invalid), bool)
                samples = np.where(is_invalid, np.nan, samples)
            columns[each.name] = replace(each, values=samples)
        times = {
            clock: np.asarray(mdf.get_master(number), np.float64)
            for clock, number in clocks.items()
            if number in mdf.masters_db and any(each.clock == clock for each in chosen)
        }
        start_ns = round(mdf.header.start_time.timestamp() * 1e6) * 1000
        return Columns(str(path), max(start_ns, 0), columns, times)


def _read_matlab(path: Path, choose: Choose) -> Columns:
    """Return variables of a MATLAB file before 7.3: `struct/field`, and `name:2` of a matrix.

    An element of an array of structs is named by its `Name`, or else by its number.
    """
    from scipy.io import loadmat

    arrays: dict[str, NDArray[Any]] = {}
    for name, value in loadmat(path, simplify_cells=True).items():
        if not name.startswith("__"):
            _collect(name, value, arrays)
    columns = [Column(name, "", name.rpartition("/")[0], arrays[name]) for name in arrays]
    return Columns(str(path), 0, {each.name: each for each in choose(columns)}, {})


def _collect(name: str, value: Any, arrays: dict[str, NDArray[Any]]) -> None:
    """Add the columns in a variable to `arrays`, by their full names."""
    if isinstance(value, dict):
        for key, item in value.items():
            _collect(f"{name}/{key}", item, arrays)
    elif isinstance(value, list):
        for number, item in enumerate(value, start=1):
            label = item.get("Name", number) if isinstance(item, dict) else number
            _collect(f"{name}/{label}", item, arrays)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        values = np.squeeze(value)
        if values.ndim == 1:
            arrays[name] = values
        elif values.ndim == 2 and min(values.shape) <= 256:  # a wider one is no table
            columns = values.T if values.shape[0] >= values.shape[1] else values
            arrays.update({f"{name}:{i + 1}": column for i, column in enumerate(columns)})


_UNIT = re.compile(r"^(.*\S)\s*[\[(]([^\[\]()]*)[\])]$")
_NUMBER = re.compile(
    r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf)$", re.IGNORECASE
)
_POINT = r"^\s*[+-]?\d*\.\d+([eE][+-]?\d+)?\s*$"
_DATE = re.compile(r"^\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")


def _form(path: Path) -> tuple[str, str, int, tuple[Column, ...]]:
    """Return encoding, separator, number of the first line of numbers, from 0, and all columns.

    The head ends where numbers begin; the first lines of numbers may have gaps.  The last line of
    the head with as many cells as the data has the names; the next line has the units if all its
    cells are units.  A unit may also follow a name, in brackets.  Raises InputError without data.
    """
    with path.open("rb") as file:
        head = file.read(1 << 17)  # longer than the head of any table
    encoding = "utf-16" if head[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    is_whole = len(head) < 1 << 17
    try:  # a character that the end of the head cuts is left out
        text = codecs.getincrementaldecoder(encoding)().decode(head, final=is_whole)
    except UnicodeDecodeError:
        encoding, text = "cp1252", head.decode("cp1252", "replace")
    if "\0" in text:
        raise InputError(str(path), "is not a table of numbers", "name a file of channels")
    lines = text.splitlines()
    lines = lines if is_whole else lines[:-1]
    for separator in (";", "\t", ","):
        rows = [next(csv.reader([line], delimiter=separator), []) for line in lines[:2000]]
        first_full = next((i for i, row in enumerate(rows) if _is_data(row, separator)), None)
        if first_full is not None:
            first_data, n_cells = first_full, len(rows[first_full])
            # Lines above it with as many cells, one value and else gaps, are data too.
            while first_data > 0 and len(rows[first_data - 1]) == n_cells:
                if _count_cells(rows[first_data - 1], separator)[:2] != (1, 1):
                    break
                first_data -= 1
            return encoding, separator, first_data, _headings(rows[:first_data], rows[first_full])
    what = "is not a table of numbers with ; tabulator or , between the columns"
    raise InputError(str(path), what, "name a file of channels, or export it with one of these")


def _count_cells(row: Sequence[str], separator: str) -> tuple[int, int, int]:
    """Return the numbers of filled cells of a line, of numbers or dates, and of numbers alone.

    A comma that separates the columns cannot be in a number.
    """
    cells = [cell.strip() for cell in row if cell.strip()]
    is_number = [bool(_NUMBER.match(c)) and (separator != "," or "," not in c) for c in cells]
    n_dates = sum(bool(_DATE.match(cell)) for cell in cells)
    return len(cells), sum(is_number) + n_dates, sum(is_number)


def _is_data(row: Sequence[str], separator: str) -> bool:
    """Return whether a line has a number, and numbers or dates in two cells and in two thirds."""
    n_filled, n_values, n_numbers = _count_cells(row, separator)
    return len(row) > 1 and n_numbers > 0 and n_values >= max(2, 2 / 3 * n_filled)


def _headings(head: Sequence[Sequence[str]], data: Sequence[str]) -> tuple[Column, ...]:
    """Return the columns from the lines of the head and the first line of data; see `_form`."""
    n = len(data)
    # One cell more or less: some tools end the lines of the head or of the data with a separator.
    full_rows = [[cell.strip() for cell in row] for row in head if abs(len(row) - n) <= 1]
    full_rows = [[*row, ""][:n] for row in full_rows]  # n cells each
    names, units = [""] * n, [""] * n
    if full_rows:
        names = full_rows[-1]
        are_units = all(c.strip("[]()") != c or known_si(c) is not None for c in names)
        if len(full_rows) > 1 and are_units and any(names):
            names, units = full_rows[-2], [cell.strip("[]()") for cell in names]
    headings = list[Column]()
    for i, name in enumerate(names):
        match = _UNIT.match(name)
        if match and not units[i]:
            name, units[i] = match[1], match[2]
        name, unit = name or f"column {i + 1}", "ns" if _DATE.match(data[i]) else units[i]
        is_taken = any(each.name == name for each in headings)  # then it gets its column's number
        name = f"{name}:{i + 1}" if is_taken else name
        headings.append(Column(name, unit, "table", _UNREAD))
    return tuple(headings)


def _read_csv(path: Path, choose: Choose) -> Columns:
    """Return columns of a table with any separator, decimal mark and head of common tools.

    Rows with a field too many are left out, unreadable cells are missing values; both are stated.
    """
    pandas = optional("pandas", "data")
    encoding, separator, first_line, headings = _form(path)
    wanted, n = choose(headings), len(headings)
    positions = [headings.index(each) for each in wanted]
    table = pandas.read_csv(
        path,
        sep=separator,
        header=None,
        names=range(n + 1),  # a row with a field too many has a value in the last one
        skiprows=first_line,
        skip_blank_lines=False,
        encoding=encoding,
        encoding_errors="replace",
        index_col=False,
        low_memory=False,
    )
    table.index += first_line + 1  # the number of the line, from 1
    too_long = table.index[table[n].notna()]
    table = table.drop(index=too_long)
    unread = []
    if len(too_long):
        rows = counted(len(too_long), "row has", "rows have")
        unread.append(f"{rows} a field too many, the first in line {min(too_long)}")
    has_point = any(_has_point(table[position]) for position in positions)
    comma_is_decimal = separator != "," and not has_point
    columns, unreadable = {}, []  # line and column of each unreadable cell
    for heading, position in zip(wanted, positions, strict=True):
        values, is_unreadable = _numbers(pandas, table[position], comma_is_decimal)
        columns[heading.name] = replace(heading, values=values)
        unreadable += [(int(line), heading.name) for line in table.index[is_unreadable]]
    if unreadable:
        line, name = min(unreadable)
        cells = counted(len(unreadable), "cell is no number", "cells are no numbers")
        unread.append(f"{cells}, the first in line {line}, column {printable(name, 60)}")
    return Columns(str(path), 0, columns, {}, tuple(unread))


def _has_point(column: Any) -> bool:
    """Return whether a column has a number with a point: then commas are no decimal marks."""
    if column.dtype.kind == "f":
        values = column.to_numpy()
        return bool(np.any(np.isfinite(values) & (values != np.rint(values))))
    if column.dtype.kind in "iu":
        return False
    return bool(column.astype("string").str.contains(_POINT).any())


def _numbers(
    pandas: Any, column: Any, comma_is_decimal: bool
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return the numbers in a column, and a mask of the cells that are none; gaps are not in it.

    Times of day become int64, ns since 1970, if none is missing; other text becomes float64.
    """
    if column.dtype.kind in "iuf":
        return np.asarray(column), np.zeros(len(column), bool)
    text = column.astype("string").str.strip()
    text = text.mask(text.isin(["", "-", "--"]))
    is_filled = text.notna().to_numpy()
    first_filled = text[is_filled].head(1)
    if bool(first_filled.str.match(_DATE.pattern).fillna(False).any()):
        times = pandas.to_datetime(text, utc=True, errors="coerce", format="ISO8601")
        stamps = np.asarray(times.dt.tz_localize(None), "M8[ns]").astype(np.int64)
        is_missing = times.isna().to_numpy()
        stamps = np.where(is_missing, np.nan, stamps) if is_missing.any() else stamps
        return stamps, is_filled & is_missing
    if comma_is_decimal:
        text = text.str.replace(",", ".", regex=False)
    values = np.asarray(pandas.to_numeric(text, errors="coerce"), np.float64)
    return values, is_filled & np.isnan(values)
