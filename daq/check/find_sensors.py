"""Finds the sensors on each bus, from databases and traffic: one proposal for each device.

A database whose identifiers come on two buses describes two sensors.  Unknown identifiers near
those of a database, with the same length and rate, are further devices of the same kind: CANopen
nodes, or a maker's offset.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import NamedTuple

from dbc import Codec
from dbc.frames import FrameBatch
from dbc.layout import MessageLayout
from dbc.words import plural

from ..bench.sensors import Database, Sensor, database_codec
from .frame_checks import Arrivals, frame_table
from .guess import Question, plain_name

Key = tuple[int, int, bool]
"""Bus, identifier and width of frames."""


class FoundSensor(NamedTuple):
    """A device that a database describes."""

    sensor: Sensor
    """Name, database, bus and identifiers of the device."""
    why: str
    """The reasons for the proposal."""
    surely: bool
    """False if the user should be asked."""

    @property
    def question(self) -> Question:
        """The question whether it is one of this bench."""
        return Question(f"sensor {self.sensor.name}: {self.why}", "y or n")


def find_sensors(
    databases: Sequence[Database], frames: FrameBatch | None
) -> tuple[list[FoundSensor], tuple[str, ...]]:
    """Return the sensors, and the names of the databases without any traffic.

    `frames`: None if there was no traffic: each database is then one sensor on the first bus.
    Raises InputError if a database cannot be used.
    """
    codecs = {each.name: database_codec(each.text, each.name) for each in databases}
    if frames is None:
        why = "no traffic: on the first bus"
        return _named([FoundSensor(Sensor("", name), why, True) for name in codecs]), ()
    traffic = {(a.buses[0], a.can_id, a.is_extended): a for a in frame_table((), frames).unknown}
    claimed: set[Key] = set()
    present: list[FoundSensor] = []
    for name, codec in codecs.items():
        for bus in sorted({key[0] for key in traffic}):
            if keys := _received(codec, traffic, bus):
                claimed |= keys
                why = f"{len(keys)} of its messages {plural(len(keys), 'comes', 'come')} there"
                present.append(FoundSensor(Sensor("", name, bus), why, True))
    for name, codec in codecs.items():
        for bus, offset in _offsets(codec.messages, traffic, claimed):
            keys = _received(codec, traffic, bus, offset)
            if keys and not keys & claimed:
                claimed |= keys
                ids = ", ".join(f"{key[1]:#x}" for key in sorted(keys))
                why = f"is {ids} yours, of this kind? Length and rate are as in its messages"
                present.append(FoundSensor(Sensor("", name, bus, offset), why, False))
    seen = {each.sensor.database for each in present}
    return _named(present), tuple(name for name in codecs if name not in seen)


def _received(codec: Codec, traffic: Mapping[Key, Arrivals], bus: int, offset: int = 0) -> set[Key]:
    """Return the received messages of a database on a bus, with an offset of their identifiers."""
    keys = {(bus, m.can_id + offset, m.is_extended) for m in codec.messages}
    return keys & traffic.keys()


def _offsets(
    messages: Sequence[MessageLayout], traffic: Mapping[Key, Arrivals], claimed: set[Key]
) -> list[tuple[int, int]]:
    """Return bus and identifier offset of further devices, those with the most messages first."""
    rates = {(can_id, is_extended): a.rate_hz for (_, can_id, is_extended), a in traffic.items()}
    votes: Counter[tuple[int, int]] = Counter()
    for key, arrivals in traffic.items():
        if key in claimed or len(arrivals.t_ns) < 10:
            continue
        bus, can_id, is_extended = key
        for m in messages:
            offset = can_id - m.can_id
            alike = (is_extended, arrivals.usual_length) == (m.is_extended, m.length)
            if not alike or not 0 < abs(offset) <= 0x7F:  # the number of CANopen nodes
                continue
            stated = 1 / m.cycle_s if m.cycle_s else None
            rate = rates.get((m.can_id, m.is_extended), stated)
            if rate is None:  # CANopen nodes have the same function code
                alike = not is_extended and can_id >> 7 == m.can_id >> 7
            else:
                alike = abs(arrivals.rate_hz - rate) <= 0.1 * rate
            if alike:
                votes[bus, offset] += 1
    return sorted(votes, key=lambda key: (-votes[key], abs(key[1]), key))


def _named(present: Sequence[FoundSensor]) -> list[FoundSensor]:
    """Give each device the name of its database, with a number if several have that name."""
    order = list(dict.fromkeys(each.sensor.database for each in present))
    devices = sorted(
        present,
        key=lambda p: (order.index(p.sensor.database), p.sensor.bus, p.sensor.id_offset),
    )
    files = [PurePath(each.sensor.database.removeprefix("layout:")) for each in devices]
    stems = [plain_name(file.stem.lower(), "sensor")[:24] for file in files]
    numbers: Counter[str] = Counter()
    named = []
    for each, stem in zip(devices, stems, strict=True):
        numbers[stem] += 1
        name = stem if stems.count(stem) == 1 else f"{stem}_{numbers[stem]}"
        named.append(each._replace(sensor=replace(each.sensor, name=name)))
    return named
