"""Builds the messages of a bench: databases, ready maps, buses, identifiers, rules, sample sets.

The codec of a bench with a list of sensors names a message ``sensor.Message``, so that the messages
of two sensors of one database, and messages of one name in two databases, are different.
"""

from __future__ import annotations

import json
import tomllib
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from dbc import Codec, parse_codec, read_dbc, shipped_dbc
from dbc.codec import CRC_RULES, CounterRule, MessageLayout, SignalLayout
from dbc.units import known_si
from dbc.words import Finding, InputError, Severity

from ..channels import sensor_of
from .toml_file import NO_KEY, Table

PREFIX = "layout:"
"""Prefix of `dbc` in bench.toml that names a ready map instead of a file."""
CORRECT_MESSAGE = "correct that [[message]] in bench.toml"
_CORRECT_SET = "correct that [[sample_set]] in bench.toml"


# Ready maps: a DBC and a part of bench.toml for each of some common sensors ----------------------

_FOLDER = files("daq") / "layouts"


@dataclass(frozen=True, slots=True)
class ReadyMap:
    """A sensor's layout as its public documents state it."""

    title: str
    dbc_text: str
    tables: dict[str, Any]
    """`message`, `sample_set` and `channel` tables of a bench.toml that fits the DBC."""


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
    dbc_text = (_FOLDER / f"{name}.dbc").read_text("utf-8")
    return ReadyMap(title, dbc_text, tomllib.loads(bench))


def sensor_map(sensor: str, database: str) -> dict[str, Any]:
    """Return the tables of a sensor's ready map; empty if its database is a file.

    Names of messages, signals, sample sets and channels begin with the name of the sensor; they
    are unchanged if that is empty.
    """
    if not database.startswith(PREFIX):
        return {}
    tables = ready_map(database.removeprefix(PREFIX)).tables
    if not sensor:
        return tables
    for message in tables.get("message", []):
        message["name"] = f"{sensor}.{message['name']}"
    for sample_set in tables.get("sample_set", []):
        sample_set["name"] = f"{sensor}_{sample_set['name']}"
        sample_set["messages"] = [f"{sensor}.{name}" for name in sample_set["messages"]]
        if "." in sample_set["bound_by"]:  # else the name of a counter in each message
            sample_set["bound_by"] = f"{sensor}.{sample_set['bound_by']}"
    for channel in tables.get("channel", []):
        channel["name"] = f"{sensor}_{channel['name']}"
        channel["signal"] = f"{sensor}.{channel['signal']}"
    return tables


def completed(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a bench.toml with those that it does not state.

    The channels of a sensor's ready map are added unless bench.toml has a channel of that sensor; a
    message or sample set unless it has one of that name or of that sensor.  A bench with one DBC
    takes them from its ready map, or its channels from the shipped bench.
    """
    channels, messages, sets = (
        list(document.get(kind, ())) for kind in ("channel", "message", "sample_set")
    )
    stated_messages = {message["name"] for message in messages}
    signals = [channel["signal"] for channel in channels]
    in_sets = [name for sample_set in sets for name in sample_set["messages"]]
    database_of = {  # by the name of the sensor
        sensor["name"]: f"{PREFIX}{sensor['layout']}" if sensor.get("layout") else sensor["dbc"]
        for sensor in document.get("sensor", ())
    }
    for sensor, database in (database_of or {"": document.get("dbc", "")}).items():
        tables, prefix = sensor_map(sensor, database), f"{sensor}." if sensor else ""
        if not sensor and not tables:
            shipped = tomllib.loads((files("daq") / "bench.toml").read_text("utf-8"))
            tables = {"channel": shipped["channel"]}
        if not any(signal.startswith(prefix) for signal in signals):
            channels += tables.get("channel", [])
        if not any(name.startswith(prefix) for name in in_sets):
            sets += tables.get("sample_set", [])
        messages += [m for m in tables.get("message", []) if m["name"] not in stated_messages]
    return {**document, "channel": channels, "message": messages, "sample_set": sets}


# The databases of a bench -------------------------------------------------------------------------

Databases = Mapping[str, str]
"""The text of each database by its name in bench.toml: a path, or ``layout:NAME``; empty if
bench.toml names none."""
_KEY = "bumpbench_databases"


def read_databases(names: Iterable[str], folder: Path) -> Databases:
    """Return the databases of these names; the shipped DBC for an empty one.

    `folder`: where relative paths start.  Raises InputError if one cannot be read.
    """
    databases = {}
    for name in names:
        if name.startswith(PREFIX):
            databases[name] = ready_map(name.removeprefix(PREFIX)).dbc_text
        else:
            databases[name] = read_dbc(folder / name) if name else shipped_dbc()
    return databases


def stored_text(databases: Databases) -> str:
    """Return the text that journals and sessions store: the only DBC, or all of them in JSON."""
    if len(databases) == 1:
        return next(iter(databases.values()))
    return json.dumps({_KEY: dict(databases)}, indent=1)


def stored_databases(text: str) -> Databases:
    """Return the databases in a text of `stored_text`; none if it is empty.

    Raises InputError if it is damaged.
    """
    if not text.lstrip().startswith("{"):
        return {"": text} if text else {}
    try:
        return dict(json.loads(text)[_KEY])
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        fault = "the list of databases is damaged"
        raise InputError("bench", fault, "name the databases with --config") from error


database_codec = lru_cache(maxsize=32)(parse_codec)
"""Returns a database compiled, as `parse_codec`, from its text and name; cached for later calls."""


# The messages of the sensors ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Sensor:
    """One `[[sensor]]`: a device, its database or ready map, and its bus."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=30)]
    """Stands before the dot in the names of its messages and signals."""
    dbc: str = ""
    """Path of its database, or ``layout:NAME``."""
    layout: str = ""
    """Name of its ready map, instead of `dbc`."""
    bus: Annotated[int, Field(ge=0)] | str | None = None
    """Its bus by name, channel or position; may be omitted if there is one bus."""
    id_offset: int = 0
    """Difference between its identifiers and those of the database."""
    ids: Mapping[str, Annotated[int, Field(ge=0)]] = field(default_factory=dict)
    """Identifiers of its messages, by name or by identifier in the database, as ``0x181``; the
    sensor does not send other messages.  Empty: all messages of the database, unchanged."""
    bus_position: Annotated[int, NO_KEY] = 0
    """Position of its bus in the bench, from 0."""

    @model_validator(mode="after")
    def _one_description(self) -> Sensor:
        if bool(self.dbc) == bool(self.layout):
            raise ValueError("a sensor has either dbc or layout")
        if self.id_offset and self.ids:
            raise ValueError("a sensor has either id_offset or ids")
        return self

    @property
    def database(self) -> str:
        """The name of its database: a path, or ``layout:NAME``."""
        return f"{PREFIX}{self.layout}" if self.layout else self.dbc


def sensors_codec(
    sensors: Sequence[Sensor], databases: Databases, n_buses: int, used: Collection[str] = ()
) -> Codec:
    """Return the messages of all sensors, each on its bus, under their full names.

    With one bus, frames of any bus number are accepted, because logs number their buses in
    different ways.  If two sensors have the same identifier on one bus, the message in `used` (the
    names that bench.toml refers to) is read and the other one is left out.

    Raises InputError if a database or identifier cannot be used, or two messages in use share one.
    """
    by_id: dict[tuple[int | None, int, bool], list[MessageLayout]] = defaultdict(list)
    left_out: dict[Finding, None] = {}  # each once, in order
    for sensor in sensors:
        # A single database is that of every sensor, whatever its name.
        name = next(iter(databases)) if len(databases) == 1 else sensor.database
        if name not in databases:
            fault = f"the database {name} is missing"
            advice = "correct that [[sensor]] in bench.toml"
            raise InputError(f"sensor {sensor.name}", fault, advice)
        codec = database_codec(databases[name], sensor.database)
        left_out |= dict.fromkeys(codec.left_out)
        for message in _sent_messages(sensor, codec, sensor.bus_position if n_buses > 1 else None):
            by_id[message.bus, message.can_id, message.is_extended].append(message)
    readable: list[MessageLayout] = []  # at most one of each bus and identifier
    for (_, can_id, _), messages in by_id.items():
        in_use = messages if len(messages) == 1 else [m for m in messages if m.name in used]
        conflict = f"have the identifier {can_id:#x} on a bus"
        if len(in_use) > 1:
            advice = "give one of the two sensors another bus, an id_offset or ids"
            names = f"{in_use[0].name} and {in_use[1].name}"
            raise InputError("bench.toml", f"{names} {conflict}", advice)
        readable += in_use
        names = " and ".join(message.name for message in messages)
        for message in messages:
            if message not in in_use:
                subject = f"message {message.name}"
                text = f"{subject} is left out: {names} {conflict}"
                left_out[Finding("left_out", Severity.ERROR, text, subject)] = None
    return Codec(tuple(readable), tuple(left_out))


def _sent_messages(sensor: Sensor, codec: Codec, bus: int | None) -> list[MessageLayout]:
    """Return the messages of a database as one sensor sends them on a bus (None: on any bus)."""
    where = f"sensor {sensor.name}"
    sent, used_keys = [], set()
    for message in codec.messages:
        names = (message.name, f"{message.can_id:#x}")
        key = next((key for key in sensor.ids if key in names or key.lower() in names), None)
        if key is None and sensor.ids:
            continue  # the sensor does not send it
        used_keys.add(key)
        can_id = message.can_id + sensor.id_offset if key is None else sensor.ids[key]
        bits = 29 if message.is_extended else 11
        if not 0 <= can_id < 1 << bits:
            fault = f"{message.name} would have the identifier {can_id:#x}, not one of {bits} bits"
            raise InputError(where, fault, "correct id_offset or ids")
        name = f"{sensor.name}.{message.name}"
        sent.append(replace(message, name=name, can_id=can_id, bus=bus))
    for key in sensor.ids:
        if key not in used_keys:
            fault = f"ids names {key}, which is not in {sensor.database}"
            raise InputError(where, fault, "name a message of the database, or its identifier")
    return sent


def full_name(signal: str, messages: Sequence[MessageLayout]) -> str:
    """Return ``sensor.Message.signal`` for a signal written in that form or as ``sensor.signal``.

    A name that is in no message is returned unchanged.  Raises InputError if several messages of
    the sensor have the signal.
    """
    owner, _, name = signal.rpartition(".")  # `sensor.Message`, or only `sensor`
    names = [
        message.name
        for message in messages
        if owner in (message.name, sensor_of(message.name))
        and any(s.name == name for s in message.signals)
    ]
    if owner in names:
        return signal
    if len(names) > 1:
        fault = f"{signal} is in {' and in '.join(names[:2])}"
        raise InputError("bench.toml", fault, f"write {names[0]}.{name} or {names[1]}.{name}")
    return f"{names[0]}.{name}" if names else signal


# What bench.toml adds to the DBC: cycle, counter, checksum, time, sample sets --------------------


class MessageRule(Table):
    """One `[[message]]`: properties of a message that its DBC does not state."""

    name: str
    cycle_ms: Annotated[float, Field(gt=0)] | None = None
    """Time between two frames, ms, instead of that of the DBC."""
    counter: str | None = None
    counter_modulus: Annotated[int, Field(ge=2, le=1 << 32)] | None = None
    """Number of values of the counter; None: all values of its bits."""
    crc: str | None = None
    """Signal that holds its checksum."""
    crc_rule: str = "crc8_j1850"
    """Rule by which the checksum is computed, one of `dbc.codec.CRC_RULES`."""
    time_signal: str | None = None
    """Signal that holds the sensor's own time."""
    time_unit: Annotated[str, Field(max_length=16)] = ""
    """Its unit if the DBC states none or a wrong one; empty: as in the DBC."""
    time_wrap: Annotated[float, Field(gt=0)] | None = None
    """Value at which it starts again from 0, in its unit; None: at the end of its bits."""


class SampleSet(Table):
    """One `[[sample_set]]`: messages that carry one sample together."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=60)]
    """Name of their sample group."""
    messages: Annotated[tuple[str, ...], Field(min_length=1)]
    bound_by: str
    """``Message.signal``: a counter or time stamp in a separate frame that is sent in one burst
    with the others; or the name of a counter that each of the messages has."""

    @property
    def carrier(self) -> tuple[str, str]:
        """Message and signal by which the sets are numbered."""
        message, dot, signal = self.bound_by.rpartition(".")
        return (message, signal) if dot else (self.messages[0], self.bound_by)


@dataclass(frozen=True, slots=True)
class SensorClock:
    """A time stamp signal, resolved."""

    signal: str
    """``Message.signal``."""
    factor: float
    """Seconds per unit of the signal."""
    wrap: float
    """Value at which it starts again from 0, in its unit."""


def ruled_codec(codec: Codec, rules: Sequence[MessageRule], dbc_name: str) -> Codec:
    """Return the codec with the rules of bench.toml; applying them twice changes nothing.

    Raises InputError if a rule names what is not in the DBC, or a signal unfit for its role.
    """
    messages = {message.name: message for message in codec.messages}
    for rule in rules:
        where = f"message {rule.name}"
        if rule.name not in messages:
            raise InputError(where, f"is not in {dbc_name}", CORRECT_MESSAGE)
        message, fault = messages[rule.name], ""
        if rule.counter is not None:
            signal = _plain_signal(message, "counter", rule.counter)
            modulus = rule.counter_modulus or 1 << min(signal.length, 33)
            if signal.length > 32 or modulus > 1 << signal.length:
                fault = f"counter {signal.name} of {signal.length} bits cannot run to {modulus}"
            message = replace(message, counter=CounterRule(signal.name, modulus))
        if rule.crc is not None:
            signal = _plain_signal(message, "crc", rule.crc)
            if not signal.is_one_byte:
                fault = f"checksum {signal.name} is not one whole byte"
            if rule.crc_rule not in CRC_RULES:
                fault = f"crc_rule {rule.crc_rule} is none of {', '.join(CRC_RULES)}"
            message = replace(message, crc=signal.name, crc_rule=rule.crc_rule)
        if fault:
            raise InputError(where, fault, CORRECT_MESSAGE)
        if rule.cycle_ms is not None:
            message = replace(message, cycle_s=rule.cycle_ms * 1e-3)
        messages[rule.name] = message
    ruled = tuple(messages.values())
    return codec if ruled == codec.messages else replace(codec, messages=ruled)


def _plain_signal(message: MessageLayout, key: str, name: str) -> SignalLayout:
    """Return a signal that is an unsigned whole number in every frame."""
    signal = _signal(message, key, name, CORRECT_MESSAGE)
    if not signal.is_plain:
        fault = f"{name} is not a plain unsigned number"
        raise InputError(f"message {message.name}", fault, CORRECT_MESSAGE)
    return signal


def _signal(message: MessageLayout, key: str, name: str, advice: str) -> SignalLayout:
    """Return the signal that a key of bench.toml names."""
    try:
        return message.signal(name)
    except KeyError as error:
        fault = f"has no signal {name}, which {key} names"
        raise InputError(f"message {message.name}", fault, advice) from error


def sensor_clocks(codec: Codec, rules: Sequence[MessageRule]) -> Mapping[str, SensorClock]:
    """Return the time stamps of the messages that have one, by message name.

    Raises InputError if a time signal is missing, is not a time, or has no wrap.
    """
    clocks = {}
    for rule in rules:
        if not rule.time_signal or rule.name not in codec.by_name:
            continue
        where, name = f"message {rule.name}", rule.time_signal
        signal = _signal(codec.by_name[rule.name], "time_signal", name, CORRECT_MESSAGE)
        unit = rule.time_unit or signal.unit
        si = known_si(unit)
        if si is None or si.unit != "s" or signal.selector is not None:
            fault = f"time signal {name} has the unit {unit!r}, not one of time"
            raise InputError(where, fault, "state time_unit as s, ms, us or ns")
        if rule.time_wrap is None and signal.is_float:
            fault = f"time signal {name} is a float, whose bits set no wrap"
            raise InputError(where, fault, "state time_wrap in its unit")
        wrap = rule.time_wrap or abs(signal.factor) * float(1 << signal.length)
        clocks[rule.name] = SensorClock(f"{rule.name}.{name}", si.factor, wrap)
    return clocks


def timed_messages(codec: Codec, rules: Sequence[MessageRule]) -> frozenset[str]:
    """Return the messages that carry the time of their samples as a counter or time stamp."""
    numbered = {m.name for m in codec.messages if m.counter is not None and m.cycle_s is not None}
    return frozenset(numbered | sensor_clocks(codec, rules).keys())


def check_sets(codec: Codec, rules: Sequence[MessageRule], sets: Sequence[SampleSet]) -> None:
    """Check that the messages of every set can be bound.

    Raises InputError if a message or the binding signal is missing, a message is in two sets, or
    the signal is neither a counter nor a time stamp.
    """
    messages = codec.by_name
    clocks = sensor_clocks(codec, rules)
    set_of: dict[str, str] = {}
    for sample_set in sets:
        where = f"sample set {sample_set.name}"
        carrier, signal = sample_set.carrier
        for name in (*sample_set.messages, carrier):
            if name not in messages:
                raise InputError(where, f"the DBC has no message {name}", _CORRECT_SET)
        for name in sample_set.messages:
            if name in set_of:
                raise InputError(where, f"{name} is also in {set_of[name]}", _CORRECT_SET)
            set_of[name] = sample_set.name
        _signal(messages[carrier], "bound_by", signal, _CORRECT_SET)
        counter = messages[carrier].counter
        is_time = carrier in clocks and clocks[carrier].signal == f"{carrier}.{signal}"
        if not is_time and (counter is None or counter.signal != signal):
            fault = f"{carrier}.{signal} is neither the counter nor the time_signal of its message"
            raise InputError(where, fault, f"state it in [[message]] name = {carrier!r}")
        if not is_time and messages[carrier].cycle_s is None:
            fault = f"{carrier} has no cycle time, and a counter alone gives no time"
            raise InputError(where, fault, f"state cycle_ms in [[message]] name = {carrier!r}")
