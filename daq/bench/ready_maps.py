"""Reads ready maps of common sensors: a DBC and a part of bench.toml for each, in `daq/layouts`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

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


def sensor_map(sensor: str, database: str) -> dict[str, Any]:
    """Return the tables of a sensor's ready map under its name; empty if it has none.

    Names of messages, signals, sample sets and channels begin with the name of the sensor.
    """
    if not database.startswith(PREFIX):
        return {}
    piece = tomllib.loads(ready_map(database.removeprefix(PREFIX)).bench_text)
    for message in piece.get("message", []):
        message["name"] = f"{sensor}.{message['name']}"
    for each in piece.get("sample_set", []):
        each["name"] = f"{sensor}_{each['name']}"
        each["messages"] = [f"{sensor}.{name}" for name in each["messages"]]
        if "." in each["bound_by"]:
            each["bound_by"] = f"{sensor}.{each['bound_by']}"
    for channel in piece.get("channel", []):
        channel["name"] = f"{sensor}_{channel['name']}"
        channel["signal"] = f"{sensor}.{channel['signal']}"
    return piece


def ready_tables(
    sensors: Sequence[tuple[str, str]], stated: Mapping[str, Sequence[Mapping[str, Any]]]
) -> dict[str, list[dict[str, Any]]]:
    """Return the tables that the ready maps add to those that bench.toml states.

    `sensors`: name and database of each.  `stated`: the tables of bench.toml by kind.  The channels
    of a sensor's ready map are added unless bench.toml has a channel of that sensor.  A message or
    sample set is added unless bench.toml has one of that name or of that sensor.
    """
    added: dict[str, list[dict[str, Any]]] = {"message": [], "sample_set": [], "channel": []}
    messages = {str(table.get("name")) for table in stated.get("message", ())}
    signals = [str(table.get("signal")) for table in stated.get("channel", ())]
    in_sets = [str(m) for table in stated.get("sample_set", ()) for m in table.get("messages", ())]
    for name, database in sensors:
        piece, prefix = sensor_map(name, database), f"{name}."
        if not any(signal.startswith(prefix) for signal in signals):
            added["channel"] += piece.get("channel", [])
        added["message"] += [m for m in piece.get("message", []) if m["name"] not in messages]
        if not any(message.startswith(prefix) for message in in_sets):
            added["sample_set"] += piece.get("sample_set", [])
    return added
