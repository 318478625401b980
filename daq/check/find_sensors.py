"""Finds the sensors on each bus, from databases and traffic: one proposal for each device.

A database whose identifiers come on two buses describes two sensors.  Unknown identifiers near
those of a database, with the same length and rate, are further devices of the same kind: CANopen
nodes, or a maker's offset.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from dbc import Codec
from dbc.frames import FrameBatch
from dbc.layout import MessageLayout
from dbc.words import counted, plural

from ..bench.databases import Database, database_codec, file_and_bus
from ..bench.sensors import Sensor
from .frame_checks import Arrivals, frame_table

_NEAREST = 0x7F
"""Largest difference of the identifiers of two devices of one kind: the number of CANopen nodes."""
_RATE_SHARE = 0.1
_FEWEST = 10
_NAME_LENGTH = 24


@dataclass(frozen=True, slots=True)
class FoundSensor:
    """A device that a database describes."""

    sensor: Sensor
    """Name, database, bus and identifiers of the device."""
    why: str
    """The reasons for the proposal."""
    surely: bool
    """False if the user should be asked."""


Traffic = Mapping[tuple[int, int, bool], Arrivals]
"""Frames by bus, identifier and width."""


def traffic_of(frames: FrameBatch) -> Traffic:
    """Return the data frames of a recording, which must not be empty, by bus and identifier."""
    strangers = frame_table((), frames).unknown
    return {(a.buses[0], a.can_id, a.is_extended): a for a in strangers}


def find_sensors(
    databases: Sequence[Database], traffic: Traffic | None
) -> tuple[tuple[FoundSensor, ...], tuple[str, ...]]:
    """Return the sensors, and the names of the databases without any traffic.

    `traffic`: None if there was none.  Each database is then one sensor on the first bus, or each
    bus of a file is a sensor on a separate bus.  Raises InputError if a database cannot be used.
    """
    codecs = {each.name: database_codec(each.text, each.name) for each in databases}
    if not traffic:
        return _named(_without_traffic(tuple(codecs))), ()
    own = _own_traffic(codecs, traffic)
    present: list[tuple[str, int, int, str, bool]] = []
    claimed: set[tuple[int, int, bool]] = set()
    for (name, bus), keys in own.items():
        claimed |= keys
        many = "messages of another one also come"
        also = counted(len(keys), "message of another one also comes", many)
        ask = f"is it this bus of the file? {also}"
        surely = not any(b == bus and _one_file(n, name) for n, b in own)
        come = plural(len(keys), "comes", "come")
        why = f"{len(keys)} of its messages {come} there" if surely else ask
        present.append((name, bus, 0, why, surely))
    for name, codec in codecs.items():
        for bus, offset in _offsets(codec.messages, traffic, claimed):
            moved = {
                (bus, m.can_id + offset, m.is_extended)
                for m in codec.messages
                if (bus, m.can_id + offset, m.is_extended) in traffic
            }
            if moved and not moved & claimed:
                claimed |= moved
                ids = ", ".join(f"{key[1]:#x}" for key in sorted(moved))
                why = f"is {ids} yours, of this kind? Length and rate are as in its messages"
                present.append((name, bus, offset, why, False))
    absent = tuple(name for name in codecs if name not in {each[0] for each in present})
    return _named(present), absent


def _own_traffic(
    codecs: Mapping[str, Codec], traffic: Traffic
) -> dict[tuple[str, int], set[tuple[int, int, bool]]]:
    """Return the received traffic of each database on each bus, without empty entries.

    A bus of the bench is one bus of a file: the one with the most traffic.  Equally likely buses
    are kept.
    """
    own = {
        (name, bus): {
            (bus, m.can_id, m.is_extended)
            for m in codec.messages
            if (bus, m.can_id, m.is_extended) in traffic
        }
        for name, codec in codecs.items()
        for bus in sorted({key[0] for key in traffic})
    }
    own = {key: keys for key, keys in own.items() if keys}
    is_part = {n for n in codecs if any(_one_file(n, other) for other in codecs)}
    while True:
        for (name, bus), keys in own.items():
            against = [
                (n, b)
                for n, b in own
                if (n == name and b != bus and n in is_part) or (b == bus and _one_file(n, name))
            ]
            if against and all(len(keys) > len(own[other]) for other in against):
                break
        else:
            return own
        own = {key: keys for key, keys in own.items() if key not in against}


def _one_file(name: str, other: str) -> bool:
    """Return True if the two names are two buses of one file."""
    (file, bus), (other_file, other_bus) = file_and_bus(name), file_and_bus(other)
    return bool(bus and other_bus) and (file, bus != other_bus) == (other_file, True)


def _without_traffic(names: Sequence[str]) -> list[tuple[str, int, int, str, bool]]:
    found = []
    for place, name in enumerate(names):
        bus = sum(_one_file(name, before) for before in names[:place])
        why = "no traffic: on a separate bus" if bus else "no traffic: on the first bus"
        found.append((name, bus, 0, why, True))
    return found


def _offsets(
    messages: Sequence[MessageLayout], traffic: Traffic, claimed: set[tuple[int, int, bool]]
) -> list[tuple[int, int]]:
    """Return bus and identifier offset of further devices, those with the most messages first."""
    seen = [(m, _rate_hz(m, traffic)) for m in messages]
    votes: Counter[tuple[int, int]] = Counter()
    for (bus, can_id, is_extended), arrivals in traffic.items():
        if (bus, can_id, is_extended) in claimed or len(arrivals.t_ns) < _FEWEST:
            continue
        for message, rate_hz in seen:
            offset = can_id - message.can_id
            alike = (is_extended, arrivals.usual_length) == (message.is_extended, message.length)
            if alike and 0 < abs(offset) <= _NEAREST and _same_rate(arrivals, rate_hz, message):
                votes[bus, offset] += 1
    return sorted(votes, key=lambda key: (-votes[key], abs(key[1]), key))


def _rate_hz(message: MessageLayout, traffic: Traffic) -> float | None:
    """Return the measured rate of a message, or the rate in the database if it was not received."""
    for (_, can_id, is_extended), arrivals in traffic.items():
        if (can_id, is_extended) == (message.can_id, message.is_extended):
            return arrivals.rate_hz
    return 1 / message.cycle_s if message.cycle_s else None


def _same_rate(arrivals: Arrivals, rate_hz: float | None, message: MessageLayout) -> bool:
    if rate_hz is None:  # CANopen nodes have the same function code
        return not message.is_extended and arrivals.can_id >> 7 == message.can_id >> 7
    return abs(arrivals.rate_hz - rate_hz) <= _RATE_SHARE * rate_hz


def _named(present: Sequence[tuple[str, int, int, str, bool]]) -> tuple[FoundSensor, ...]:
    """Give each device a name: that of its database, if necessary with its bus or a number."""
    by_stem: dict[str, list[tuple[str, int, int, str, bool]]] = defaultdict(list)
    for each in sorted(present, key=lambda p: (p[0], p[1], p[2])):
        by_stem[_stem(each[0])].append(each)
    found = []
    for stem, devices in by_stem.items():
        for number, (database, bus, offset, why, surely) in enumerate(devices, start=1):
            name = stem if len(devices) == 1 else f"{stem}_{number}"
            found.append(FoundSensor(Sensor(name, database, bus, offset), why, surely))
    order = {name: i for i, name in enumerate(dict.fromkeys(p[0] for p in present))}
    return tuple(sorted(found, key=lambda f: order[f.sensor.database]))


def _stem(database: str) -> str:
    file, bus = file_and_bus(database.removeprefix("layout:"))
    stem = bus or PurePath(file).stem
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in stem).strip("_").lower()
    plain = plain or "sensor"
    return (plain if plain[0].isalpha() else f"s_{plain}")[:_NAME_LENGTH]
