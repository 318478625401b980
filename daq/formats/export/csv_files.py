"""Writes CSV: one file per run and sample clock; the head names the channels and their units."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.words import csv_text

from ...errors import InputError
from ...runs import SampleGroup


@dataclass(frozen=True, slots=True)
class CsvStyle:
    """Characters that separate columns and fractions.

    Raises InputError if a file in this style could not be read.
    """

    separator: str = ","
    """Character between columns."""
    decimal: str = "."
    """Character before the fraction."""

    def __post_init__(self) -> None:
        if self.decimal not in (".", ","):
            raise InputError("--decimal", f"is {self.decimal!r}", "use . or ,")
        if len(self.separator) != 1 or self.separator in '"\r\n.-+eE0123456789 ':
            raise InputError("--separator", f"is {self.separator!r}", "use , or ; or a tabulator")
        if self.separator == self.decimal:
            what = f"{self.separator!r} would separate columns and decimals"
            raise InputError("--separator", what, "use --separator ';' with a decimal comma")


PLAIN = CsvStyle()


def write_csv(group: SampleGroup, units: dict[str, str], path: Path, style: CsvStyle) -> None:
    """Write the samples of one clock; a missing value is an empty cell.

    The columns are ``time_s``, the channels as ``name [unit]``, and ``quality``
    (`dbc.samples.Quality`).  Numbers have as many digits as are needed to read them back exactly.
    """
    columns = [_cells(group.time_s, style)]
    columns += [_cells(values, style) for values in group.values.values()]
    columns += [map(str, group.quality.tolist())]
    names = [f"{name} [{units[name]}]" if units[name] else name for name in group.values]
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, delimiter=style.separator)
        writer.writerow(["time_s", *map(csv_text, names), "quality"])
        writer.writerows(zip(*columns, strict=True))


def _cells(values: NDArray[np.float64], style: CsvStyle) -> Iterable[str]:
    texts = ("" if value != value else repr(value) for value in values.tolist())
    return texts if style.decimal == "." else (text.replace(".", ",") for text in texts)


def read_csv(
    path: Path, style: CsvStyle, channels: Sequence[str]
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Return times and values of the channels in a file that `write_csv` has written.

    Raises ValueError if it is another file.
    """
    with path.open(encoding="utf-8", newline="") as stream:
        rows = csv.reader(stream, delimiter=style.separator)
        head = next(rows, [])
        if head[:1] != ["time_s"] or len(head) != len(channels) + 2:
            raise ValueError(f"{path.name} has other columns")
        cells = [[_number(cell, style) for cell in row] for row in rows]
    table = np.array(cells, np.float64).reshape(-1, len(head))
    return table[:, 0], {name: table[:, i] for i, name in enumerate(channels, start=1)}


def _number(cell: str, style: CsvStyle) -> float:
    return float(cell.replace(style.decimal, ".")) if cell else np.nan
