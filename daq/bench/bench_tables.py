"""Defines the tables of bench.toml as they are written: types, limits, unknown keys.

`daq.bench.config` makes a `Bench` of them.
"""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal, NamedTuple

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from dbc.crc import CRC_RULES

from ..channels import AT_CORNER, Quantity
from ..runs import Excitation
from ..vehicle import BodyWeight, Corner, HubWeight
from .campaign import Method


def _crc_rule(name: str) -> str:
    if name not in CRC_RULES:
        raise ValueError(f"is none of {', '.join(CRC_RULES)}")
    return name


class Table(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_a_number(cls, value: object, info: ValidationInfo) -> object:
        """Refuse `true`, which would be the number 1, and texts that no session file can store."""
        kind = cls.model_fields[str(info.field_name)].annotation
        if isinstance(value, bool) and kind not in (bool, bool | None):
            raise ValueError("is true or false, not a number or a text")
        if isinstance(value, str) and "\0" in value:
            raise ValueError("has the character NUL")
        return value


_Positive = Annotated[float, Field(gt=0)]
_NotNegative = Annotated[float, Field(ge=0)]
# A larger value is in the wrong unit: a length in millimetres, a time in milliseconds.
_Place = Annotated[float, Field(ge=-20, le=20)]
_Length = Annotated[float, Field(gt=0, le=20)]
_Uncertain = Annotated[float, Field(ge=0, le=1)]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=60)]


def _in_64_bytes(text: str) -> str:
    if len(text.encode()) > 64:
        raise ValueError("takes more than 64 bytes in a session file")
    return text


def _day(value: object) -> object:
    """Accept a day also as text; refuse everything else, also a date with a time of day."""
    if isinstance(value, str):
        return date.fromisoformat(value)  # its ValueError is the error message
    if type(value) is not date:
        raise ValueError("is not a day like 2026-05-31")
    return value


_Day = Annotated[date, BeforeValidator(_day)]


class BusTable(Table):
    """`[bus]`."""

    interface: str = "virtual"
    channel: str = "bumpbench"
    name: Annotated[str, Field(max_length=60)] = ""
    bitrate: Annotated[int, Field(gt=0, le=1_000_000)] = 1_000_000


class SensorTable(Table):
    """One `[[sensor]]`: a device, its database or ready map, and its bus."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=30)]
    dbc: str = ""
    layout: str = ""
    bus: Annotated[int, Field(ge=0)] | str | None = None
    id_offset: int = 0
    ids: dict[str, Annotated[int, Field(ge=0)]] = {}

    @model_validator(mode="after")
    def _one_description(self) -> SensorTable:
        if bool(self.dbc) == bool(self.layout):
            raise ValueError("a sensor has either dbc or layout")
        if self.id_offset and self.ids:
            raise ValueError("a sensor has either id_offset or ids")
        return self

    @property
    def database(self) -> str:
        """The name of its database: a path, or ``layout:NAME``."""
        return f"layout:{self.layout}" if self.layout else self.dbc


class GeometryTable(Table):
    """`[vehicle.geometry]`."""

    a_m: _Length
    b_m: _Length
    t_f_m: _Length
    t_r_m: _Length


class StructureTable(Table):
    """`[vehicle.structure]`; an element that is not stated is chosen by the data."""

    symmetric: bool = True
    anti_roll_bars: bool | None = None
    tyre_damping: bool | None = None
    cg_offset: bool | None = None
    friction: bool | None = None
    static_friction: bool | None = None
    one_sided_dampers: bool | None = None
    damper_knees: bool | None = None
    damper_mounts: bool | None = None
    progressive_springs: bool | None = None
    bump_stops: bool | None = None
    progressive_tyres: bool | None = None
    friction_left_right: bool | None = None
    dampers_left_right: bool | None = None
    corners_left_right: bool | None = None

    @property
    def decided(self) -> dict[str, bool]:
        """The elements that are forced or forbidden."""
        stated = self.model_dump(exclude={"symmetric"}, exclude_none=True)
        return {name: bool(value) for name, value in stated.items()}


class VehicleTable(Table):
    """`[vehicle]`."""

    name: str = "vehicle"
    geometry: GeometryTable | None = None
    structure: StructureTable = StructureTable()


class CampaignTable(Table):
    """`[campaign]`."""

    excitations: Annotated[list[Excitation], Field(min_length=1)] = [
        Excitation.BOUNCE,
        Excitation.PITCH,
        Excitation.ROLL,
    ]
    repeats: Annotated[int, Field(ge=1, le=100)] = 2
    bump_s: Annotated[float, Field(gt=0, le=10)] = 0.2
    method: Method = Method.ROLL_OVER
    bump_height_mm: Annotated[float, Field(gt=0, le=200)] = 40.0
    accept_after_s: Annotated[float, Field(ge=0, le=60)] = 3.0
    instructions: dict[Excitation, Annotated[str, Field(max_length=200)]] = {}


class Limits(NamedTuple):
    """Limits of a number in bench.toml."""

    low: float
    high: float
    above_low: bool
    """True if the number must be above `low`; False if it may equal it."""


def campaign_limits(key: str) -> Limits:
    """Return the limits of a number of `[campaign]`; the highest may be reached."""
    low, high = CampaignTable.model_fields[key].metadata
    above_low = hasattr(low, "gt")
    return Limits(float(low.gt if above_low else low.ge), float(high.le), above_low)


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


class RecorderTable(Table):
    """`[recorder]`."""

    segment_mb: Annotated[float, Field(ge=1, le=4096)] = 64.0
    segment_minutes: Annotated[float, Field(ge=0.1, le=1440)] = 15.0
    keep_gb: Annotated[float, Field(ge=0.1)] = 100.0
    reserve_mb: Annotated[float, Field(ge=1)] = 200.0
    silent_s: Annotated[float, Field(ge=0.1, le=60)] = 1.0


class WeightTable(Table):
    """One `[[weight]]`."""

    mass_kg: Annotated[float, Field(gt=0, le=10_000)]
    sigma_kg: _NotNegative = 0.0
    hub: Corner | None = None
    x_m: _Place | None = None
    y_m: _Place | None = None
    height_m: _Place = 0.0
    position_sigma_m: _Uncertain = 0.0

    @model_validator(mode="after")
    def _one_place(self) -> WeightTable:
        place = [each for each in (self.x_m, self.y_m) if each is not None]
        if len(place) != (2 if self.hub is None else 0):
            raise ValueError("a weight has either x_m and y_m, or hub")
        if self.hub is not None and self.position_sigma_m:
            raise ValueError("position_sigma_m is for a weight on the body, not on a hub")
        return self

    def weight(self) -> BodyWeight | HubWeight:
        """Return the weight on the body or on a hub."""
        if self.x_m is not None and self.y_m is not None:
            return BodyWeight(**self.model_dump(exclude={"hub"}))
        assert self.hub is not None  # ensured above
        return HubWeight(self.mass_kg, self.hub, self.sigma_kg)


class FactTable(Table):
    """One `[[fact]]`."""

    quantity: str
    value: float
    sigma: _Positive


class ChannelTable(Table):
    """One `[[channel]]`."""

    name: _Name
    signal: str
    signal_unit: Annotated[str, Field(max_length=16)] = ""
    quantity: Quantity
    corner: Corner | None = None
    x_m: _Place = 0.0
    y_m: _Place = 0.0
    position_sigma_m: _Uncertain = 0.0
    sign: Literal[1, -1] = 1
    gain: _Positive = 1.0
    gain_sigma: Annotated[float, Field(ge=0, le=0.3)] = 0.0
    tare: float = 0.0
    motion_ratio: Annotated[float, Field(gt=0, le=10)] = 1.0
    motion_ratio_sigma: _NotNegative = 0.0
    delay_s: Annotated[float, Field(ge=-1, le=1)] = 0.0
    delay_sigma_s: _Uncertain = 0.0
    low_pass_hz: _NotNegative = 0.0
    low_pass_order: Annotated[int, Field(ge=1, le=8)] = 2
    serial_number: Annotated[str, Field(max_length=60), AfterValidator(_in_64_bytes)] = ""
    calibrated: _Day | None = None

    @model_validator(mode="after")
    def _corner_where_needed(self) -> ChannelTable:
        if (self.quantity in AT_CORNER) != (self.corner is not None):
            raise ValueError(f"{self.quantity} and corner do not go together")
        return self

    @model_validator(mode="after")
    def _ratio_of_a_travel(self) -> ChannelTable:
        stated = self.motion_ratio != 1.0 or self.motion_ratio_sigma > 0.0
        if stated and self.quantity is not Quantity.SUSPENSION_TRAVEL:
            raise ValueError(f"motion_ratio is for suspension_travel, not for {self.quantity}")
        if self.motion_ratio_sigma > self.motion_ratio / 3.0:
            raise ValueError("motion_ratio_sigma is more than a third of motion_ratio")
        return self


class MessageRule(Table):
    """One `[[message]]`: properties of a message that its DBC does not state."""

    name: str
    """Name of the message."""
    cycle_ms: _Positive | None = None
    """Time between two frames, ms, instead of that of the DBC."""
    counter: str | None = None
    """Name of its rolling counter."""
    counter_modulus: Annotated[int, Field(ge=2, le=1 << 32)] | None = None
    """Number of values of the counter; None: all values of its bits."""
    crc: str | None = None
    """Signal that holds its checksum."""
    crc_rule: Annotated[str, AfterValidator(_crc_rule)] = "crc8_j1850"
    """Rule by which the checksum is computed, one of `dbc.crc.CRC_RULES`."""
    time_signal: str | None = None
    """Signal that holds the sensor's own time."""
    time_unit: Annotated[str, Field(max_length=16)] = ""
    """Its unit if the DBC states none or a wrong one; empty: as in the DBC."""
    time_wrap: _Positive | None = None
    """Value at which it starts again from 0, in its unit; None: at the end of its bits."""

    @model_validator(mode="after")
    def _belongs_to_something(self) -> MessageRule:
        stated = self.model_fields_set
        for owner, keys in (
            ("counter", {"counter_modulus"}),
            ("crc", {"crc_rule"}),
            ("time_signal", {"time_unit", "time_wrap"}),
        ):
            if keys & stated and owner not in stated:
                raise ValueError(f"{min(keys & stated)} says nothing without {owner}")
        return self


class SampleSet(Table):
    """One `[[sample_set]]`: messages that carry one sample together."""

    name: _Name
    """Name of their sample group."""
    messages: Annotated[tuple[str, ...], Field(min_length=1)]
    """Names of the messages."""
    bound_by: str
    """``Message.signal``: a counter or time stamp in a separate frame that is sent in one burst
    with the others; or the name of a counter that each of the messages has."""

    @property
    def carrier(self) -> tuple[str, str]:
        """Message and signal by which the sets are numbered."""
        message, dot, signal = self.bound_by.rpartition(".")
        return (message, signal) if dot else (self.messages[0], self.bound_by)


class CalibrationTable(Table):
    """`[calibration]`."""

    max_age_days: Annotated[int, Field(gt=0)] = 365


class BenchFile(Table):
    """A complete bench.toml."""

    dbc: str = ""
    sensor: Annotated[list[SensorTable], Field(max_length=100)] = []
    bus: BusTable | Annotated[list[BusTable], Field(min_length=1, max_length=16)] = BusTable()
    vehicle: VehicleTable = VehicleTable()
    campaign: CampaignTable = CampaignTable()
    trigger: TriggerConfig = TriggerConfig()
    recorder: RecorderTable = RecorderTable()
    weight: list[WeightTable] = []
    fact: list[FactTable] = []
    calibration: CalibrationTable = CalibrationTable()
    message: list[MessageRule] = []
    sample_set: list[SampleSet] = []
    channel: list[ChannelTable] = []

    @model_validator(mode="after")
    def _one_way_to_name_databases(self) -> BenchFile:
        if self.sensor and self.dbc:
            raise ValueError("dbc and [[sensor]] exclude each other: a sensor names its own dbc")
        return self
