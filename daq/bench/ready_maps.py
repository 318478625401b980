"""Ready maps of common sensors: a DBC and a piece of bench.toml for each, in `daq/layouts`."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

from ..errors import InputError

PREFIX = "layout:"
"""What `dbc` in bench.toml begins with to name a ready map instead of a file."""

_FOLDER = files("daq") / "layouts"


@dataclass(frozen=True, slots=True)
class ReadyMap:
    """A sensor's layout as its public documents state it."""

    name: str
    title: str
    """`name`, `title`: what it is called here, and the sensor."""
    dbc_text: str
    bench_text: str
    """`dbc_text`, `bench_text`: its DBC, and `[[message]]`, `[[sample_set]]` and `[[channel]]`
    tables that fit it."""


def ready_map_names() -> tuple[str, ...]:
    """Return the names of all ready maps, sorted."""
    return tuple(
        sorted(
            entry.name.removesuffix(".dbc")
            for entry in _FOLDER.iterdir()
            if entry.name.endswith(".dbc")
        )
    )


def ready_map(name: str) -> ReadyMap:
    """Return one ready map.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if name not in ready_map_names():
        names = ", ".join(ready_map_names())
        raise InputError(f"{PREFIX}{name}", "there is no such layout", f"use one of {names}")
    bench = (_FOLDER / f"{name}.toml").read_text("utf-8")
    title = bench.partition("\n")[0].removeprefix("# ").rstrip(".")
    return ReadyMap(name, title, (_FOLDER / f"{name}.dbc").read_text("utf-8"), bench)
