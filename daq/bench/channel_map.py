"""Reads channel maps: which columns of a file are which channels, for data already decoded.

A channel map is a bench.toml without buses and messages.  `signal` of a channel names a column;
`[time]`, or keys of the channel, state the source of its times; `[[run]]` cuts runs at given times.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, TypeAdapter, model_validator

from ..channels import Channel
from ..runs import Excitation
from .campaign import Step, numbered
from .config import DescribedCar, check_car, checked_channel
from .toml_file import Table, toml_tables, toml_text, validated

_Rate = Annotated[float, Field(gt=0, le=1e7)]


class Clock(Table):
    """The source of a channel's times; as `[time]` that of all channels that state none."""

    column: str = ""
    """The column of its times; empty: times from the rate, or as stated in the file."""
    unit: Annotated[str, Field(max_length=16)] = ""
    """Unit of that column; empty: as stated in the file, or else s."""
    rate_hz: _Rate | None = None
    """Samples per second, counted from the beginning of the file."""

    @model_validator(mode="after")
    def _one_clock(self) -> Clock:
        if self.column and self.rate_hz:
            raise ValueError("a clock has either column or rate_hz")
        return self


@dataclass(frozen=True, slots=True)
class Column(Channel):
    """One `[[channel]]` of a channel map; `signal` is the name of a column."""

    time_column: str = ""
    time_unit: Annotated[str, Field(max_length=16)] = ""
    rate_hz: _Rate | None = None

    @model_validator(mode="after")
    def _names_a_column(self) -> Column:
        if not 1 <= len(self.signal) <= 120:
            raise ValueError("signal is the name of a column, of 120 letters at most")
        if self.time_column and self.rate_hz:
            raise ValueError("a channel has either time_column or rate_hz")
        return self

    def channel(self, unit: str) -> Channel:
        """Return the channel in an SI unit, without the source of its times."""
        stated = {f.name: getattr(self, f.name) for f in fields(Channel)}
        return Channel(**{**stated, "unit": unit})


class GivenRun(Table):
    """One `[[run]]`: a run that is cut at given times of the file, s."""

    mass_state: Literal["baseline", "added"]
    excitation: Excitation
    start_s: float
    stop_s: float

    @model_validator(mode="after")
    def _lasts(self) -> GivenRun:
        if not 0.0 < self.stop_s - self.start_s <= 3600.0:
            raise ValueError("stop_s is after start_s, by an hour at most")
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMap(DescribedCar):
    """A complete channel map: its channels are columns of a file."""

    time: Clock = field(default_factory=Clock)
    given_runs: Annotated[tuple[GivenRun, ...], Field(alias="run")] = ()
    """The runs; empty: the trigger finds them."""
    channels: Annotated[
        tuple[Annotated[Column, AfterValidator(checked_channel)], ...],
        Field(alias="channel", min_length=1, max_length=1000),
    ]

    def clock(self, column: Column) -> Clock:
        """Return the source of the times of a channel."""
        if not (column.time_column or column.rate_hz):
            return self.time
        unit = column.time_unit or self.time.unit
        return Clock(column=column.time_column, unit=unit, rate_hz=column.rate_hz)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all required columns, each once."""
        names = [channel.signal for channel in self.channels]
        names += [self.clock(channel).column for channel in self.channels]
        return tuple(dict.fromkeys(name for name in names if name))

    @property
    def runs(self) -> tuple[tuple[Step, float, float], ...]:
        """Step, start and stop of each given run, s in the file's time."""
        steps = numbered((run.mass_state, run.excitation) for run in self.given_runs)
        times_s = ((run.start_s, run.stop_s) for run in self.given_runs)
        return tuple((step, *span_s) for step, span_s in zip(steps, times_s, strict=True))


def load_channel_map(path: Path) -> ChannelMap:
    """Read a channel map.

    Raises InputError with file and key, if it cannot be read, has an unknown key or a bad value.
    """
    text, where = toml_text(path, "name a channel map"), str(path)
    channel_map = validated(toml_tables(text, where), where, TypeAdapter(ChannelMap))
    channel_map = replace(channel_map, text=text, where=where)
    check_car(channel_map)
    return channel_map
