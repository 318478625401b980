"""bench.toml: the description of a bench, checked before anything is touched."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from dbc import read_dbc, shipped_dbc

from .campaign import Campaign
from .channels import AT_CORNER, SI_UNITS, Channel, Quantity
from .errors import InputError
from .runs import ADDED, BASELINE, Excitation
from .vehicle import (
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

MAX_CONFIG_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class BusConfig:
    """One CAN bus, in python-can's words."""

    interface: str
    channel: str
    bitrate: int


@dataclass(frozen=True, slots=True)
class TriggerConfig:
    """When a run starts and ends.

    Parameters
    ----------
    level : float
        Deviation from rest, in SI units of the trigger channels, that counts as a bump.
    pre_s, post_s : float
        Kept before and after the trigger, s.
    rest_s : float
        Time below `level` before the next bump is armed, s.
    """

    level: float
    pre_s: float
    post_s: float
    rest_s: float


@dataclass(frozen=True, slots=True)
class Bench:
    """All that a recorder must know.

    Parameters
    ----------
    text, dbc_text : str
        bench.toml and the DBC as read; both go into every journal and session.
    dbc_name : str
        Where the DBC came from, for messages.
    bump_s : float
        Duration of the bump, s.
    """

    text: str
    dbc_name: str
    dbc_text: str
    bus: BusConfig
    vehicle: Vehicle
    channels: tuple[Channel, ...]
    mass_states: tuple[MassState, ...]
    campaign: Campaign
    bump_s: float
    trigger: TriggerConfig


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_Positive = Annotated[float, Field(gt=0)]
_NotNegative = Annotated[float, Field(ge=0)]


class _Bus(_Table):
    interface: str = "virtual"
    channel: str = "bumpbench"
    bitrate: Annotated[int, Field(gt=0, le=1_000_000)] = 1_000_000


class _Geometry(_Table):
    a_m: _Positive
    b_m: _Positive
    t_f_m: _Positive
    t_r_m: _Positive


class _Structure(_Table):
    symmetric: bool = True
    anti_roll_bars: bool = False
    tyre_damping: bool = False
    cg_offset: bool = False


class _Vehicle(_Table):
    name: str = "vehicle"
    geometry: _Geometry | None = None
    structure: _Structure = _Structure()


class _Campaign(_Table):
    excitations: Annotated[list[Excitation], Field(min_length=1)] = [
        Excitation.BOUNCE,
        Excitation.PITCH,
        Excitation.ROLL,
    ]
    repeats: Annotated[int, Field(ge=1, le=100)] = 2
    bump_s: _Positive = 0.2


class _Trigger(_Table):
    level: _Positive = 3.0
    pre_s: Annotated[float, Field(ge=0.1, le=60)] = 1.0
    post_s: Annotated[float, Field(ge=0.5, le=600)] = 2.5
    rest_s: Annotated[float, Field(ge=0.05, le=60)] = 0.3


class _Weight(_Table):
    mass_kg: _Positive
    sigma_kg: _NotNegative = 0.0
    hub: Corner | None = None
    x_m: float | None = None
    y_m: float | None = None
    height_m: float = 0.0

    @model_validator(mode="after")
    def _one_place(self) -> _Weight:
        on_body = self.x_m is not None and self.y_m is not None
        if on_body == (self.hub is not None):
            raise ValueError("a weight has either x_m and y_m, or hub")
        return self


class _Fact(_Table):
    quantity: str
    value: float
    sigma: _Positive


class _Channel(_Table):
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=60)]
    signal: str
    quantity: Quantity
    corner: Corner | None = None
    x_m: float = 0.0
    y_m: float = 0.0
    position_sigma_m: _NotNegative = 0.0
    sign: Literal[1, -1] = 1
    gain: _Positive = 1.0
    tare: float = 0.0
    delay_s: float = 0.0
    delay_sigma_s: _NotNegative = 0.0
    low_pass_hz: _NotNegative = 0.0
    low_pass_order: Annotated[int, Field(ge=1, le=8)] = 2

    @model_validator(mode="after")
    def _corner_where_needed(self) -> _Channel:
        if (self.quantity in AT_CORNER) != (self.corner is not None):
            raise ValueError(f"{self.quantity} and corner do not go together")
        return self


class _BenchFile(_Table):
    dbc: str = ""
    bus: _Bus = _Bus()
    vehicle: _Vehicle = _Vehicle()
    campaign: _Campaign = _Campaign()
    trigger: _Trigger = _Trigger()
    weight: list[_Weight] = []
    fact: list[_Fact] = []
    channel: list[_Channel] = []


def default_bench_text() -> str:
    """Return the shipped bench.toml: the bench of the shipped DBC."""
    return files("daq").joinpath("bench.toml").read_text("utf-8")


def load_bench(path: Path | None) -> Bench:
    """Read bench.toml, or the shipped one if `path` is None.

    Without `[[channel]]` tables the shipped channels are used, which fit the shipped DBC.

    Raises
    ------
    InputError
        With file and key, if the file cannot be read, holds an unknown key or a bad value.
    """
    if path is None:
        return parse_bench(default_bench_text(), "bench.toml (shipped)", Path())
    try:
        if path.stat().st_size > MAX_CONFIG_BYTES:
            raise InputError(str(path), "is larger than 1 MB", "name a bench.toml")
        text = path.read_text("utf-8-sig")
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), "name a bench.toml") from error
    except UnicodeDecodeError as error:
        raise InputError(str(path), "is not UTF-8 text", "save it as UTF-8") from error
    return parse_bench(text, str(path), path.parent)


def parse_bench(text: str, where: str, folder: Path, dbc_text: str | None = None) -> Bench:
    """Check the text of a bench.toml and resolve what it names.

    Parameters
    ----------
    text : str
        TOML.
    where : str
        Its name, for error messages.
    folder : Path
        Where a relative DBC path starts.
    dbc_text : str, optional
        The DBC, if it is at hand (in a journal); else it is read from the path in the file.

    Raises
    ------
    InputError
        As `load_bench`.
    """
    table = _validated(text, where)
    if not table.channel:
        shipped = _validated(default_bench_text(), "bench.toml (shipped)")
        table = table.model_copy(update={"channel": shipped.channel})
    names = [channel.name for channel in table.channel]
    for name in names:
        if names.count(name) > 1:
            raise InputError(where, f"channel {name} occurs twice", "give each its own name")
    if dbc_text is None:
        dbc_text = read_dbc(folder / table.dbc) if table.dbc else shipped_dbc()
    geometry = table.vehicle.geometry
    structure = Structure(**table.vehicle.structure.model_dump())
    known = (*FactQuantity, *parameter_names(structure))
    for fact in table.fact:
        if fact.quantity not in known:
            what = f"fact {fact.quantity}: is no quantity of this vehicle"
            raise InputError(where, what, f"use one of {', '.join(known)}")
    return Bench(
        text=text,
        dbc_name=table.dbc or "bumpbench.dbc (shipped)",
        dbc_text=dbc_text,
        bus=BusConfig(table.bus.interface, table.bus.channel, table.bus.bitrate),
        vehicle=Vehicle(
            table.vehicle.name,
            VehicleGeometry(geometry.a_m, geometry.b_m, geometry.t_f_m, geometry.t_r_m)
            if geometry
            else None,
            structure,
            tuple(Fact(fact.quantity, fact.value, fact.sigma) for fact in table.fact),
        ),
        channels=tuple(_channel(c) for c in table.channel),
        mass_states=(
            MassState(BASELINE),
            MassState(ADDED, AddedMass(tuple(_weight(w) for w in table.weight))),
        ),
        campaign=Campaign(tuple(table.campaign.excitations), table.campaign.repeats),
        bump_s=table.campaign.bump_s,
        trigger=TriggerConfig(**table.trigger.model_dump()),
    )


def _validated(text: str, where: str) -> _BenchFile:
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(where, f"is not TOML: {error}", "mend that line") from error
    try:
        return _BenchFile.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or "the file"
        if first["type"] == "extra_forbidden":
            raise InputError(where, f"unknown key {key}", "remove it or mend its name") from error
        raise InputError(where, f"{key}: {first['msg']}", "mend that value") from error


def _weight(table: _Weight) -> BodyWeight | HubWeight:
    if table.x_m is not None and table.y_m is not None:
        return BodyWeight(table.mass_kg, table.x_m, table.y_m, table.height_m, table.sigma_kg)
    assert table.hub is not None  # held by _Weight
    return HubWeight(table.mass_kg, table.hub, table.sigma_kg)


def _channel(table: _Channel) -> Channel:
    fields = table.model_dump()
    return Channel(unit=SI_UNITS.get(table.quantity, ""), **fields)


def on_bus(bench: Bench, interface: str | None, channel: str | None) -> Bench:
    """Return the bench on another bus, where one is named."""
    bus = replace(
        bench.bus,
        interface=interface or bench.bus.interface,
        channel=channel or bench.bus.channel,
    )
    return replace(bench, bus=bus)
