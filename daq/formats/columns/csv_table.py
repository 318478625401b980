"""Reads columns of text tables, with any separator, decimal mark and head of common tools.

The head ends where numbers begin; the first lines of numbers may have gaps.  The last line of the
head with as many cells as the data has the names; the next line has the units if all its cells are
units.  A unit may also follow a name, in brackets.
"""

from __future__ import annotations

import codecs
import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import printable
from dbc.units import known_si
from dbc.words import counted

from ...errors import InputError, optional
from .table import Choose, Heading, Table, bounded

_HEAD_BYTES = 1 << 17
_SEPARATORS = (";", "\t", ",")
_UNIT = re.compile(r"^(.*\S)\s*[\[(]([^\[\]()]*)[\])]$")
_NUMBER = re.compile(
    r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf)$", re.IGNORECASE
)
_SKIPPED = re.compile(r"Skipping line (\d+)")
"""Words of pandas for a row with more fields than one too many."""
_POINT = r"^\s*[+-]?\d*\.\d+([eE][+-]?\d+)?\s*$"
_DATE = re.compile(r"^\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")


@dataclass(frozen=True, slots=True)
class _Form:
    """The form of a table."""

    encoding: str
    separator: str
    first: int
    """Number of the first line with numbers, from 0."""
    headings: tuple[Heading, ...]
    """All columns."""


def read_csv(path: Path, choose: Choose) -> Table:
    """Return columns of a table.

    Rows with too many fields are left out, and unreadable cells are missing values; both are
    stated.
    """
    form = _form(path)
    return _read(path, form, choose(form.headings))


def _form(path: Path) -> _Form:
    """Detect the form of a table from its head; raises InputError if no line is of numbers."""
    with path.open("rb") as file:
        raw = file.read(_HEAD_BYTES)
    encoding = "utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    is_whole = len(raw) < _HEAD_BYTES
    try:  # a character that the end of the head cuts is left out
        text = codecs.getincrementaldecoder(encoding)().decode(raw, final=is_whole)
    except UnicodeDecodeError:
        encoding, text = "cp1252", raw.decode("cp1252", "replace")
    if "\0" in text:
        raise InputError(str(path), "is not a table of numbers", "name a file of channels")
    lines = text.splitlines()
    lines = lines if is_whole else lines[:-1]
    for separator in _SEPARATORS:
        rows = [next(csv.reader([line], delimiter=separator), []) for line in lines[:2000]]
        full = next((i for i, row in enumerate(rows) if _is_data(row, separator)), None)
        if full is not None:
            first = full  # lines above it with one value and gaps are data too
            while first > 0 and _is_sparse_data(rows[first - 1], separator, len(rows[full])):
                first -= 1
            headings = _headings(rows[:first], rows[full])
            return _Form(encoding, separator, first, headings)
    what = "is not a table of numbers with ; tabulator or , between the columns"
    raise InputError(str(path), what, "name a file of channels, or export it with one of these")


def _is_data(row: Sequence[str], separator: str) -> bool:
    """Return whether a line has a number, and numbers or dates in two cells and in two thirds."""
    cells = [cell.strip() for cell in row if cell.strip()]
    numbers = sum(_is_number(cell, separator) for cell in cells)
    dates = sum(bool(_DATE.match(cell)) for cell in cells)
    two_thirds = (2 * len(cells) + 2) // 3  # rounded up
    return len(row) > 1 and numbers > 0 and numbers + dates >= max(2, two_thirds)


def _is_sparse_data(row: Sequence[str], separator: str, n_cells: int) -> bool:
    """Return whether a line has this number of cells, one of them a number or date, else gaps."""
    cells = [cell.strip() for cell in row if cell.strip()]
    if len(row) != n_cells or len(cells) != 1:
        return False
    return _is_number(cells[0], separator) or bool(_DATE.match(cells[0]))


def _is_number(cell: str, separator: str) -> bool:
    return bool(_NUMBER.match(cell)) and (separator != "," or "," not in cell)


def _headings(head: Sequence[Sequence[str]], data: Sequence[str]) -> tuple[Heading, ...]:
    """Return the columns from the lines of the head and the first line of data."""
    n = len(data)
    # One cell more or less: some tools end the lines of the head or of the data with a separator.
    wide = [[cell.strip() for cell in row] for row in head if len(row) in (n, n - 1, n + 1)]
    wide = [[*row, ""][:n] for row in wide]
    names, units = [""] * n, [""] * n
    if wide:
        names = wide[-1]
        units_only = all(c.strip("[]()") != c or known_si(c) is not None for c in names)
        if len(wide) > 1 and units_only and any(names):
            names, units = wide[-2], [cell.strip("[]()") for cell in names]
    headings = list[Heading]()
    for i, name in enumerate(names):
        match = _UNIT.match(name)
        if match and not units[i]:
            name, units[i] = match[1], match[2]
        name, units[i] = name or f"column {i + 1}", "ns" if _DATE.match(data[i]) else units[i]
        taken = any(each.name == name for each in headings)
        headings.append(Heading(f"{name}:{i + 1}" if taken else name, units[i], "table"))
    return tuple(headings)


def _read(path: Path, form: _Form, wanted: Sequence[Heading]) -> Table:
    """Read the wanted columns; the lines of the file, counted from 1, are the index of its rows."""
    pandas = optional("pandas", "data")
    n = len(form.headings)
    positions = [form.headings.index(each) for each in wanted]
    with warnings.catch_warnings(record=True) as skipped:
        warnings.simplefilter("always")
        table = pandas.read_csv(
            path,
            sep=form.separator,
            header=None,
            names=range(n + 1),  # a row with a field too many has a value in the last one
            skiprows=form.first,
            skip_blank_lines=False,
            encoding=form.encoding,
            encoding_errors="replace",
            on_bad_lines="warn",
            index_col=False,
            low_memory=False,
        )
    bounded(len(table) * len(wanted), str(path))
    left_out = [int(line) for each in skipped for line in _SKIPPED.findall(str(each.message))]
    stop = form.first + len(table) + len(left_out)
    table.index = np.setdiff1d(np.arange(form.first, stop) + 1, left_out)[: len(table)]
    too_long = table.index[table[n].notna()]
    table = table.drop(index=too_long)
    unread = []
    if lines := [*too_long.tolist(), *left_out]:
        rows = counted(len(lines), "row has", "rows have")
        unread.append(f"{rows} a field too many, the first in line {min(lines)}")
    has_point = any(_has_point(table[position]) for position in positions)
    is_comma = form.separator != "," and not has_point
    values, bad = {}, []
    for heading, position in zip(wanted, positions, strict=True):
        column = table[position]
        if column.dtype.kind in "iuf":
            values[heading.name] = np.asarray(column)
            continue
        values[heading.name], wrong = _numbers(pandas, column, is_comma)
        bad += [(int(line), heading.name) for line in table.index[wrong]]
    if bad:
        line, name = min(bad)
        cells = counted(len(bad), "cell is no number", "cells are no numbers")
        unread.append(f"{cells}, the first in line {line}, column {printable(name, 60)}")
    return Table(values, unread=tuple(unread))


def _has_point(column: Any) -> bool:
    """Return whether a column has a number with a point: then commas are no decimal marks."""
    if column.dtype.kind == "f":
        values = column.to_numpy()
        return bool(np.any(np.isfinite(values) & (values != np.rint(values))))
    if column.dtype.kind in "iu":
        return False
    return bool(column.astype("string").str.contains(_POINT).any())


def _numbers(pandas: Any, column: Any, is_comma: bool) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return the numbers in a column of text, and a mask of the cells that are none.

    Gaps are no wrong cells.  Times of day become int64, ns since 1970, other numbers float64.
    `is_comma`: True if a comma is the decimal mark.
    """
    text = column.astype("string").str.strip()
    text = text.mask(text.isin(["", "-", "--"]))
    filled = text.notna().to_numpy()
    first_filled = text[filled].head(1)
    if bool(first_filled.str.match(_DATE.pattern).fillna(False).any()):
        times = pandas.to_datetime(text, utc=True, errors="coerce", format="ISO8601")
        stamps = np.asarray(times.dt.tz_localize(None), "M8[ns]").astype(np.int64)
        return stamps, filled & times.isna().to_numpy()
    if is_comma:
        text = text.str.replace(",", ".", regex=False)
    values = np.asarray(pandas.to_numeric(text, errors="coerce"), np.float64)
    return values, filled & np.isnan(values)
