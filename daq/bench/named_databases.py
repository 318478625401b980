"""Reads the databases that a bench.toml names; an error names the line that names the database."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dbc import read_dbc, shipped_dbc

from ..errors import InputError
from .bench_tables import BenchFile, SensorTable
from .databases import Database, stored_text
from .mistakes import Place, line_of
from .ready_maps import PREFIX, ready_map


def database_name(sensor: SensorTable) -> str:
    """Return the name of a sensor's database: a path, or ``layout:NAME``."""
    return f"{PREFIX}{sensor.layout}" if sensor.layout else sensor.dbc


def check_ready_maps(table: BenchFile, text: str, where: str) -> None:
    """Raise InputError, with the line of bench.toml, if there is no ready map of a name.

    `text` and `where`: the bench.toml and its name.
    """
    for name, place in _names(table).items():
        if name.startswith(PREFIX):
            with _named_at(text, where, place):
                ready_map(name.removeprefix(PREFIX))


def read_named(table: BenchFile, text: str, where: str, folder: Path) -> str:
    """Return the databases of a bench as journals and sessions store them.

    `text` and `where`: the bench.toml and its name.  `folder`: where relative paths start.
    Raises InputError, with the line of bench.toml, if one cannot be read.
    """
    read = []
    for name, place in _names(table).items():
        with _named_at(text, where, place):
            read.append(Database(name, _content(name, folder)))
    return stored_text(read)


def _names(table: BenchFile) -> dict[str, Place]:
    """Return the names of the databases, and the first key that states each."""
    if not table.sensor:
        return {table.dbc: ("dbc",)}
    places: dict[str, Place] = {}
    for position, sensor in enumerate(table.sensor):
        key = "layout" if sensor.layout else "dbc"
        places.setdefault(database_name(sensor), ("sensor", position, key))
    return places


def _content(name: str, folder: Path) -> str:
    if name.startswith(PREFIX):
        return ready_map(name.removeprefix(PREFIX)).dbc_text
    return read_dbc(folder / name) if name else shipped_dbc()


@contextmanager
def _named_at(text: str, where: str, place: Place) -> Iterator[None]:
    """Add file, line and key of bench.toml to an InputError about a database that it names."""
    try:
        yield
    except InputError as error:
        line = line_of(text, place)
        key = ".".join(str(part) for part in place)
        what = f"{key}: {error.where}: {error.what}"
        raise InputError(f"{where}:{line}" if line else where, what, error.advice) from error
