"""Reads columns of text tables, with any separator, decimal mark and head of common tools.

The head ends where numbers begin; the first lines of numbers may have gaps.  The last line of the
head with as many cells as the data has the names; the next line has the units if all its cells are
units.  A unit may also follow a name, in brackets.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.units import known_si

from ...errors import InputError
from ...optional import optional
from .opened import MAX_VALUES, ColumnFile, Heading, too_long

_HEAD_BYTES = 1 << 17
_SEPARATORS = (";", "\t", ",")
_UNIT = re.compile(r"^(.*\S)\s*[\[(]([^\[\]()]*)[\])]$")
_NUMBER = re.compile(
    r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf)$", re.IGNORECASE
)
_COMMA = re.compile(r"^[+-]?\d*,\d+([eE][+-]?\d+)?$")
_DATE = re.compile(r"^\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_ROWS = 1 << 17


@dataclass(frozen=True, slots=True)
class _Form:
    """The form of a table."""

    encoding: str
    separator: str
    decimal: str
    first: int
    """Number of the first line with numbers, from 0."""
    headings: tuple[Heading, ...]
    """All columns."""


@contextmanager
def open_csv(path: Path) -> Iterator[ColumnFile]:
    """Open a table."""
    form = _form(path)

    def read(wanted: Sequence[Heading]) -> Mapping[str, NDArray[Any]]:
        return _read(path, form, wanted)

    yield ColumnFile(form.headings, read)


def _form(path: Path) -> _Form:
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
            first = full
            while first > 0 and _is_sparse(rows[first - 1], rows[full], separator):
                first -= 1
            cells = [cell.strip() for row in rows[first : first + 50] for cell in row]
            is_comma = separator != "," and any(map(_COMMA.match, cells))
            names = _headings(rows[:first], rows[full])
            return _Form(encoding, separator, "," if is_comma else ".", first, names)
    what = "is not a table of numbers with ; tabulator or , between the columns"
    raise InputError(str(path), what, "name a file of channels, or export it with one of these")


def _is_data(row: Sequence[str], separator: str) -> bool:
    """Return whether a line has numbers in most of its cells and in at least two."""
    cells = [cell.strip() for cell in row]
    numbers = sum(_is_number(cell, separator) for cell in cells)
    times = sum(bool(_DATE.match(cell)) for cell in cells)
    filled = sum(bool(cell) for cell in cells)
    return len(row) > 1 and numbers > 0 and numbers + times >= max(2, (2 * filled + 2) // 3)


def _is_sparse(row: Sequence[str], data: Sequence[str], separator: str) -> bool:
    """Return whether a line above the first full line of data is data: one value, else gaps."""
    filled = [cell.strip() for cell in row if cell.strip()]
    if len(row) != len(data) or len(filled) != 1:
        return False
    return _is_number(filled[0], separator) or bool(_DATE.match(filled[0]))


def _is_number(cell: str, separator: str) -> bool:
    return bool(_NUMBER.match(cell)) and (separator != "," or "," not in cell)


def _headings(head: Sequence[Sequence[str]], data: Sequence[str]) -> tuple[Heading, ...]:
    """Return the columns from the lines of the head and the first line of data."""
    n = len(data)
    wide = [[cell.strip() for cell in row] for row in head if len(row) in (n, n - 1, n + 1)]
    names, units = [""] * n, [""] * n
    if wide:
        last = [*wide[-1], *[""] * n][:n]
        if len(wide) > 1 and all(map(_is_unit, last)) and any(last):
            units = [cell.strip("[]()") for cell in last]
            last = [*wide[-2], *[""] * n][:n]
        names = last
    found = list[Heading]()
    for i, name in enumerate(names):
        match = _UNIT.match(name)
        if match and not units[i]:
            name, units[i] = match[1], match[2]
        name, units[i] = name or f"column {i + 1}", "ns" if _DATE.match(data[i]) else units[i]
        taken = any(each.name == name for each in found)
        found.append(Heading(f"{name}:{i + 1}" if taken else name, units[i], "table"))
    return tuple(found)


def _is_unit(cell: str) -> bool:
    plain = cell.strip("[]()")
    return plain != cell or known_si(plain) is not None


def _read(path: Path, form: _Form, wanted: Sequence[Heading]) -> dict[str, NDArray[Any]]:
    """Read columns in pieces; cells that are not numbers are missing values."""
    pandas = optional("pandas", "data")
    numbers = [form.headings.index(each) for each in wanted]
    pieces: list[list[NDArray[Any]]] = [[] for _ in wanted]
    total = 0
    with pandas.read_csv(
        path,
        sep=form.separator,
        decimal=form.decimal,
        header=None,
        names=range(len(form.headings)),
        usecols=sorted(numbers),
        skiprows=form.first,
        encoding=form.encoding,
        encoding_errors="replace",
        on_bad_lines="skip",
        index_col=False,
        chunksize=_ROWS,
        low_memory=False,
    ) as reader:
        for table in reader:
            total += table.size
            if total > MAX_VALUES:
                raise too_long(f"over {MAX_VALUES}", str(path))
            for own, number in zip(pieces, numbers, strict=True):
                own.append(_numbers(pandas, table[number], form.decimal))
    return {each.name: _joined(own) for each, own in zip(wanted, pieces, strict=True)}


def _numbers(pandas: Any, column: Any, decimal: str) -> NDArray[Any]:
    if column.dtype.kind in "iuf":
        return np.asarray(column)
    text = column.astype("string").str.strip()
    if bool(text.head(1).str.match(_DATE.pattern).fillna(False).any()):
        times = pandas.to_datetime(text, utc=True, errors="coerce", format="ISO8601")
        return np.asarray(times.dt.tz_localize(None), "M8[ns]")
    if decimal == ",":
        text = text.str.replace(",", ".", regex=False)
    return np.asarray(pandas.to_numeric(text, errors="coerce"), np.float64)


def _joined(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return the pieces as one array; dates as ns, with the lowest number for a missing one."""
    whole = np.concatenate(pieces)
    return whole.astype(np.int64) if whole.dtype.kind == "M" else whole
