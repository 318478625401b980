"""Reads channel maps: which columns of a file are which channels, for data already decoded.

A channel map is a bench.toml without buses and messages.  `signal` of a channel names a column;
`[time]`, or keys of the channel, state the source of its times; `[[run]]` cuts runs at given times.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, model_validator

from dbc.words import InputError

from ..channels import Channel
from ..runs import Excitation
from .campaign import Step
from .config import Bench, DescribedCar, check_car, checked_channel, day_as_text
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


def _names_a_column(column: Column) -> Column:
    """Return the column; raises ValueError unless it has a name and at most one clock."""
    if not 1 <= len(column.signal) <= 120:
        raise ValueError("signal is the name of a column, of 120 letters at most")
    if column.time_column and column.rate_hz:
        raise ValueError("a channel has either time_column or rate_hz")
    return column


class RunTable(Table):
    """One `[[run]]`: a run that is cut at given times."""

    mass_state: str
    excitation: Excitation
    start_s: float
    stop_s: float

    @model_validator(mode="after")
    def _lasts(self) -> RunTable:
        if not 0.0 < self.stop_s - self.start_s <= 3600.0:
            raise ValueError("stop_s is after start_s, by an hour at most")
        return self


_Columns = tuple[
    Annotated[
        Column,
        BeforeValidator(day_as_text),
        AfterValidator(checked_channel),
        AfterValidator(_names_a_column),
    ],
    ...,
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMapFile(DescribedCar):
    """A complete channel map."""

    time: Clock = field(default_factory=Clock)
    run: tuple[RunTable, ...] = ()
    channels: Annotated[_Columns, Field(alias="channel", min_length=1, max_length=1000)]


@dataclass(frozen=True, slots=True)
class ChannelMap:
    """Assigns the columns of a file to channels."""

    bench: Bench
    """Vehicle, weights, campaign, trigger and channels; their signals are columns."""
    clocks: Mapping[str, Clock]
    """By channel."""
    runs: tuple[tuple[Step, float, float], ...]
    """Step, start and stop of each run, s in the file's time; empty: the trigger finds them."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all required columns, each once."""
        names = [channel.signal for channel in self.bench.channels]
        names += [clock.column for clock in self.clocks.values() if clock.column]
        return tuple(dict.fromkeys(names))


def load_channel_map(path: Path) -> ChannelMap:
    """Read a channel map.

    Raises InputError with file and key, if it cannot be read, has an unknown key or a bad value.
    """
    text, where = toml_text(path, "name a channel map"), str(path)
    file = validated(toml_tables(text, where), where, TypeAdapter(ChannelMapFile))
    file = replace(file, text=text, where=where)
    check_car(file)
    channel_keys = [f.name for f in fields(Channel)]
    channels = tuple(Channel(**{k: getattr(c, k) for k in channel_keys}) for c in file.channels)
    shared = {f.name: getattr(file, f.name) for f in fields(DescribedCar)}
    bench = Bench(**{**shared, "channels": channels})
    clocks = {}
    for column in file.channels:
        clocks[column.name] = file.time
        if column.time_column or column.rate_hz:
            unit, rate_hz = column.time_unit or file.time.unit, column.rate_hz
            clocks[column.name] = Clock(column=column.time_column, unit=unit, rate_hz=rate_hz)
    states = [state.name for state in bench.mass_states]
    n_runs: Counter[tuple[str, str]] = Counter()  # of each mass state and excitation
    runs = []
    for run in file.run:
        if run.mass_state not in states:
            fault = f"mass state {run.mass_state!r} is not on this bench"
            raise InputError(where, fault, f"use one of {', '.join(states)}")
        n_runs[run.mass_state, run.excitation] += 1
        step = Step(run.mass_state, run.excitation, n_runs[run.mass_state, run.excitation])
        runs.append((step, run.start_s, run.stop_s))
    return ChannelMap(bench, MappingProxyType(clocks), tuple(runs))
