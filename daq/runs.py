"""Defines a run and its parts: sample groups, silences of a sensor, losses, events."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, freeze_arrays, read_only
from dbc.words import counted

BASELINE = "baseline"
ADDED = "added"


class Excitation(StrEnum):
    """The kind of bump."""

    BOUNCE = "bounce"
    PITCH = "pitch"
    ROLL = "roll"
    WARP = "warp"
    REAR_PITCH = "rear_pitch"

    @property
    def words(self) -> str:
        """The kind as words in a sentence: `rear pitch`."""
        return self.replace("_", " ")


class RunStatus(StrEnum):
    """Status of a run; only accepted runs are identified, none is ever deleted."""

    OPEN = "open"
    """It is being recorded; never so in a session."""
    ACCEPTED = "accepted"
    REJECTED = "rejected"


@dataclass(frozen=True, slots=True)
class SampleGroup:
    """Channels that share one sample clock, usually the signals of one message."""

    name: str
    """Name of the message."""
    time_s: NDArray[np.float64]
    """Time of each sample since the run's t0, s: the sensor's clock fitted to the bus time where
    the message has a counter (`daq.samples.clock`), else the bus time; increasing, shape (n,)."""
    t_ns: NDArray[np.int64]
    """Bus time stamps as received, shape (n,)."""
    values: Mapping[str, NDArray[np.float64]]
    """SI values, each shape (n,); NaN where the sample is unusable."""
    quality: NDArray[np.uint8]
    """Bits of `dbc.codec.Quality`, shape (n,)."""

    def __post_init__(self) -> None:
        n = len(self.time_s)
        columns = {"t_ns": self.t_ns.shape, "quality": self.quality.shape}
        columns |= {name: column.shape for name, column in self.values.items()}
        for name, shape in columns.items():
            if shape != (n,):
                raise ValueError(f"group {self.name}: {name} has shape {shape}, not ({n},)")
        freeze_arrays(self, "time_s", "t_ns", "quality")
        frozen = {name: read_only(column) for name, column in self.values.items()}
        object.__setattr__(self, "values", frozen)


@dataclass(frozen=True, slots=True)
class Losses:
    """Numbers of frames that were lost or unusable, at every hop from the wire to the run."""

    bus_dropped: int = 0
    """Frames lost before they could be read, as counted by the interface."""
    bus_garbled: int = 0
    """Pieces read from the interface that are not frames."""
    queue_dropped: int = 0
    """Frames lost between the reader and the writer because the queue was full."""
    counter_gaps: int = 0
    """Frames that are missing according to the sensors' rolling counters."""
    crc_bad: int = 0
    """Frames whose checksum does not match; stored raw, their samples are unusable."""
    wrong_length: int = 0
    """Frames with another length than in the DBC; of a shorter one signals are missing."""
    unknown_id: int = 0
    """Frames whose identifier is not in the DBC; stored raw, not decoded."""
    error_frames: int = 0
    """Error frames of the bus; stored raw."""
    remote_frames: int = 0
    """Remote frames, which have no payload; stored raw."""

    @property
    def unusable(self) -> int:
        """Number of frames that are stored, but damaged or of another length."""
        return self.crc_bad + self.wrong_length

    @property
    def measured(self) -> int:
        """Number of frames that are lost or unusable, without those of unknown identifiers."""
        lost = self.bus_dropped + self.bus_garbled + self.queue_dropped + self.counter_gaps
        return lost + self.unusable

    @property
    def words(self) -> str:
        """The losses as text, like `3 frames lost, 100 unusable`; empty if there is none."""
        lost, unusable = self.measured - self.unusable, self.unusable
        if not lost:
            return f"{counted(unusable, 'frame')} unusable" if unusable else ""
        return f"{counted(lost, 'frame')} lost" + (f", {unusable:,} unusable" if unusable else "")


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at a time: a trigger, a fault, an operator's note."""

    t_ns: int
    code: str
    value: float = 0.0
    text: str = ""


def run_label(mass_state: str, excitation: Excitation, repeat: int) -> str:
    """Return `baseline_bounce_1` and the like."""
    return f"{mass_state}_{excitation}_{repeat}"


@dataclass(frozen=True, slots=True)
class Run:
    """One bump and its free decay."""

    mass_state: str
    excitation: Excitation
    repeat: int
    """Number of the repeat, from 1 within mass state and excitation."""
    t0_ns: int
    """Bus time of `time_s` = 0, ns since 1970 UTC."""
    bump_s: float
    """Duration of the bump as stated in the campaign, s; NaN if it is not known."""
    groups: tuple[SampleGroup, ...]
    status: RunStatus
    reasons: tuple[str, ...] = ()
    losses: Losses = Losses()
    """Frames that were lost or unusable in this run."""
    events: tuple[Event, ...] = ()
    frames: FrameBatch = field(default_factory=FrameBatch.empty)
    """The raw frames; empty for data that did not come from a bus."""

    @property
    def label(self) -> str:
        """`baseline_bounce_1` and the like."""
        return run_label(self.mass_state, self.excitation, self.repeat)

    @property
    def is_accepted(self) -> bool:
        """True if the run is used."""
        return self.status is RunStatus.ACCEPTED

    @property
    def length_s(self) -> float:
        """Time of the last sample since t0, s."""
        return max((float(g.time_s[-1]) for g in self.groups if len(g.time_s)), default=0.0)


STALE_S = 0.25
"""Longest allowed silence of a sensor, s: a quarter of a body's period."""
WHEEL_MOTION_S = 0.2
"""Time after the bump by which 97 % of the wheels' motion is over, s."""


class Silence(NamedTuple):
    """A time without a sample."""

    begin_s: float
    """Time of the sample before it, or begin of the run, s."""
    end_s: float
    """Time of the sample after it, or end of the run, s."""
    limit_s: float
    """Longest silence that is allowed at this rate, s."""

    @property
    def length_s(self) -> float:
        """Duration, s."""
        return self.end_s - self.begin_s

    @property
    def is_stale(self) -> bool:
        """True if it is too long."""
        return self.length_s > self.limit_s


def longest_silence(time_s: NDArray[np.floating], begin_s: float, end_s: float) -> Silence:
    """Return the longest silence between begin and end of a run.

    `time_s`: times of the usable samples of a sensor, s, (n,), in any order; may be empty.
    """
    time_s = np.sort(time_s, kind="stable")  # fast where they are in order, as most are
    cycle_s = float(np.median(np.diff(time_s))) if len(time_s) > 2 else 0.0
    limit_s = allowed_silence_s(cycle_s)
    edges = np.concatenate([[begin_s], np.clip(time_s, begin_s, end_s), [end_s]])
    longest = int(np.argmax(np.diff(edges)))
    return Silence(float(edges[longest]), float(edges[longest + 1]), limit_s)


def allowed_silence_s(cycle_s: float) -> float:
    """Return the longest silence that a run may have, s; `cycle_s`: between two samples."""
    return max(STALE_S, 10.0 * cycle_s)  # a slow message may be silent for ten cycles


def longest_gap_s(period_s: float) -> float:
    """Return the longest gap that is allowed while the wheels move, s.

    A quarter of their period: a decay that starts so late loses a fifth of the precision.  Two
    consecutive lost samples are no gap in any message.  `period_s`: between samples.
    """
    return max(0.02, 3.5 * period_s)  # two lost samples: three periods, and some scatter
