"""Reads `[[sensor]]` of bench.toml: the bus of each sensor, its database, its ready map."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

from ..errors import InputError
from .bench_tables import BenchFile, BusTable, SensorTable
from .named_databases import database_name
from .sensor_maps import ready_tables
from .sensors import Sensor


def sensors_of(table: BenchFile, where: str) -> tuple[Sensor, ...]:
    """Return the sensors of a bench; none if the bench names a single DBC.

    Raises InputError if two sensors have one name, or a sensor is on no bus of the bench.
    """
    buses = table.bus if isinstance(table.bus, list) else [table.bus]
    names = [sensor.name for sensor in table.sensor]
    for name in names:
        if names.count(name) > 1:
            raise InputError(where, f"sensor {name} occurs twice", "give each its own name")
    return tuple(
        Sensor(
            sensor.name,
            database_name(sensor),
            _position(sensor, buses, where),
            sensor.id_offset,
            MappingProxyType(dict(sensor.ids)),
        )
        for sensor in table.sensor
    )


def _position(sensor: SensorTable, buses: Sequence[BusTable], where: str) -> int:
    """Return the position of a sensor's bus, which it states by name, channel or position."""
    known = ", ".join(bus.name or bus.channel for bus in buses)
    if sensor.bus is None:
        if len(buses) == 1:
            return 0
        what = f"sensor {sensor.name} states no bus, and there are {len(buses)}"
        raise InputError(where, what, f"state bus, one of {known}")
    if isinstance(sensor.bus, int):
        found = [sensor.bus] if sensor.bus < len(buses) else []
    else:
        found = [i for i, bus in enumerate(buses) if sensor.bus in (bus.name, bus.channel)]
    if len(found) != 1:
        what = f"sensor {sensor.name} is on bus {sensor.bus}, which matches {len(found)} buses"
        raise InputError(where, what, f"state one of {known}, or its position from 0")
    return found[0]


def with_ready_maps(table: BenchFile) -> BenchFile:
    """Return the tables together with those of the sensors' ready maps.

    Raises InputError if there is no such ready map.
    """
    sensors = [(sensor.name, database_name(sensor)) for sensor in table.sensor]
    stated = table.model_dump(include={"channel", "message", "sample_set"})
    added = BenchFile.model_validate(ready_tables(sensors, stated))
    return table.model_copy(
        update={
            "channel": table.channel + added.channel,
            "message": table.message + added.message,
            "sample_set": table.sample_set + added.sample_set,
        }
    )
