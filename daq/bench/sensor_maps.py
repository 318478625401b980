"""Converts the ready maps of the sensors of a bench to tables of that bench."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from .ready_maps import PREFIX, ready_map


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
    for name, database in sensors:
        piece = sensor_map(name, database)
        prefix = f"{name}."
        if not any(_begins(t.get("signal"), prefix) for t in stated.get("channel", ())):
            added["channel"] += piece.get("channel", [])
        added["message"] += [m for m in piece.get("message", []) if m["name"] not in messages]
        own_sets = (m for t in stated.get("sample_set", ()) for m in t.get("messages", ()))
        if not any(_begins(message, prefix) for message in own_sets):
            added["sample_set"] += piece.get("sample_set", [])
    return added


def _begins(value: object, prefix: str) -> bool:
    return isinstance(value, str) and value.startswith(prefix)
