"""The nouns of a bench session: sample groups, runs, the session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, read_only

from .channels import Channel
from .display import session_html
from .vehicle import MassState, Vehicle

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

BASELINE = "baseline"
ADDED = "added"


class Excitation(StrEnum):
    """How the vehicle is bumped."""

    BOUNCE = "bounce"
    PITCH = "pitch"
    ROLL = "roll"
    WARP = "warp"


class RunStatus(StrEnum):
    """What became of a run; only accepted runs are identified, none is ever deleted."""

    ACCEPTED = "accepted"
    REJECTED = "rejected"


@dataclass(frozen=True, slots=True)
class SampleGroup:
    """Channels that share one sample clock, usually the signals of one message.

    Parameters
    ----------
    name : str
        Name of the message.
    time_s : (n,) float64
        Time of each sample since the run's t0, s: the sensor's clock fitted to the bus time where
        the message has a counter (`daq.samples.clock`), else the bus time.  Strictly increasing.
    t_ns : (n,) int64
        Bus time stamps as received.
    values : mapping of channel name to (n,) float64
        SI values; NaN where the sample is unusable.
    quality : (n,) uint8
        Bits of `dbc.samples.Quality`.
    """

    name: str
    time_s: NDArray[np.float64]
    t_ns: NDArray[np.int64]
    values: Mapping[str, NDArray[np.float64]]
    quality: NDArray[np.uint8]

    def __post_init__(self) -> None:
        n = len(self.time_s)
        columns = {"t_ns": self.t_ns.shape, "quality": self.quality.shape}
        columns |= {name: column.shape for name, column in self.values.items()}
        for name, shape in columns.items():
            if shape != (n,):
                raise ValueError(f"group {self.name}: {name} has shape {shape}, not ({n},)")
        object.__setattr__(self, "time_s", read_only(self.time_s))
        object.__setattr__(self, "t_ns", read_only(self.t_ns))
        object.__setattr__(self, "quality", read_only(self.quality))
        frozen = {name: read_only(column) for name, column in self.values.items()}
        object.__setattr__(self, "values", MappingProxyType(frozen))


@dataclass(frozen=True, slots=True)
class Losses:
    """Frames that were lost or unusable, counted at every hop from the wire to the run.

    Parameters
    ----------
    bus_dropped : int
        Lost before we could read them, as far as the interface tells.
    bus_garbled : int
        Read from the interface and not a frame.
    queue_dropped : int
        Lost between the reader and the writer because the queue was full.
    counter_gaps : int
        Frames missing by the sensors' rolling counters.
    crc_bad, wrong_length, unknown_id, error_frames, remote_frames : int
        Received, stored raw, not decoded.
    """

    bus_dropped: int = 0
    bus_garbled: int = 0
    queue_dropped: int = 0
    counter_gaps: int = 0
    crc_bad: int = 0
    wrong_length: int = 0
    unknown_id: int = 0
    error_frames: int = 0
    remote_frames: int = 0

    @property
    def measured(self) -> int:
        """Frames of this bench that did not become samples (foreign ids do not count)."""
        return (
            self.bus_dropped
            + self.bus_garbled
            + self.queue_dropped
            + self.counter_gaps
            + self.crc_bad
            + self.wrong_length
        )


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at a time: a trigger, a fault, an operator's note."""

    t_ns: int
    code: str
    value: float = 0.0
    text: str = ""


@dataclass(frozen=True, slots=True)
class Run:
    """One bump and its free decay.

    Parameters
    ----------
    mass_state : str
        Name of the mass state.
    excitation : Excitation
        How the vehicle was bumped.
    repeat : int
        Counts from 1 within mass state and excitation.
    t0_ns : int
        Bus time of `time_s` = 0, ns since 1970 UTC.
    bump_s : float
        Duration of the bump as the campaign states it, s; NaN if it is not known.
    groups : tuple of SampleGroup
        The measured samples.
    status, reasons : RunStatus, tuple of str
        Verdict and why.
    losses : Losses
        What is missing from this run.
    events : tuple of Event
        What happened during it.
    frames : FrameBatch
        The raw frames; empty for data that never were on a bus.
    """

    mass_state: str
    excitation: Excitation
    repeat: int
    t0_ns: int
    bump_s: float
    groups: tuple[SampleGroup, ...]
    status: RunStatus
    reasons: tuple[str, ...]
    losses: Losses
    events: tuple[Event, ...]
    frames: FrameBatch

    @property
    def label(self) -> str:
        """`baseline_bounce_1` and the like."""
        return f"{self.mass_state}_{self.excitation}_{self.repeat}"


@dataclass(frozen=True, slots=True)
class Session:
    """A bench session: everything that the identification is given.

    Parameters
    ----------
    vehicle : Vehicle
        The vehicle as far as it is known beforehand.
    channels : tuple of Channel
        Every channel of the runs.
    mass_states : tuple of MassState
        Loading of the vehicle.
    runs : tuple of Run
        In order of recording.
    provenance : mapping of str to str
        Where it comes from: uuid, created, software, dbc (text), bench_toml (text), hashes.
    """

    vehicle: Vehicle
    channels: tuple[Channel, ...]
    mass_states: tuple[MassState, ...]
    runs: tuple[Run, ...]
    provenance: Mapping[str, str]

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return session_html(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return all samples as one pandas table.

        Returns
        -------
        pandas.DataFrame
            Columns `run`, `group`, `status` (categories), `time_s`, `t_ns`, `quality`, then one a
            channel, SI; NaN in the rows of groups that do not have it.  Units are in
            ``attrs["units"]``.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        from .formats.tables import to_dataframe

        return to_dataframe(self)

    def to_xarray(self) -> xr.DataTree:
        """Return the runs as a tree of xarray datasets.

        Returns
        -------
        xarray.DataTree
            ``tree["baseline_bounce_1/HUB_Front"]`` holds the channels of one sample clock along
            `time`, s since t0 of the run, with their `units`; the attributes of
            ``tree["baseline_bounce_1"]`` are those of the run.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        from .formats.tables import to_xarray

        return to_xarray(self)
