"""The databases of a bench: read by name, and joined to one text that journals and sessions store.

A single database is stored as its own text.  Several databases are stored as a JSON document with
the names by which bench.toml refers to them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePath

from dbc import Codec, parse_codec, read_dbc, shipped_dbc, split_by_bus

from ..errors import InputError
from .ready_maps import PREFIX, ready_map
from .toml_file import Place, line_of

_BUS_MARK = "#"
"""Separator between the name of a file and of one of its buses, as in `dbc.read_dbc`."""
_KEY = "bumpbench_databases"


@dataclass(frozen=True, slots=True)
class Database:
    """A database of a bench."""

    name: str
    """Its name in bench.toml: a path, or ``layout:NAME``; empty if bench.toml names none."""
    text: str
    """Its content."""


def read_databases(
    places: Mapping[str, Place], text: str, where: str, folder: Path | None
) -> tuple[Database, ...]:
    """Return the databases that a bench names.

    `places`: where it names each.  `text` and `where`: the bench.toml and its name.  `folder`:
    where relative paths start; None reads the ready maps only.  Raises InputError, with the line of
    bench.toml, if one cannot be read.
    """
    databases = []
    for name, place in places.items():
        try:
            if name.startswith(PREFIX):
                content = ready_map(name.removeprefix(PREFIX)).dbc_text
            elif folder is not None:
                content = read_dbc(folder / name) if name else shipped_dbc()
            else:
                continue
        except InputError as error:
            line = line_of(text, place)
            key = ".".join(str(part) for part in place)
            what = f"{key}: {error.where}: {error.what}"
            raise InputError(f"{where}:{line}" if line else where, what, error.advice) from error
        databases.append(Database(name, content))
    return tuple(databases)


def stored_text(databases: Sequence[Database]) -> str:
    """Return the text that journals and sessions store."""
    if len(databases) == 1:
        return databases[0].text
    return json.dumps({_KEY: {each.name: each.text for each in databases}}, indent=1)


def stored_databases(text: str) -> tuple[Database, ...]:
    """Return the databases in a stored text; none if it is empty.

    Raises InputError if it is damaged.
    """
    if not text.lstrip().startswith("{"):
        return (Database("", text),) if text else ()
    try:
        stored = json.loads(text)[_KEY]
        return tuple(Database(str(name), str(each)) for name, each in stored.items())
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        what = "the list of databases is damaged"
        raise InputError("bench", what, "name the databases with --config") from error


def each_bus(database: Database) -> tuple[Database, ...]:
    """Return a database of several buses as one for each, called ``FILE#BUS``; others unchanged.

    The text of each is the part for its bus.
    """
    parts = split_by_bus(database.text, database.name)
    if len(parts) < 2:
        return (database,)
    return tuple(Database(f"{database.name}{_BUS_MARK}{bus}", text) for bus, text in parts.items())


def file_and_bus(name: str) -> tuple[str, str]:
    """Return the file and the bus in the name of a database; the bus is empty if none is named."""
    file, _, bus = name.rpartition(_BUS_MARK)
    return (file, bus) if PurePath(file).suffix else (name, "")


@lru_cache(maxsize=32)
def database_codec(text: str, name: str) -> Codec:
    """Return a database compiled; cached for later calls.

    Raises InputError as `dbc.parse_codec`.
    """
    return parse_codec(text, name)
