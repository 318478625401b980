"""Builds the messages of a bench's sensors: databases, ready maps, buses and identifiers.

The codec of a bench with a list of sensors names a message ``sensor.Message``, so that the messages
of two sensors of one database, and messages of one name in two databases, are different.
"""

from __future__ import annotations

import json
import tomllib
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

from dbc import Codec, parse_codec, read_dbc, shipped_dbc
from dbc.finding import Finding, Severity
from dbc.layout import MessageLayout

from ..errors import InputError
from .toml_file import Place, line_of

PREFIX = "layout:"
"""Prefix of `dbc` in bench.toml that names a ready map instead of a file."""
_FOLDER = files("daq") / "layouts"
"""A DBC and a part of bench.toml for each ready map of a common sensor."""


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


# The databases of a bench -------------------------------------------------------------------------


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
    """Return the databases in a text of `stored_text`, one DBC or JSON; none if it is empty.

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


@lru_cache(maxsize=32)
def database_codec(text: str, name: str) -> Codec:
    """Return a database compiled; cached for later calls.

    Raises InputError as `dbc.parse_codec`.
    """
    return parse_codec(text, name)


# The messages of the sensors ----------------------------------------------------------------------


CORRECT_SENSOR = "correct that [[sensor]] in bench.toml"
_BITS = {False: 11, True: 29}


@dataclass(frozen=True, slots=True)
class Sensor:
    """One device that sends on a bus."""

    name: str
    """Name; before the dot in the names of its messages and signals."""
    database: str
    """Name of its database in bench.toml: a path, or ``layout:NAME``."""
    bus: int = 0
    """Position of its bus in the bench."""
    id_offset: int = 0
    """Difference between its identifiers and those of the database."""
    ids: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Identifiers of its messages, by name or by identifier in the database, as ``0x181``; the
    sensor does not send other messages.  Empty: all messages, with the identifiers of the
    database."""


def sensors_codec(
    sensors: Sequence[Sensor],
    databases: Sequence[Database],
    n_buses: int,
    used: Collection[str] = (),
) -> Codec:
    """Return the messages of all sensors, each on its bus, under their full names.

    `n_buses`: number of buses; if it is 1, frames of any bus number are accepted, because logs
    number their buses in different ways.  `used`: messages that bench.toml refers to.  If two
    sensors have the same identifier on one bus, the message in use is kept and the other one is
    left out.

    Raises InputError if a database or an identifier cannot be used, or two messages in use have the
    same identifier.
    """
    messages: list[MessageLayout] = []
    left_out: dict[Finding, None] = {}
    notes: dict[Finding, None] = {}
    for sensor in sensors:
        # A single database has every name.
        only = len(databases) == 1
        texts = [each.text for each in databases if only or each.name == sensor.database]
        if not texts:
            what = f"the database {sensor.database} is missing"
            raise InputError(f"sensor {sensor.name}", what, CORRECT_SENSOR)
        codec = database_codec(texts[0], sensor.database)
        left_out |= dict.fromkeys(codec.left_out)
        notes |= dict.fromkeys(codec.notes)
        messages += _own_messages(sensor, codec, sensor.bus if n_buses > 1 else None)
    kept, lost = _one_each(messages, used)
    return Codec(tuple(kept), (*left_out, *lost), tuple(notes))


def _own_messages(sensor: Sensor, codec: Codec, bus: int | None) -> list[MessageLayout]:
    """Return the messages of a database as one sensor sends them, with its identifiers."""
    where = f"sensor {sensor.name}"
    sent = []
    for message in codec.messages:
        keys = [key for key in sensor.ids if key == message.name or _number(key) == message.can_id]
        if sensor.ids and not keys:
            continue
        can_id = sensor.ids[keys[0]] if keys else message.can_id + sensor.id_offset
        bits = _BITS[message.is_extended]
        if not 0 <= can_id < 1 << bits:
            what = f"{message.name} would have the identifier {can_id:#x}, not one of {bits} bits"
            raise InputError(where, what, "correct id_offset or ids")
        full = f"{sensor.name}.{message.name}"
        sent.append(replace(message, name=full, can_id=can_id, bus=bus))
    names = {message.name for message in codec.messages}
    numbers = {message.can_id for message in codec.messages}
    for key in sensor.ids:
        if key not in names and _number(key) not in numbers:
            what = f"ids names {key}, which is not in {sensor.database}"
            raise InputError(where, what, "name a message of the database, or its identifier")
    return sent


def _number(key: str) -> int | None:
    """Return the identifier that a key of `ids` writes, as ``0x181``; None if it is a name."""
    try:
        return int(key, 0)
    except ValueError:
        return None


def _one_each(
    messages: Sequence[MessageLayout], used: Collection[str]
) -> tuple[list[MessageLayout], list[Finding]]:
    """Return the messages with a unique identifier, and findings on those left out."""
    by_key: dict[tuple[int | None, int, bool], list[MessageLayout]] = defaultdict(list)
    for message in messages:
        by_key[message.bus, message.can_id, message.is_extended].append(message)
    lost: dict[str, Finding] = {}
    for (_, can_id, _), same in by_key.items():
        if len(same) == 1:
            continue
        wanted = [message for message in same if message.name in used]
        if len(wanted) > 1:
            what = f"{wanted[0].name} and {wanted[1].name} have the identifier {can_id:#x} on a bus"
            advice = "give one of the two sensors another bus, an id_offset or ids"
            raise InputError("bench.toml", what, advice)
        names = " and ".join(message.name for message in same)
        for message in same:
            if message not in wanted:
                text = f"message {message.name} is left out: {names} have the identifier"
                subject = f"message {message.name}"
                lost[message.name] = Finding(
                    "left_out", Severity.ERROR, f"{text} {can_id:#x} on a bus", subject
                )
    return [message for message in messages if message.name not in lost], list(lost.values())


def full_name(signal: str, messages: Sequence[MessageLayout]) -> str:
    """Return ``sensor.Message.signal`` for a signal written in that form or as ``sensor.signal``.

    A name that is in no message is returned unchanged.  Raises InputError if several messages of
    the sensor have the signal.
    """
    owner, _, name = signal.rpartition(".")
    names = [
        message.name
        for message in messages
        if owner in (message.name, message.name.rpartition(".")[0])
        and any(s.name == name for s in message.signals)
    ]
    if owner in names:
        return signal
    if len(names) > 1:
        what = f"{signal} is in {' and in '.join(names[:2])}"
        raise InputError("bench.toml", what, f"write {names[0]}.{name} or {names[1]}.{name}")
    return f"{names[0]}.{name}" if names else signal
