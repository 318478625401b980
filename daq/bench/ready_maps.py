"""Reads ready maps of common sensors: a DBC and a part of bench.toml for each, in `daq/layouts`.

Completes the tables of a bench.toml by those of its ready maps, or of the shipped bench.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
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
    names = (entry.name for entry in _FOLDER.iterdir())
    return tuple(sorted(name.removesuffix(".dbc") for name in names if name.endswith(".dbc")))


def ready_map(name: str) -> ReadyMap:
    """Return one ready map; raises InputError if there is none of this name."""
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


def completed(document: Mapping[str, Any], shipped: str) -> dict[str, Any]:
    """Return the tables of a bench.toml with those that it does not state.

    The channels of a sensor's ready map are added unless bench.toml has a channel of that sensor; a
    message or sample set unless it has one of that name or of that sensor.  A bench with one DBC
    takes them from its ready map, or its channels from `shipped`, the text of the shipped bench.
    """
    channels, messages, sets = (
        list(document.get(kind, ())) for kind in ("channel", "message", "sample_set")
    )
    named = {message["name"] for message in messages}
    signals = [channel["signal"] for channel in channels]
    in_sets = [name for each in sets for name in each["messages"]]
    dbc = document.get("dbc", "")
    pieces = []
    for sensor in document.get("sensor", ()):
        layout = sensor.get("layout")
        database = f"{PREFIX}{layout}" if layout else sensor["dbc"]
        pieces.append((f"{sensor['name']}.", sensor_map(sensor["name"], database)))
    if not pieces and dbc.startswith(PREFIX):
        pieces = [("", tomllib.loads(ready_map(dbc.removeprefix(PREFIX)).bench_text))]
    elif not pieces:
        pieces = [("", {"channel": tomllib.loads(shipped)["channel"]})]
    for prefix, piece in pieces:
        if not any(signal.startswith(prefix) for signal in signals):
            channels += piece.get("channel", [])
        if not any(name.startswith(prefix) for name in in_sets):
            sets += piece.get("sample_set", [])
        messages += [m for m in piece.get("message", []) if m["name"] not in named]
    return {**document, "channel": channels, "message": messages, "sample_set": sets}
