"""Writes the journal of rows as a table (CSV, Parquet or a folder of Parquet) and as a page."""

from __future__ import annotations

import csv
from importlib.util import find_spec
from pathlib import Path

from daq.files import make_room, refuse_existing, replaced
from dbc import InputError

from ...endings import PAGES, require_ending
from .dataset import schema_of, write_dataset, write_parquet
from .newest import Newest, newest_rows
from .page import page_of

_ENDINGS = (".csv", ".parquet")


def journal_of(out: Path) -> Path:
    """Return the journal of the rows of a table."""
    return out.with_name(f"{out.name}.jsonl")


def check_outputs(out: Path, page: Path | None, *, replace: bool = False) -> None:
    """Refuse files that could not be written, before hours of computing.

    Folders that are missing are created.  A table without rows in its journal is not that of a
    batch, and is refused unless `replace`.  Raises InputError if an ending is unknown, a folder is
    something else or cannot be made, or pyarrow is missing.
    """
    partitioned = not out.suffix
    if not partitioned and out.suffix.lower() not in _ENDINGS:
        endings = " or *".join(_ENDINGS)
        advice = f"name it *{endings}, or a folder without an ending"
        raise InputError(str(out), "is not a table that can be written", advice)
    if partitioned and out.exists() and not _is_dataset(out):
        raise InputError(str(out), "is not a folder of a batch", "name another one")
    if page is not None:
        require_ending(page, "page", PAGES)
    for path in (out, *([] if page is None else [page])):
        if path.is_dir() and not (partitioned and path == out):
            raise InputError(str(path), "is a directory", "name a file")
    rows = journal_of(out)
    replace |= rows.is_file() and rows.stat().st_size > 0
    if not partitioned:
        refuse_existing(out, replace=replace)
    elif out.exists() and any(out.iterdir()) and not replace:
        advice = "name another folder with --out, or use --force"
        raise InputError(str(out), "exists already", advice)
    if out.suffix.lower() != ".csv" and find_spec("pyarrow") is None:
        what = "Parquet needs pyarrow, which is not installed"
        raise InputError(str(out), what, "install bumpbench[data]")
    for path in (out, *([] if page is None else [page])):
        make_room(path)


def write_outputs(out: Path, page: Path | None, journal: Path) -> None:
    """Write the newest row of each session, in the order in which they were first seen.

    `out`: ``.csv``, ``.parquet``, or a folder for a data set partitioned by vehicle.  `page`: HTML
    page from the same rows, or None.  Each file is complete or as it was before.  Raises InputError
    if one cannot be written.
    """
    newest = newest_rows(journal)
    path = out
    try:
        if not out.suffix:
            write_dataset(out, newest)
        else:
            with replaced([out]) as (part,):
                if out.suffix.lower() == ".csv":
                    _write_csv(part, newest)
                else:
                    write_parquet(part, schema_of(newest), newest.rows())
        if page is not None:
            path = page
            with replaced([page]) as (part,):
                part.write_text(page_of(newest, page.parent), "utf-8")
    except OSError as error:
        raise InputError(
            str(path), error.strerror or "cannot be written", f"the rows are safe in {journal}"
        ) from None


def _is_dataset(folder: Path) -> bool:
    """Return whether a folder is empty or holds vehicles alone."""
    return folder.is_dir() and all(one.name.startswith("vehicle=") for one in folder.iterdir())


def _write_csv(path: Path, newest: Newest) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, newest.columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(newest.rows())
