"""Reads bench.toml, the description of a bench, and checks it completely before it is used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path, PurePath
from types import MappingProxyType

from dbc import Codec, read_dbc

from ..channels import Channel, message_of
from ..errors import InputError
from ..runs import ADDED, BASELINE
from ..vehicle import (
    AddedMass,
    Fact,
    FactQuantity,
    MassState,
    Structure,
    Vehicle,
    VehicleGeometry,
    parameter_names,
)
from .bench_tables import BenchFile, MessageRule, SampleSet, SensorTable, TriggerConfig
from .campaign import Campaign, Origin, Procedure
from .databases import Database, database_codec, read_databases, stored_databases, stored_text
from .message_rules import check_sets, ruled_codec
from .ready_maps import PREFIX, ready_map, ready_tables
from .sensors import Sensor, full_name, sensors_codec
from .toml_file import toml_text, validated

_SIGNAL_BYTES = 128
"""Longest name of a signal in a session file, bytes."""


@dataclass(frozen=True, slots=True)
class BusConfig:
    """One CAN bus, in python-can's words."""

    interface: str
    channel: str
    bitrate: int
    name: str = ""
    """Name for people and for the sensors of bench.toml; empty: the channel is the name."""

    @property
    def label(self) -> str:
        """The name, or the channel."""
        return self.name or self.channel


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """A recorder's limits on the disk, and the silence of a bus that raises an alarm."""

    segment_bytes: float = 64e6
    """Size at which a file of the journal ends."""
    segment_s: float = 900.0
    """Age at which a file of the journal ends, s."""
    keep_bytes: float = 100e9
    """Total size of the files of the journal; above it, the oldest files that are sealed and
    derived are deleted."""
    reserve_bytes: float = 200e6
    """Free space that is always left on the disk; recording stops before it is used."""
    silent_s: float = 1.0
    """Time without a frame after which a bus raises an alarm, s."""


@dataclass(frozen=True, slots=True)
class Bench:
    """A complete bench: everything that a recorder must know."""

    text: str
    """bench.toml as read; stored in every journal and session."""
    dbc_name: str
    """Source of the DBC, for messages to the user."""
    dbc_text: str
    """The DBC as read, or all databases of the sensors (`daq.bench.databases`); stored in every
    journal and session."""
    buses: tuple[BusConfig, ...]
    """The buses, at least one; a frame's `bus` is a position in this tuple."""
    vehicle: Vehicle
    channels: tuple[Channel, ...]
    """Channels, with full names of signals (`daq.channels`)."""
    mass_states: tuple[MassState, ...]
    campaign: Campaign
    bump_s: float
    """Duration of the bump, s."""
    trigger: TriggerConfig
    message_rules: tuple[MessageRule, ...] = ()
    """Properties of messages that the DBC does not state."""
    sample_sets: tuple[SampleSet, ...] = ()
    """Messages that carry one sample together."""
    calibration_days: int = 365
    """Age of a calibration from which the check warns, days."""
    procedure: Procedure = field(default_factory=Procedure)
    """The way in which the bumps are made."""
    recorder: RecorderConfig = RecorderConfig()
    """Limits of the recorder."""
    sensors: tuple[Sensor, ...] = ()
    """The sensors; empty on a bench with one DBC for every bus."""
    origin: Origin = Origin.REAL
    """Origin of the frames; not from bench.toml, but set where the buses are opened."""
    where: str = field(default="bench.toml", compare=False)
    """Name of the file, for messages to the user."""

    @property
    def bus(self) -> BusConfig:
        """The first bus; most benches have only one."""
        return self.buses[0]


def default_bench_text() -> str:
    """Return the shipped bench.toml: the bench of the shipped DBC."""
    return files("daq").joinpath("bench.toml").read_text("utf-8")


def load_bench(path: Path | None) -> Bench:
    """Return the bench of a bench.toml, or the shipped one if `path` is None.

    Without `[[channel]]` tables the shipped channels are used, which fit the shipped DBC; with
    ``dbc = "layout:NAME"`` those of that ready map (`daq.bench.ready_maps`), and its messages and
    sample sets, unless the file states its own.  Raises InputError, with file and key, if the file
    cannot be read, holds an unknown key or a bad value.
    """
    if path is None:
        return parse_bench(default_bench_text(), "bench.toml (shipped)", Path())
    where = str(path)
    bench = parse_bench(toml_text(path, "name a bench.toml"), where, path.parent)
    # Slips that a new file must not have; recorded ones are read with them.
    kinds = bench.campaign.excitations
    if len(set(kinds)) < len(kinds):
        what = "campaign.excitations names a kind of bump twice"
        raise InputError(where, what, "name each once; repeats states how often")
    positive = (*FactQuantity, *parameter_names(Structure(bench.vehicle.structure.symmetric)))
    for fact in bench.vehicle.facts:
        if fact.value <= 0.0 and fact.quantity in positive:
            what = f"fact {fact.quantity}: is {fact.value:g}"
            raise InputError(where, what, "state a value above 0")
    return bench


def parse_bench(text: str, where: str, folder: Path, dbc_text: str | None = None) -> Bench:
    """Check the text of a bench.toml and resolve what it names.

    `text`: TOML.  `where`: its name, for error messages.  `folder`: where a relative DBC path
    starts.  `dbc_text`: the DBC, if it is known already (in a journal); else it is read from the
    path in the file.  Raises InputError as `load_bench`.
    """
    stated = validated(text, where, BenchFile)
    databases = read_databases(stated, text, where, folder if dbc_text is None else None)
    if dbc_text is None:
        dbc_text = stored_text(databases)
    return bench_of(_completed(stated), text, where, dbc_text)


def bench_of(table: BenchFile, text: str, where: str, dbc_text: str) -> Bench:
    """Return the bench that checked tables describe.

    `text` and `where`: as in `parse_bench`.  `dbc_text`: all databases; empty for data that did not
    come from a bus.  Raises InputError if two things have the same name, a fact has an unknown
    quantity, or the name of a signal is too long for a session file.
    """
    for kind, tables in (
        ("sensor", table.sensor),
        ("channel", table.channel),
        ("message", table.message),
        ("sample set", table.sample_set),
    ):
        for name, times in Counter(each.name for each in tables).items():
            if times > 1:
                raise InputError(where, f"{kind} {name} occurs twice", "give each its own name")
    stated = table.bus if isinstance(table.bus, list) else [table.bus]
    buses = tuple(BusConfig(**bus.model_dump()) for bus in stated)
    for (interface, name), times in Counter((b.interface, b.channel) for b in buses).items():
        if times > 1:
            what = f"bus {interface} {name} occurs twice"
            raise InputError(where, what, "give each [[bus]] its own channel")
    sensors = tuple(
        Sensor(s.name, s.database, _bus_of(s, buses, where), s.id_offset, MappingProxyType(s.ids))
        for s in table.sensor
    )
    channels = tuple(
        Channel(
            **channel.model_dump(exclude={"calibrated"}),
            calibrated=channel.calibrated.isoformat() if channel.calibrated else "",
        )
        for channel in table.channel
    )
    if sensors and dbc_text:
        databases = stored_databases(dbc_text)
        messages = [m for s in sensors for m in sensors_codec([s], databases, len(buses)).messages]
        channels = tuple(replace(c, signal=full_name(c.signal, messages)) for c in channels)
    for channel in channels:
        if len(channel.signal.encode()) > _SIGNAL_BYTES:
            what = f"channel {channel.name}: the name of its signal takes more than 128 bytes"
            raise InputError(where, what, "give the signal a shorter name in its file")
    geometry = table.vehicle.geometry
    decided = table.vehicle.structure.decided
    structure = Structure(
        table.vehicle.structure.symmetric,
        *(decided.get(name, False) for name in ("anti_roll_bars", "tyre_damping", "cg_offset")),
    )
    known = (*FactQuantity, *parameter_names(structure))
    for fact in table.fact:
        if fact.quantity not in known:
            what = f"fact {fact.quantity}: is not a quantity of this vehicle"
            raise InputError(where, what, f"use one of {', '.join(known)}")
    return Bench(
        where=where,
        text=text,
        dbc_name=", ".join(dict.fromkeys(sensor.database for sensor in sensors))
        or table.dbc
        or "bumpbench.dbc (shipped)",
        dbc_text=dbc_text,
        buses=buses,
        vehicle=Vehicle(
            table.vehicle.name,
            VehicleGeometry(*geometry.model_dump().values()) if geometry else None,
            structure,
            tuple(Fact(**fact.model_dump()) for fact in table.fact),
            decided,
        ),
        channels=channels,
        mass_states=(
            MassState(BASELINE),
            MassState(ADDED, AddedMass(tuple(weight.weight() for weight in table.weight))),
        ),
        campaign=Campaign(tuple(table.campaign.excitations), table.campaign.repeats),
        bump_s=table.campaign.bump_s,
        trigger=table.trigger,
        message_rules=tuple(table.message),
        sample_sets=tuple(table.sample_set),
        calibration_days=table.calibration.max_age_days,
        procedure=Procedure(
            table.campaign.method,
            table.campaign.bump_height_mm * 1e-3,
            table.campaign.accept_after_s,
            MappingProxyType(dict(table.campaign.instructions)),
        ),
        recorder=RecorderConfig(
            table.recorder.segment_mb * 1e6,
            table.recorder.segment_minutes * 60.0,
            table.recorder.keep_gb * 1e9,
            table.recorder.reserve_mb * 1e6,
            table.recorder.silent_s,
        ),
        sensors=sensors,
    )


def _bus_of(sensor: SensorTable, buses: Sequence[BusConfig], where: str) -> int:
    """Return the position of a sensor's bus, which it states by name, channel or position."""
    known = ", ".join(bus.label for bus in buses)
    if sensor.bus is None:
        if len(buses) == 1:
            return 0
        what = f"sensor {sensor.name} states no bus, and there are {len(buses)}"
        raise InputError(where, what, f"state bus, one of {known}")
    if isinstance(sensor.bus, int):
        matching = [sensor.bus] if sensor.bus < len(buses) else []
    else:
        matching = [i for i, bus in enumerate(buses) if sensor.bus in (bus.name, bus.channel)]
    if len(matching) != 1:
        what = f"sensor {sensor.name} is on bus {sensor.bus}, which matches {len(matching)} buses"
        raise InputError(where, what, f"state one of {known}, or its position from 0")
    return matching[0]


def bench_codec(bench: Bench) -> Codec:
    """Return the bench's databases, compiled, with the properties that bench.toml adds to messages.

    Raises
    ------
    InputError
        If the DBC cannot be used, or bench.toml contradicts the DBC.
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


def _completed(table: BenchFile) -> BenchFile:
    """Add the tables that the file takes from the shipped bench or from ready maps."""
    if table.sensor:
        stated = table.model_dump(include={"channel", "message", "sample_set"})
        sensors = [(sensor.name, sensor.database) for sensor in table.sensor]
        added = BenchFile.model_validate(ready_tables(sensors, stated))
        return table.model_copy(
            update={
                "channel": table.channel + added.channel,
                "message": table.message + added.message,
                "sample_set": table.sample_set + added.sample_set,
            }
        )
    if not table.dbc.startswith(PREFIX):
        if table.channel:
            return table
        shipped = validated(default_bench_text(), "bench.toml (shipped)", BenchFile)
        return table.model_copy(update={"channel": shipped.channel})
    ready = validated(ready_map(table.dbc.removeprefix(PREFIX)).bench_text, table.dbc, BenchFile)
    messages = {message.name for message in table.message}
    return table.model_copy(
        update={
            "channel": table.channel or ready.channel,
            "message": table.message + [m for m in ready.message if m.name not in messages],
            "sample_set": table.sample_set or ready.sample_set,
        }
    )


def on_bus(bench: Bench, interface: str | None, channel: str | None) -> Bench:
    """Return the bench with the named bus as its only bus; unchanged if no bus is named.

    Raises InputError if its sensors are on several buses.
    """
    if not (interface or channel):
        return bench
    if len({sensor.bus for sensor in bench.sensors}) > 1:
        what = f"the bench has sensors on {len(bench.buses)} buses, and one bus is named"
        raise InputError("--interface, --channel", what, "name the buses in bench.toml")
    bus = replace(
        bench.bus,
        interface=interface or bench.bus.interface,
        channel=channel or bench.bus.channel,
    )
    return replace(bench, buses=(bus,))


def with_database(bench: Bench, path: Path) -> Bench:
    """Return the bench with the database of a file instead of its only one, or the one so named.

    Raises InputError if the file cannot be read, or the bench has several databases and none with
    this file name.
    """
    text = read_dbc(path)
    if not bench.sensors:
        return replace(bench, dbc_text=text, dbc_name=str(path))
    names = list(dict.fromkeys(sensor.database for sensor in bench.sensors))
    chosen = names if len(names) == 1 else [n for n in names if PurePath(n).name == path.name]
    if len(chosen) != 1:
        what = f"none of the {len(names)} databases of the bench has this file name"
        advice = f"name the file as the one it replaces: {', '.join(names)}"
        raise InputError(str(path), what, advice)
    old = {each.name: each.text for each in stored_databases(bench.dbc_text)}
    stored = stored_text([Database(n, text if n == chosen[0] else old[n]) for n in names])
    # Read again, because the full names of the channels depend on the databases.
    again = parse_bench(bench.text, "bench.toml", Path(), stored)
    return replace(bench, dbc_text=stored, channels=again.channels)
