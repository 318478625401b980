"""Writes tables: CSV, one file per run and sample clock, and Parquet, one file in all."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.words import csv_text

from ...errors import InputError
from ...optional import optional
from ...runs import SampleGroup
from ...sessions import Session
from .frames import frames_left_out


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


def csv_groups(session: Session, path: Path) -> dict[Path, SampleGroup]:
    """Return the sample groups of a session by their files: ``car.csv``: ``car_RUN_GROUP.csv``.

    Raises InputError if the runs have no samples, or two groups have the same file.
    """
    groups: dict[Path, SampleGroup] = {}
    for run in session.runs:
        for group in run.groups:
            name = f"{run.label}_{group.name}"
            plain = "".join(c if c.isalnum() or c in "-+_" else "_" for c in name)
            place = path.with_name(f"{path.stem}_{plain}.csv")
            if place in groups:
                raise InputError(str(place), "would be the file of two runs", "choose with --run")
            groups[place] = group
    if not groups:
        raise InputError("session", "its runs hold no samples", "choose other runs")
    return groups


def write_csv(group: SampleGroup, units: dict[str, str], path: Path, style: CsvStyle) -> None:
    """Write the samples of one clock; a missing value is an empty cell.

    The columns are ``time_s``, the channels as ``name [unit]``, and ``quality``
    (`dbc.samples.Quality`).  Numbers have as many digits as are needed to read them back exactly.
    """

    def cells(values: NDArray[np.float64]) -> list[str]:
        texts = ["" if value != value else repr(value) for value in values.tolist()]
        return [text.replace(".", style.decimal) for text in texts]

    names = [f"{name} [{units[name]}]" if units[name] else name for name in group.values]
    columns = [*map(cells, (group.time_s, *group.values.values())), group.quality.tolist()]
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, delimiter=style.separator)
        writer.writerow(["time_s", *map(csv_text, names), "quality"])
        writer.writerows(zip(*columns, strict=True))


def write_parquet(session: Session, path: Path) -> tuple[str, ...]:
    """Write the table of `Session.to_dataframe`: a channel is null in the rows of other groups.

    pandas reads the units in ``DataFrame.attrs["units"]``, other readers in the metadata ``unit``
    of each field.  Returns notes on the contents of the session that the format cannot hold.
    """
    pa = optional("pyarrow", "data")
    parquet = optional("pyarrow.parquet", "data")
    frame = session.to_dataframe()
    table = pa.Table.from_pandas(frame, preserve_index=False)
    units = frame.attrs["units"]
    fields = [
        field.with_metadata({"unit": units[field.name]}) if field.name in units else field
        for field in table.schema
    ]
    schema = pa.schema(fields, metadata=table.schema.metadata)
    parquet.write_table(table.cast(schema), path, compression="zstd")
    return frames_left_out(session)
