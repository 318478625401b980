"""Joins the databases of a bench to one text, which journals and sessions store.

A single database is stored as its own text.  Several databases are stored as a JSON document with
the names by which bench.toml refers to them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePath

from dbc import Codec, parse_codec, split_by_bus

from ..errors import InputError

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
        found = json.loads(text)[_KEY]
        return tuple(Database(str(name), str(each)) for name, each in found.items())
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        what = "the list of databases is damaged"
        raise InputError("bench", what, "name the databases with --config") from error


def database_text(databases: Sequence[Database], name: str) -> str | None:
    """Return the text of the database called `name`; a single database has every name."""
    if len(databases) == 1:
        return databases[0].text
    return next((each.text for each in databases if each.name == name), None)


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
