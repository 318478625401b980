"""Builds the messages of a bench's sensors: database, bus and identifiers of each sensor.

The codec of a bench with a list of sensors names a message ``sensor.Message``, so that the messages
of two sensors of one database, and messages of one name in two databases, are different.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from dbc import Codec
from dbc.finding import Finding, Severity
from dbc.layout import MessageLayout

from ..errors import InputError
from .databases import Database, database_codec

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
