"""From the journal of rows to a table: CSV or Parquet, replaced as a whole."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

from daq.files import replaced
from dbc import InputError
from identify.batch import Cell

from .journal import rows_in

Rows = Iterator[dict[str, Cell]]

_GROUP = 1000
"""Rows of a group in Parquet: what is in memory at once."""


def check_table_file(path: Path) -> None:
    """Refuse a file that could not be written, before hours of computing.

    Raises InputError if the ending is unknown, its folder does not exist, or pyarrow is missing.
    """
    if path.suffix.lower() not in _WRITERS:
        endings = " or ".join(_WRITERS)
        raise InputError(str(path), "is no table that can be written", f"name it *{endings}")
    if path.is_dir() or not path.parent.is_dir():
        what = "is a directory" if path.is_dir() else "its directory does not exist"
        raise InputError(str(path), what, "name a file in a directory that exists")
    if path.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        raise InputError(
            str(path), "Parquet needs pyarrow, which is not installed", "install bumpbench[data]"
        )


def write_table(path: Path, journal: Path) -> None:
    """Write the newest row of each session, in the order in which they were first seen.

    `path`: ``.csv`` or ``.parquet``; complete or as it was before.  Raises InputError if it cannot
    be written.
    """
    places, columns, texts = _index(journal)
    try:
        with replaced([path]) as (part,):
            _WRITERS[path.suffix.lower()](part, columns, texts, _rows_at(journal, places))
    except OSError as error:
        raise InputError(
            str(path), error.strerror or "cannot be written", f"the rows are safe in {journal}"
        ) from None


def _index(journal: Path) -> tuple[list[int], list[str], set[str]]:
    """Return where the newest rows are, their columns, and which of these hold text.

    A row is superseded by a later one of the same content, or of the same file.
    """
    newest: dict[str, int] = {}
    by_file: dict[str, str] = {}
    columns: dict[str, None] = {}
    texts: set[str] = set()
    for place, row in rows_in(journal):
        file, key = str(row["file"]), str(row["sha256"] or row["file"])
        if by_file.get(file, key) != key:
            newest.pop(by_file[file], None)
        by_file[file] = key
        newest[key] = place
        columns |= dict.fromkeys(row)
        texts |= {name for name, cell in row.items() if isinstance(cell, str)}
    return list(newest.values()), _ordered(columns), texts


def _ordered(columns: dict[str, None]) -> list[str]:
    """Put what a failed row lacks before what every row ends with."""
    last = ("seconds", "software", "libraries")
    return [name for name in columns if name not in last] + [n for n in last if n in columns]


def _rows_at(journal: Path, places: Sequence[int]) -> Rows:
    with journal.open("rb") as stream:
        for place in places:
            stream.seek(place)
            yield json.loads(stream.readline())


def _write_csv(path: Path, columns: Sequence[str], texts: set[str], rows: Rows) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _write_parquet(path: Path, columns: Sequence[str], texts: set[str], rows: Rows) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    kinds = [(name, pa.string() if name in texts else pa.float64()) for name in columns]
    schema = pa.schema(kinds)
    with parquet.ParquetWriter(path, schema) as writer:
        while group := list(islice(rows, _GROUP)):
            writer.write_table(pa.Table.from_pylist(group, schema))


_WRITERS: dict[str, Callable[[Path, Sequence[str], set[str], Rows], None]] = {
    ".csv": _write_csv,
    ".parquet": _write_parquet,
}
