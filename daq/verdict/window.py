"""Defines the data from which a run is judged, and the measures that are kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only

from ..bumps import Wheels
from ..channels import Channel, Quantity
from ..runs import Losses
from ..samples.mapping import SampleBlock

BEFORE_S = 0.03
"""Time directly before the trigger that is left out of the rest, s: a slow bump begins below the
level."""
_FEWEST = 8
"""Least number of samples of a channel that is judged."""

ANGULAR = frozenset(
    {
        Quantity.PITCH_RATE,
        Quantity.ROLL_RATE,
        Quantity.PITCH_ACCELERATION,
        Quantity.ROLL_ACCELERATION,
    }
)


@dataclass(frozen=True, slots=True)
class RunWindow:
    """A run as received, from `pre_s` before to `post_s` after the bump."""

    bump_ns: int
    """Time stamp of the bump, ns."""
    channels: SampleBlock
    """Samples of each channel: t_ns (n,) and value (n,) float64, SI, NaN where a sample cannot be
    used; channels may be empty or absent."""
    losses: Losses = field(default_factory=Losses)
    """Frames lost within the run."""
    stale: tuple[str, ...] = ()
    """Messages with a long silence during the run, as known from other sources than the samples."""
    saturated: tuple[str, ...] = ()
    """Channels with samples at the end of the signal's range."""
    timed: frozenset[str] = frozenset()
    """Messages whose counter or time stamp gives the time of a sample: their frames may arrive late
    and together without a loss."""


@dataclass(frozen=True, slots=True)
class RunMeasure:
    """The measures of a run, for display to the operator and for comparison with later runs."""

    peak_m_s2: float | None = None
    """Largest deviation from rest of any acceleration, m/s2; None without one."""
    peak_m: float | None = None
    """Largest deviation from rest of any displacement, m; None without one."""
    frequency_hz: float | None = None
    """Natural frequency of the body's motion after the bump, from one damped wave, Hz; None if the
    motion shows none."""
    damping: float | None = None
    """Damping ratio of the same wave."""
    shares: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Share of bounce, pitch, roll and warp in the corners' motion, 0..1; empty if unknown."""
    purity: float | None = None
    """Likeness of the corners' motion to the excitation that was due, 0..1; None if unknown."""
    wheels: Wheels | None = None
    """The struck wheels, if they are those of the kind due or its mirror image; None otherwise, or
    if unknown."""
    peaks: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Largest deviation from rest of each channel, SI."""
    waves: Mapping[str, NDArray[np.float64]] = field(default_factory=lambda: MappingProxyType({}))
    """The slow motion after the bump on a common time axis (`daq.verdict.repeats`), SI, each shape
    (n,)."""
    levels: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Level of each suspension travel before the bump, m."""
    roughness: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """RMS of the part that no swing of a wheel explains, of each channel, SI: rattle and noise."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One channel of a run, as deviation from rest."""

    channel: Channel
    """The channel."""
    time_s: NDArray[np.float64]
    """Time since the bump, s, shape (n,)."""
    value: NDArray[np.float64]
    """Deviation from the level before the bump, SI, shape (n,)."""
    noise: float
    """Standard deviation of white noise, from the differences of neighbouring samples before the
    bump, which slow motion does not affect."""
    moved: float
    """RMS before the bump, SI."""
    level: float
    """Level before the bump, SI."""

    def part(self, start_s: float, stop_s: float) -> NDArray[np.float64]:
        """Return the values between two times."""
        first, last = np.searchsorted(self.time_s, [start_s, stop_s])
        return self.value[first:last]

    def rms(self, start_s: float, stop_s: float) -> float:
        """Return the RMS between two times, without the noise; 0 if there are no samples."""
        part = self.part(start_s, stop_s)
        power = float(np.mean(part**2)) if len(part) else 0.0
        return float(np.sqrt(max(power - self.noise**2, 0.0)))

    @property
    def peak(self) -> float:
        """Largest deviation after the bump."""
        after = self.part(0.0, np.inf)
        return float(np.max(np.abs(after))) if len(after) else 0.0


def traces(channels: tuple[Channel, ...], window: RunWindow) -> tuple[Trace, ...]:
    """Return the channels that can be judged in a run, without unused ones."""
    return tuple(_traces(channels, window))


def _traces(channels: tuple[Channel, ...], window: RunWindow) -> Iterator[Trace]:
    for channel in channels:
        if channel.quantity is Quantity.UNUSED or channel.name not in window.channels:
            continue
        t_ns, value = window.channels[channel.name]
        good = np.isfinite(value)
        time_s = np.asarray((t_ns[good] - window.bump_ns) * 1e-9, dtype=np.float64)
        order = np.argsort(time_s, kind="stable")
        time_s, value = time_s[order], value[good][order]
        before = value[time_s < -BEFORE_S]
        if len(value) < _FEWEST or not len(before):
            continue
        level = float(np.median(before))
        deviation = np.asarray(value - level, dtype=np.float64)
        before = before - np.mean(before)
        noise = float(np.std(np.diff(before)) / np.sqrt(2.0)) if len(before) > 2 else 0.0
        moved = float(np.sqrt(np.mean(before**2)))
        yield Trace(channel, read_only(time_s), read_only(deviation), noise, moved, level)


def kin(trace: Trace, others: tuple[Trace, ...]) -> tuple[Trace, ...]:
    """Return the traces whose size can be compared with this one's."""
    own = trace.channel.quantity
    alike = {own} if own not in ANGULAR else ANGULAR & {own, *_SAME_ORDER[own]}
    return tuple(other for other in others if other.channel.quantity in alike)


_SAME_ORDER = {
    Quantity.PITCH_RATE: {Quantity.ROLL_RATE},
    Quantity.ROLL_RATE: {Quantity.PITCH_RATE},
    Quantity.PITCH_ACCELERATION: {Quantity.ROLL_ACCELERATION},
    Quantity.ROLL_ACCELERATION: {Quantity.PITCH_ACCELERATION},
}
