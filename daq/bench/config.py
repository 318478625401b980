"""Reads bench.toml, the description of a bench, and checks it completely before it is used.

`Bench` has the tables of the file as its fields; what is not in the file (its name, the texts of
the databases) is set when it is loaded.  Only where a noun has another form in the file, as a
weight on the body or on a hub, its table has its own class.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, model_validator

from dbc import Codec, read_dbc
from dbc.words import InputError

from ..channels import Channel, Quantity, message_of
from ..runs import ADDED, BASELINE
from ..vehicle import (
    ELEMENTS,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
    Vehicle,
    VehicleGeometry,
    parameter_names,
)
from .campaign import Campaign, Origin
from .sensors import (
    MessageRule,
    SampleSet,
    Sensor,
    check_sets,
    completed,
    database_codec,
    full_name,
    read_databases,
    ruled_codec,
    sensors_codec,
    stored_databases,
    stored_text,
)
from .toml_file import NO_KEY, STRICT, Table, toml_tables, toml_text, validated

# A larger value is in the wrong unit.
_Place = Annotated[float, Field(ge=-20, le=20)]
# Converts a number to s or bytes from the unit that its key has in the file.
_MINUTE, _MEGA, _GIGA = (AfterValidator(factor.__mul__) for factor in (60.0, 1e6, 1e9))


@dataclass(frozen=True, slots=True)
class BusConfig:
    """`[bus]`: one CAN bus, in python-can's words."""

    interface: str = "virtual"
    channel: str = "bumpbench"
    bitrate: Annotated[int, Field(gt=0, le=1_000_000)] = 1_000_000
    name: Annotated[str, Field(max_length=60)] = ""
    """Name for people and for the sensors of bench.toml; empty: the channel is the name."""

    @property
    def label(self) -> str:
        """The name, or the channel."""
        return self.name or self.channel


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """`[recorder]`: limits on the disk, and the silence of a bus that raises an alarm."""

    segment_bytes: Annotated[float, Field(ge=1, le=4096, alias="segment_mb"), _MEGA] = 64e6
    """Size at which a file of the journal ends."""
    segment_s: Annotated[float, Field(ge=0.1, le=1440, alias="segment_minutes"), _MINUTE] = 900.0
    """Age at which a file of the journal ends, s."""
    keep_bytes: Annotated[float, Field(ge=0.1, alias="keep_gb"), _GIGA] = 100e9
    """Total size of the files of the journal; above it, the oldest are deleted."""
    reserve_bytes: Annotated[float, Field(ge=1, alias="reserve_mb"), _MEGA] = 200e6
    """Free space that is always left on the disk; recording stops before it is used."""
    silent_s: Annotated[float, Field(ge=0.1, le=60)] = 1.0
    """Time without a frame after which a bus raises an alarm, s."""


class TriggerConfig(Table):
    """`[trigger]`: the conditions on which a run starts and ends."""

    level: Annotated[float, Field(gt=0, le=1000)] = 3.0
    """Deviation from rest, in SI units of the trigger channels, that counts as a bump."""
    pre_s: Annotated[float, Field(ge=0.1, le=60)] = 1.0
    """Time kept before the trigger, s."""
    post_s: Annotated[float, Field(ge=0.5, le=600)] = 2.5
    """Time kept after the trigger, s."""
    rest_s: Annotated[float, Field(ge=0.05, le=60)] = 0.3
    """Time below `level` before the next bump is armed, s."""

    def window_ns(self, bump_ns: int) -> tuple[int, int]:
        """Return the span of the run of a bump, start <= t < stop, ns."""
        return bump_ns - round(self.pre_s * 1e9), bump_ns + round(self.post_s * 1e9)


def _of_known_elements(stated: dict[str, bool]) -> dict[str, bool]:
    """Return the stated structure; raises ValueError if an element is unknown."""
    for name in stated:
        if name not in ("symmetric", *ELEMENTS):
            raise ValueError(f"{name} is none of symmetric, {', '.join(ELEMENTS)}")
    return stated


class VehicleTable(Table):
    """`[vehicle]`."""

    name: str = "vehicle"
    geometry: VehicleGeometry | None = None
    structure: Annotated[dict[str, bool], AfterValidator(_of_known_elements)] = Field(default={})
    """`symmetric`, and the elements that are forced or forbidden; data choose the others."""

    def vehicle(self, facts: tuple[Fact, ...]) -> Vehicle:
        """Return the vehicle of which these facts are known."""
        stated = self.structure
        structure = Structure(**{k: stated[k] for k in Structure.__slots__ if k in stated})
        elements = {name: on for name, on in stated.items() if name != "symmetric"}
        return Vehicle(self.name, self.geometry, structure, facts, elements)


class WeightTable(Table):
    """One `[[weight]]`."""

    mass_kg: Annotated[float, Field(gt=0, le=10_000)]
    sigma_kg: Annotated[float, Field(ge=0)] = 0.0
    hub: Corner | None = None
    x_m: _Place | None = None
    y_m: _Place | None = None
    height_m: _Place = 0.0
    position_sigma_m: Annotated[float, Field(ge=0, le=1)] = 0.0

    @model_validator(mode="after")
    def _one_place(self) -> WeightTable:
        n_coordinates = sum(each is not None for each in (self.x_m, self.y_m))
        if n_coordinates != (2 if self.hub is None else 0):
            raise ValueError("a weight has either x_m and y_m, or hub")
        if self.hub is not None and self.position_sigma_m:
            raise ValueError("position_sigma_m is for a weight on the body, not on a hub")
        return self

    def weight(self) -> BodyWeight | HubWeight:
        """Return the weight on the body or on a hub."""
        if self.hub is not None:
            return HubWeight(self.mass_kg, self.hub, self.sigma_kg)
        return BodyWeight(**self.model_dump(exclude={"hub"}))


class CalibrationTable(Table):
    """`[calibration]`."""

    max_age_days: Annotated[int, Field(gt=0)] = 365


def checked_channel(channel: Channel) -> Channel:
    """Return the channel; raises ValueError if it has what a person cannot mean."""
    if not re.fullmatch("[A-Za-z][A-Za-z0-9_]{0,59}", channel.name):
        raise ValueError("its name is not a letter, and at most 59 letters, digits and _ after it")
    if not channel.signal:
        raise ValueError("it states no signal")
    if channel.sign not in (1, -1):
        raise ValueError("its sign is not 1 or -1")
    try:
        date.fromisoformat(channel.calibrated or "2026-05-31")  # empty: not stated
    except ValueError as error:
        raise ValueError("calibrated is not a day like 2026-05-31") from error
    # Both have a field of this size in a session file.
    if len(channel.serial_number.encode()) > 64 or len(channel.signal.encode()) > 128:
        raise ValueError("its signal takes more than 128 bytes, or its serial_number more than 64")
    has_ratio = channel.motion_ratio != 1.0 or channel.motion_ratio_sigma > 0.0
    if has_ratio and channel.quantity is not Quantity.SUSPENSION_TRAVEL:
        raise ValueError(f"motion_ratio is for suspension_travel, not for {channel.quantity}")
    if channel.motion_ratio_sigma > channel.motion_ratio / 3.0:
        raise ValueError("motion_ratio_sigma is more than a third of motion_ratio")
    return channel


Buses = Annotated[
    tuple[BusConfig, ...],
    Field(min_length=1, max_length=16),
    BeforeValidator(lambda buses: [buses] if isinstance(buses, dict) else buses),
]
"""`[bus]`, or one `[[bus]]` each."""


@dataclass(frozen=True, slots=True)
class DescribedCar:
    """The tables that a bench.toml and a channel map share."""

    __pydantic_config__ = STRICT
    text: Annotated[str, NO_KEY] = ""
    """The file as read; stored in every journal and session."""
    where: Annotated[str, NO_KEY] = field(default="bench.toml", compare=False)
    """Name of the file, for messages to the user."""
    vehicle_table: Annotated[VehicleTable, Field(alias="vehicle")] = field(
        default_factory=VehicleTable
    )
    facts: Annotated[tuple[Fact, ...], Field(alias="fact")] = ()
    weights: Annotated[tuple[WeightTable, ...], Field(alias="weight")] = ()
    campaign: Campaign = field(default_factory=Campaign)
    trigger: TriggerConfig = field(default_factory=TriggerConfig)
    calibration: CalibrationTable = field(default_factory=CalibrationTable)
    channels: Annotated[
        tuple[Annotated[Channel, AfterValidator(checked_channel)], ...], Field(alias="channel")
    ] = ()
    """Channels; on a loaded bench with full names of signals (`daq.channels`)."""

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, with the facts that are known of it."""
        return self.vehicle_table.vehicle(self.facts)

    @property
    def mass_states(self) -> tuple[MassState, ...]:
        """The car as it is, and with the added weights."""
        added = AddedMass(tuple(weight.weight() for weight in self.weights))
        return MassState(BASELINE), MassState(ADDED, added)


@dataclass(frozen=True, slots=True)
class Bench(DescribedCar):
    """A complete bench.toml: everything that a recorder must know."""

    dbc: str = ""
    """The DBC of every bus: a path, ``layout:NAME``, or empty for the shipped one."""
    sensors: Annotated[tuple[Sensor, ...], Field(alias="sensor", max_length=100)] = ()
    """The sensors; empty on a bench with one DBC for every bus."""
    buses: Annotated[Buses, Field(alias="bus")] = (BusConfig(),)
    """The buses, at least one; a frame's `bus` is a position in this tuple."""
    recorder: RecorderConfig = RecorderConfig()
    message_rules: Annotated[tuple[MessageRule, ...], Field(alias="message")] = ()
    sample_sets: Annotated[tuple[SampleSet, ...], Field(alias="sample_set")] = ()
    dbc_name: Annotated[str, NO_KEY] = ""
    """Source of the databases, for messages to the user."""
    dbc_text: Annotated[str, NO_KEY] = ""
    """The DBC, or all databases of the sensors (`daq.bench.sensors`); stored like `text`."""
    origin: Annotated[Origin, NO_KEY] = Origin.REAL
    """Origin of the frames; set where the buses are opened."""

    @model_validator(mode="after")
    def _one_way_to_name_databases(self) -> Bench:
        if self.sensors and self.dbc:
            raise ValueError("dbc and [[sensor]] exclude each other: a sensor names its own dbc")
        return self


_BENCH = TypeAdapter(Bench)


def campaign_limits(key: str) -> tuple[float, float]:
    """Return the lowest and the highest value of a number of `[campaign]`, in its unit there."""
    limits = TypeAdapter(Campaign).json_schema()["properties"][key]
    return float(limits["minimum"]), float(limits["maximum"])


def default_bench_text() -> str:
    """Return the shipped bench.toml: the bench of the shipped DBC."""
    return files("daq").joinpath("bench.toml").read_text("utf-8")


def load_bench(path: Path | None) -> Bench:
    """Return the bench of a bench.toml, or the shipped one if `path` is None.

    Without `[[channel]]` tables the shipped channels are used, which fit the shipped DBC; with
    ``dbc = "layout:NAME"`` those of that ready map (`daq.bench.sensors`), and its messages and
    sample sets, unless the file states its own.  Raises InputError, with file and key, if the file
    cannot be read, holds an unknown key or a bad value.
    """
    if path is None:
        return parse_bench(default_bench_text(), "bench.toml (shipped)", Path())
    return parse_bench(toml_text(path, "name a bench.toml"), str(path), path.parent)


def parse_bench(text: str, where: str, folder: Path, dbc_text: str | None = None) -> Bench:
    """Return the bench of the text of a bench.toml, checked, with its databases.

    `where`: the name of the text, for error messages.  `folder`: where a relative DBC path starts.
    `dbc_text`: the DBC, if it is known already (in a journal); else it is read from the path in the
    file.  Raises InputError as `load_bench`.
    """
    document = toml_tables(text, where)
    stated = validated(document, where, _BENCH)
    if dbc_text is None:
        names = [sensor.database for sensor in stated.sensors] or [stated.dbc]
        dbc_text = stored_text(read_databases(names, folder))
    # Now with the tables of ready maps, which need not be stated.
    bench = validated(completed(document), where, _BENCH)
    bench = replace(bench, text=text, where=where, dbc_text=dbc_text)
    check_car(bench)
    require_unique("sensor", [sensor.name for sensor in bench.sensors], where)
    require_unique("message", [rule.name for rule in bench.message_rules], where)
    require_unique("sample set", [each.name for each in bench.sample_sets], where)
    require_unique("bus", [f"{b.interface} {b.channel}" for b in bench.buses], where)
    sensors = tuple(
        replace(sensor, bus_position=_bus_position(sensor, bench)) for sensor in bench.sensors
    )
    channels = bench.channels
    if sensors and dbc_text:
        stored = stored_databases(dbc_text)
        codecs = [sensors_codec([sensor], stored, len(bench.buses)) for sensor in sensors]
        messages = [message for codec in codecs for message in codec.messages]
        channels = tuple(replace(c, signal=full_name(c.signal, messages)) for c in channels)
    databases = ", ".join(dict.fromkeys(sensor.database for sensor in sensors))
    dbc_name = databases or bench.dbc or "bumpbench.dbc (shipped)"
    return replace(bench, sensors=sensors, channels=channels, dbc_name=dbc_name)


def check_car(car: DescribedCar) -> None:
    """Raise InputError if a channel or bump occurs twice, or a fact does not fit the vehicle."""
    require_unique("channel", [channel.name for channel in car.channels], car.where)
    structure = car.vehicle.structure
    quantities = (*FactQuantity, *parameter_names(structure))
    # Not the others: bars and tyre damping may be 0, the offset of the CG negative.
    positive = (*FactQuantity, *parameter_names(Structure(structure.symmetric)))
    for fact in car.facts:
        if fact.quantity not in quantities:
            fault = f"fact {fact.quantity}: is not a quantity of this vehicle"
            raise InputError(car.where, fault, f"use one of {', '.join(quantities)}")
        if fact.value <= 0.0 and fact.quantity in positive:
            fault = f"fact {fact.quantity}: is {fact.value:g}"
            raise InputError(car.where, fault, "state a value above 0")
    require_unique("kind of bump", car.campaign.excitations, car.where)


def _bus_position(sensor: Sensor, bench: Bench) -> int:
    """Return the position of a sensor's bus, which it states by name, channel or position.

    Raises InputError if it matches no bus, or several.
    """
    buses = bench.buses
    matching = [i for i, b in enumerate(buses) if sensor.bus in (None, i, b.name, b.channel)]
    if len(matching) != 1:
        stated = "states no bus" if sensor.bus is None else f"is on bus {sensor.bus}"
        known = ", ".join(bus.label for bus in buses)
        fault = f"sensor {sensor.name} {stated}, which matches {len(matching)} buses"
        raise InputError(bench.where, fault, f"state bus, one of {known}, or its position from 0")
    return matching[0]


def require_unique(kind: str, names: Sequence[str], where: str) -> None:
    """Raise InputError if a name of things of one kind occurs twice."""
    for name, count in Counter(names).items():
        if count > 1:
            raise InputError(where, f"{kind} {name} occurs twice", "give each its own name")


def bench_codec(bench: Bench) -> Codec:
    """Return the bench's databases, compiled, with the properties that bench.toml adds to messages.

    Raises InputError if the DBC cannot be used, or bench.toml contradicts the DBC.
    """
    if bench.sensors:
        used = {message_of(channel.signal) for channel in bench.channels}
        used |= {rule.name for rule in bench.message_rules}
        used |= {name for each in bench.sample_sets for name in each.messages}
        databases = stored_databases(bench.dbc_text)
        codec = sensors_codec(bench.sensors, databases, len(bench.buses), used)
    else:
        codec = database_codec(bench.dbc_text, bench.dbc_name)
    try:
        codec = ruled_codec(codec, bench.message_rules, bench.dbc_name)
        check_sets(codec, bench.message_rules, bench.sample_sets)
    except InputError as error:
        raise InputError(bench.where, f"{error.where}: {error.what}", error.advice) from error
    return codec


def on_bus(bench: Bench, interface: str | None, channel: str | None) -> Bench:
    """Return the bench with the named bus as its only bus; unchanged if no bus is named.

    What is not named is that of the stated bus of this channel, else of the sensors' bus, else of
    the first.  Raises InputError if its sensors are on several buses.
    """
    if not (interface or channel):
        return bench
    positions = {sensor.bus_position for sensor in bench.sensors}
    if len(positions) > 1:
        fault = f"name the bus of a bench with one bus; here sensors are on {len(bench.buses)}"
        raise InputError("--interface, --channel", fault, f"change the [[bus]] of {bench.where}")
    usual = bench.buses[min(positions, default=0)]
    old = next((bus for bus in bench.buses if bus.channel == channel), usual)
    bus = replace(old, interface=interface or old.interface, channel=channel or old.channel)
    return replace(bench, buses=(bus,))


def with_database(bench: Bench, path: Path) -> Bench:
    """Return the bench with the database of a file instead of its only one.

    Raises InputError if the file cannot be read, or the bench has several databases.
    """
    n_databases, text = len({sensor.database for sensor in bench.sensors}), read_dbc(path)
    if n_databases > 1:
        fault = f"is one database, but the bench has {n_databases}"
        raise InputError(str(path), fault, "name a bench.toml that states the corrected one")
    # Read again, because the full names of the channels of sensors depend on the databases.
    return replace(parse_bench(bench.text, bench.where, Path(), text), dbc_name=str(path))
