"""Finds the newest row of each session in a journal; rows are read when needed, not kept."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from identify.batch import Cell

from .journal import rows_in

Rows = Iterator[dict[str, Cell]]


@dataclass(frozen=True, slots=True)
class Newest:
    """Places of the newest rows of a journal, in the order in which sessions first appear."""

    journal: Path
    vehicles: dict[int, str]
    """Name of the vehicle by the place of its row; empty where a failed row has none."""
    columns: tuple[str, ...]
    """All columns; the last columns of every row are last."""
    texts: frozenset[str]
    """Columns that hold text."""

    def rows(self, places: Sequence[int] | None = None) -> Rows:
        """Yield the rows at some places, all by default."""
        with self.journal.open("rb") as stream:
            for place in self.vehicles if places is None else places:
                stream.seek(place)
                yield json.loads(stream.readline())


def newest_rows(journal: Path) -> Newest:
    """Find the newest rows; a row replaces earlier ones of the same content or the same file."""
    newest: dict[str, tuple[int, str]] = {}
    by_file: dict[str, str] = {}
    columns: dict[str, None] = {}
    texts: set[str] = set()
    for place, row in rows_in(journal):
        file, key = str(row["file"]), str(row["sha256"] or row["file"])
        if by_file.get(file, key) != key:
            newest.pop(by_file[file], None)
        by_file[file] = key
        newest[key] = place, str(row.get("vehicle") or "")
        columns |= dict.fromkeys(row)
        texts |= {name for name, cell in row.items() if isinstance(cell, str)}
    return Newest(journal, dict(newest.values()), tuple(_ordered(columns)), frozenset(texts))


def _ordered(columns: dict[str, None]) -> list[str]:
    """Put the columns that a failed row lacks before the last columns of every row."""
    last = ("seconds", "software", "libraries")
    return [name for name in columns if name not in last] + [n for n in last if n in columns]
