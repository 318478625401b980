"""Replaces a database of a bench by a corrected one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePath

from dbc import read_dbc

from ..errors import InputError
from .config import Bench, parse_bench
from .databases import Database, stored_databases, stored_text


def with_database(bench: Bench, path: Path) -> Bench:
    """Return the bench with the database of a file instead of its only one, or the one so named.

    Raises InputError if the file cannot be read, or the bench has several databases and none with
    this file name.
    """
    text = read_dbc(path)
    if not bench.sensors:
        return replace(bench, dbc_text=text, dbc_name=str(path))
    names = list(dict.fromkeys(sensor.database for sensor in bench.sensors))
    chosen = names if len(names) == 1 else [n for n in names if PurePath(n).name == path.name]
    if len(chosen) != 1:
        what = f"none of the {len(names)} databases of the bench has this file name"
        advice = f"name the file as the one it replaces: {', '.join(names)}"
        raise InputError(str(path), what, advice)
    old = {each.name: each.text for each in stored_databases(bench.dbc_text)}
    if len(names) == 1:
        old = dict.fromkeys(names, "")
    texts = {name: text if name == chosen[0] else each for name, each in old.items()}
    stored = stored_text([Database(name, each) for name, each in texts.items()])
    # Read again, because the full names of the channels depend on the databases.
    again = parse_bench(bench.text, "bench.toml", Path(), stored)
    return replace(bench, dbc_text=stored, channels=again.channels)
