"""Reads ready maps of common sensors: a DBC and a part of bench.toml for each, in `daq/layouts`."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

from ..errors import InputError

PREFIX = "layout:"
"""Prefix of `dbc` in bench.toml that names a ready map instead of a file."""

_FOLDER = files("daq") / "layouts"


@dataclass(frozen=True, slots=True)
class ReadyMap:
    """A sensor's layout as its public documents state it."""

    name: str
    """Name of the layout in bench.toml, after the prefix."""
    title: str
    """Name of the sensor."""
    dbc_text: str
    """Its DBC."""
    bench_text: str
    """`[[message]]`, `[[sample_set]]` and `[[channel]]` tables that fit the DBC."""


def ready_map_names() -> tuple[str, ...]:
    """Return the names of all ready maps, sorted."""
    files = (entry.name for entry in _FOLDER.iterdir())
    return tuple(sorted(name.removesuffix(".dbc") for name in files if name.endswith(".dbc")))


def ready_map(name: str) -> ReadyMap:
    """Return one ready map.

    Raises InputError if there is none of this name.
    """
    if name not in ready_map_names():
        names = ", ".join(ready_map_names())
        raise InputError(f"{PREFIX}{name}", "there is no such layout", f"use one of {names}")
    bench = (_FOLDER / f"{name}.toml").read_text("utf-8")
    title = bench.partition("\n")[0].removeprefix("# ").rstrip(".")
    return ReadyMap(name, title, (_FOLDER / f"{name}.dbc").read_text("utf-8"), bench)
