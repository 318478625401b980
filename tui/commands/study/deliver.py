"""Delivers the result of a study: table or JSON to stdout, figure to a file."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from identify.study import Cell, Column, Study

FigureFile = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE.svg", help="Draw the result, too.")
]


def check_figure_file(path: Path | None) -> None:
    """Refuse a file that could not be written, before hours of computing.

    Its folder is created.  Raises InputError if it does not end in .svg, or cannot be written.
    """
    from daq.files import make_room
    from dbc import InputError

    if path is None:
        return
    if path.suffix.lower() != ".svg":
        raise InputError(str(path), "a figure is drawn as SVG only", "name the file *.svg")
    if path.is_dir():
        raise InputError(str(path), "is a directory", "name a file")
    make_room(path)


def deliver(study: Study, json: bool, figure: Path | None) -> None:
    """Print a study, then draw it.

    Raises InputError if the file cannot be written; hours of computing are printed by then.
    """
    from ...output import print_json

    if json:
        print_json(document(study))
    else:
        _print(study)
    if figure is not None:
        from daq.files import write_named
        from identify.study import svg

        write_named(figure, svg(study).encode())


def _print(study: Study) -> None:
    from ...output import print_item, print_line, print_table

    rows = [
        [_cell(cell, column) for cell, column in zip(row, study.columns, strict=True)]
        for row in study.rows
    ]
    print_table(study.title, [column.heading for column in study.columns], rows)
    print_line()
    for note in study.notes:
        print_item(note)


def document(study: Study) -> dict[str, Any]:
    """Return a study as a JSON document; its panels hold what the figure shows."""
    keys = [column.key for column in study.columns]
    return {
        "title": study.title,
        "rows": [dict(zip(keys, row, strict=True)) for row in study.rows],
        "notes": list(study.notes),
        "panels": [_plain(asdict(panel)) for row in study.panels for panel in row],
    }


def _plain(value: Any) -> Any:
    """Return nested values with arrays as lists."""
    match value:
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case str() | bool() | int() | float() | None:
            return value
        case _:
            return value.tolist()


def _cell(cell: Cell, column: Column) -> str:
    if isinstance(cell, str):
        return cell
    return format(cell, column.form) if isfinite(cell) else "-"
