"""The databases of a bench as one text, as journals and sessions carry them.

One database is its own text, as it always was.  Several are a JSON document with the names under
which bench.toml refers to them.
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
"""Stands between a file and one of its buses, as `dbc.read_dbc` reads them."""
_KEY = "bumpbench_databases"


@dataclass(frozen=True, slots=True)
class Database:
    """A database of a bench."""

    name: str
    """Its place as bench.toml states it: a path, or ``layout:NAME``; empty if it states none."""
    text: str
    """Its content."""


def stored_text(databases: Sequence[Database]) -> str:
    """Return the text that journals and sessions carry."""
    if len(databases) == 1:
        return databases[0].text
    return json.dumps({_KEY: {each.name: each.text for each in databases}}, indent=1)


def stored_databases(text: str) -> tuple[Database, ...]:
    """Return the databases in such a text; none in an empty one.

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
    """Return the text of the database called `name`; the only one has any name."""
    if len(databases) == 1:
        return databases[0].text
    return next((each.text for each in databases if each.name == name), None)


def each_bus(database: Database) -> tuple[Database, ...]:
    """Return a database of several buses as one for each, called ``FILE#BUS``; others as they are.

    Each has the part of its own bus as its text.
    """
    parts = split_by_bus(database.text, database.name)
    if len(parts) < 2:
        return (database,)
    return tuple(Database(f"{database.name}{_BUS_MARK}{bus}", text) for bus, text in parts.items())


def file_and_bus(name: str) -> tuple[str, str]:
    """Return the file and the bus in the name of a database; no bus if it names none."""
    file, _, bus = name.rpartition(_BUS_MARK)
    return (file, bus) if PurePath(file).suffix else (name, "")


@lru_cache(maxsize=32)
def database_codec(text: str, name: str) -> Codec:
    """Return a database compiled; once for all that ask.

    Raises InputError as `dbc.parse_codec`.
    """
    return parse_codec(text, name)
