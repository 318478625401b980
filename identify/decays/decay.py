"""Free decays: the part of a run in which no force but gravity acts, ready for a fit."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.runs import Run
from dbc.frames import read_only


@dataclass(frozen=True, slots=True)
class ChannelGroup:
    """Channels that are sampled at the same instants, equally late, through the same low-pass."""

    name: str
    """Name of the sample group."""
    channels: tuple[Channel, ...]
    """Channels in the order of the columns of the values."""

    @property
    def delay_sigma_s(self) -> float:
        """Standard uncertainty of the samples' nominal lateness, s."""
        return self.channels[0].delay_sigma_s


@dataclass(frozen=True, slots=True)
class Recording:
    """The samples of one channel group, with the nominal lateness taken off their times."""

    group: ChannelGroup
    """Channel group of the samples."""
    time_s: NDArray[np.float64]
    """Time at which the motion was as measured, s, shape (n,); in a `FreeDecay` since its start."""
    values: NDArray[np.float64]
    """SI values, no NaN, shape (n, n_channels)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", read_only(self.time_s))
        # Each channel by itself in memory: sums over the samples take a fraction of the time.
        object.__setattr__(self, "values", read_only(np.asfortranarray(self.values)))

    def between(self, start_s: float, end_s: float) -> Recording:
        """Return the samples with start <= time < end, times counted from the start."""
        keep = (self.time_s >= start_s) & (self.time_s < end_s)
        values = self.values.T[:, keep].T  # channel by channel, as they are in memory
        return Recording(self.group, self.time_s[keep] - start_s, values)

    def thinned(self, rate_hz: float) -> Recording:
        """Return every k-th sample, so that about `rate_hz` are left (all, if there are fewer)."""
        if len(self.time_s) < 2:
            return self
        own = (len(self.time_s) - 1) / float(self.time_s[-1] - self.time_s[0])
        step = max(1, round(own / rate_hz))
        return Recording(self.group, self.time_s[::step], self.values[::step])

    def calibrated(self, gains: Mapping[str, float]) -> Recording:
        """Return the samples divided by the gains of their channels; 1 for one without a gain."""
        factors = np.array([gains.get(channel.name, 1.0) for channel in self.group.channels])
        return Recording(self.group, self.time_s, self.values / factors)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Record:
    """The usable samples of the usable channels of a run.

    Compared by identity, so that derived values can be cached per record.
    """

    label: str
    mass_state: str
    """`label`, `mass_state`: of the run."""
    bump_s: float
    """Duration of the bump as stated, s; NaN if unknown."""
    recordings: tuple[Recording, ...]
    """One for each channel group."""

    @property
    def start_s(self) -> float:
        """Time of the first sample of the group that begins last."""
        return max(float(r.time_s[0]) for r in self.recordings)

    @property
    def end_s(self) -> float:
        """Time just after the last sample of the group that ends last."""
        return max(float(r.time_s[-1]) for r in self.recordings) + 1e-9

    def decay(self, start_s: float) -> FreeDecay:
        """Return the free decay from `start_s` to the end of the record.

        A group of which it has fewer than two samples is left out: the level of a sensor is
        unknown, so one sample states nothing.
        """
        parts = (r.between(start_s, np.inf) for r in self.recordings)
        recordings = tuple(part for part in parts if len(part.time_s) > 1)
        return FreeDecay(self.label, self.mass_state, start_s, recordings)

    def whole(self, part: Recording) -> Recording:
        """Return the recording that a recording of the decay is a part of."""
        return next(r for r in self.recordings if r.group == part.group)


@dataclass(frozen=True, slots=True)
class FreeDecay:
    """The part of a run in which no force but gravity acts."""

    label: str
    mass_state: str
    """`label`, `mass_state`: of the run."""
    start_s: float
    """Start within the run, s."""
    recordings: tuple[Recording, ...]
    """Samples, with times counted from the start."""

    @property
    def n_values(self) -> int:
        """Number of measured values."""
        return sum(r.values.size for r in self.recordings)

    def thinned(self, rate_hz: float) -> FreeDecay:
        """Return the decay with about `rate_hz` samples a second of each group."""
        thin = tuple(r.thinned(rate_hz) for r in self.recordings)
        return FreeDecay(self.label, self.mass_state, self.start_s, thin)


def record_of(run: Run, channels: tuple[Channel, ...]) -> Record:
    """Return the usable samples of a run; channels of quantity `unused` are passed over.

    Rows with a NaN are left out: a lost sample costs its information and nothing else.  A channel
    without any number is left out by itself.
    """
    used = {c.name: c.placed() for c in channels if c.quantity is not Quantity.UNUSED}
    recordings = []
    for group in run.groups:
        shown = (name for name, column in group.values.items() if np.isfinite(column).any())
        for members in _alike(tuple(used[name] for name in shown if name in used)):
            values = np.column_stack([group.values[c.name] for c in members])
            good = np.isfinite(values).all(axis=1)
            time = group.time_s[good] - members[0].delay_s
            if good.any():
                channel_group = ChannelGroup(group.name, members)
                recordings.append(Recording(channel_group, time, values[good]))
    return Record(run.label, run.mass_state, run.bump_s, tuple(recordings))


def _alike(channels: tuple[Channel, ...]) -> list[tuple[Channel, ...]]:
    """Group the channels of one sample group that are equally late and have one low-pass."""
    groups: defaultdict[tuple[float, ...], list[Channel]] = defaultdict(list)
    for c in channels:
        groups[c.delay_s, c.delay_sigma_s, c.low_pass_hz, c.low_pass_order].append(c)
    return [tuple(members) for members in groups.values()]


def with_channels(decay: FreeDecay, change: Callable[[Channel], Channel | None]) -> FreeDecay:
    """Return a decay with other descriptions of its channels.

    `decay`: the samples, which stay as they are.  `change`: from a channel to its replacement, or
    to None to leave it out.  The nominal lateness must not change.
    """
    recordings = []
    for r in decay.recordings:
        changed = [change(c) for c in r.group.channels]
        column = {c.name: number for number, c in enumerate(changed) if c is not None}
        for members in _alike(tuple(c for c in changed if c is not None)):
            columns = [column[c.name] for c in members]
            group = ChannelGroup(r.group.name, members)
            recordings.append(Recording(group, r.time_s, r.values[:, columns]))
    return replace(decay, recordings=tuple(recordings))
