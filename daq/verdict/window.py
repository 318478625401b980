"""Defines the data from which a run is judged, and the measures that are kept."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only

from ..channels import SI_UNITS, Channel, Quantity
from ..runs import Losses
from ..samples.mapping import SampleBlock

BEFORE_S = 0.03
"""Time before the trigger that is no rest, s: a slow bump begins below the level."""


@dataclass(frozen=True, slots=True)
class RunWindow:
    """A run as received, from `pre_s` before to `post_s` after the bump."""

    bump_ns: int
    """Time stamp of the bump, ns: when the trigger fired."""
    channels: SampleBlock
    """Samples of each channel: t_ns (n,) and value (n,) float64, SI, NaN where a sample cannot be
    used; channels may be empty or absent."""
    losses: Losses = field(default_factory=Losses)
    """Frames lost within the run."""
    saturated: tuple[str, ...] = ()
    """Channels with samples at the end of the signal's range."""
    timed: frozenset[str] = frozenset()
    """Messages whose counter or time stamp gives the time of a sample: their frames may arrive late
    and together without a loss."""


@dataclass(frozen=True, slots=True)
class RunMeasure:
    """The measures of a run, for comparison with other runs."""

    peaks: Mapping[str, float] = field(default_factory=dict)
    """Largest deviation from rest of each channel, SI."""
    waves: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """The slow motion after the bump on a common time axis (`daq.verdict.judge`), SI, (n,) each."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One channel of a run, as deviation from rest."""

    channel: Channel
    time_s: NDArray[np.float64]
    """Time since the bump, s, shape (n,)."""
    value: NDArray[np.float64]
    """Deviation from the level before the bump, SI, shape (n,)."""
    noise: float
    """Standard deviation of white noise, SI, from the differences of neighbouring samples before
    the bump, which slow motion does not affect; 0 with fewer than three samples."""
    rest_rms: float
    """RMS before the bump, SI."""

    @property
    def name(self) -> str:
        """Name of the channel."""
        return self.channel.name

    def part(self, start_s: float, stop_s: float) -> NDArray[np.float64]:
        """Return the values between two times."""
        begin, end = np.searchsorted(self.time_s, [start_s, stop_s])
        return self.value[begin:end]

    def rms(self, start_s: float, stop_s: float) -> float:
        """Return the RMS between two times, without the noise; 0 if there are no samples."""
        value = self.part(start_s, stop_s)
        power = float(np.mean(value**2)) if len(value) else 0.0
        return float(np.sqrt(max(power - self.noise**2, 0.0)))

    @property
    def peak(self) -> float:
        """Largest deviation since the beginning of the bump, up or down; 0 without a sample."""
        return float(np.max(np.abs(self.part(0.0, np.inf)), initial=0.0))


def traces(channels: Iterable[Channel], window: RunWindow) -> tuple[Trace, ...]:
    """Return the channels that can be judged in a run: eight samples, some on each side of 0 s."""
    judged = []
    for channel in channels:
        if channel.quantity is Quantity.UNUSED or channel.name not in window.channels:
            continue
        t_ns, value = window.channels[channel.name]
        good = np.isfinite(value)
        time_s = np.asarray((t_ns[good] - window.bump_ns) * 1e-9, dtype=np.float64)
        order = np.argsort(time_s, kind="stable")
        time_s, value = time_s[order], value[good][order]
        rest = value[time_s < -BEFORE_S]
        if len(value) < 8 or not len(rest) or time_s[-1] <= 0.0:  # too few to judge a course
            continue
        level = float(np.median(rest))
        # The variance of a difference of neighbours is twice that of a sample.
        noise = float(np.std(np.diff(rest)) / np.sqrt(2.0)) if len(rest) > 2 else 0.0
        deviation = read_only(np.asarray(value - level, dtype=np.float64))
        rest_rms = float(np.std(rest))
        judged.append(Trace(channel, read_only(time_s), deviation, noise, rest_rms))
    return tuple(judged)


def kind_of(channel: Channel) -> str:
    """Return a quantity; one name for pitch and roll, whose sizes can be compared."""
    unit = SI_UNITS[channel.quantity]
    return unit if unit.startswith("rad") else channel.quantity


def largest_peaks(signals: Iterable[Trace]) -> dict[str, float]:
    """Return the largest peak of each kind (`kind_of`), SI."""
    largest: dict[str, float] = {}
    for trace in signals:
        kind = kind_of(trace.channel)
        largest[kind] = max(trace.peak, largest.get(kind, 0.0))
    return largest
