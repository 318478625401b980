"""Free decays: the part of a run in which no force but gravity acts, ready for a fit."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from daq.channels import Channel, Quantity
from daq.runs import Run
from dbc.frames import read_only

from ..model.matrices import Real


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
    time_s: Real
    """Time at which the motion was as measured, s, shape (n,); in a `FreeDecay` since its start."""
    values: Real
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
        sampled_hz = (len(self.time_s) - 1) / float(self.time_s[-1] - self.time_s[0])
        step = max(1, round(sampled_hz / rate_hz))
        return Recording(self.group, self.time_s[::step], self.values[::step])


@dataclass(frozen=True, slots=True, eq=False)
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
        return max(float(r.time_s[-1]) for r in self.recordings) + 1e-9  # s

    def decay(self, start_s: float) -> FreeDecay:
        """Return the free decay from `start_s` to the end of the record.

        A group of which it has fewer than two samples is left out: the level of a sensor is
        unknown, so one sample states nothing.
        """
        cut = (r.between(start_s, np.inf) for r in self.recordings)
        recordings = tuple(r for r in cut if len(r.time_s) > 1)
        return FreeDecay(self.label, self.mass_state, start_s, recordings)

    def whole(self, cut: Recording) -> Recording:
        """Return the recording of the record that one of its decay is cut from."""
        return next(r for r in self.recordings if r.group == cut.group)


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
        with_values = (name for name, column in group.values.items() if np.isfinite(column).any())
        for members in _sampled_alike(tuple(used[name] for name in with_values if name in used)):
            values = np.column_stack([group.values[c.name] for c in members])
            complete = np.isfinite(values).all(axis=1)
            time_s = group.time_s[complete] - members[0].delay_s
            if complete.any():
                channel_group = ChannelGroup(group.name, members)
                recordings.append(Recording(channel_group, time_s, values[complete]))
    return Record(run.label, run.mass_state, run.bump_s, tuple(recordings))


def _sampled_alike(channels: tuple[Channel, ...]) -> list[tuple[Channel, ...]]:
    """Return the channels of a sample group in groups equally late and of one low-pass."""
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
        for members in _sampled_alike(tuple(c for c in changed if c is not None)):
            columns = [column[c.name] for c in members]
            group = ChannelGroup(r.group.name, members)
            recordings.append(Recording(group, r.time_s, r.values[:, columns]))
    return replace(decay, recordings=tuple(recordings))


# Finds the start of the free decay of a record, and the noise of its sensors at rest --------------

GUARD_S = 0.01  # onset detection and the spread of the four wheels over the bump
_REST_S = 0.08  # at the beginning, which must be at rest; the paper's records have 0.1 s
_REST_SAMPLES = 3  # fewer do not give a spread
_MOVING = 4.0
"""Scatter in units of the noise, above which a channel moves."""
_ONSET_SHARE = 0.02  # of the channel's peak, where there is no noise to compare with
_CACHED_RUNS = 256
"""Runs whose onset and rest are kept: many gates ask for them."""


@lru_cache(maxsize=_CACHED_RUNS)
def onset_s(record: Record) -> float | None:
    """Return the first time at which a channel leaves its level at rest, s.

    None if a channel moves in the first `_REST_S`, none leaves its level, or no group has
    `_REST_SAMPLES` samples by then.  `record`: a run with its time stamps as measured.
    """
    onsets_s = []
    for recording in record.recordings:
        values = recording.values
        is_early = recording.time_s < record.start_s + _REST_S
        # A slow group has too few samples in so short a rest; the others show whether there is one.
        if is_early.sum() < _REST_SAMPLES:
            continue
        level, spread = values[is_early].mean(axis=0), values[is_early].std(axis=0)
        # The last fifth: there the motion has died away.
        noise = difference_noise(values[-max(len(values) // 5, _REST_SAMPLES) :])
        largest_still = np.maximum(_MOVING * noise, _ONSET_SHARE * values.std(axis=0))
        if (spread > largest_still).any():
            return None
        away = np.abs(values - level)
        onset_limit = np.maximum(6.0 * np.maximum(spread, noise), _ONSET_SHARE * away.max(axis=0))
        is_beyond = away > onset_limit
        has_moved = is_beyond[:-1] & is_beyond[1:]  # one alone is chance, or a glitch
        first_moved = [np.argmax(column) for column in has_moved.T if column.any()]
        onsets_s += [float(recording.time_s[i]) for i in first_moved]
    return min(onsets_s) if onsets_s else None


def is_still(record: Record) -> bool:
    """Return whether nothing but noise is in a record: no bump, and no motion after one."""
    if onset_s(record) is not None:
        return False
    for recording in record.recordings:
        values = recording.values
        if len(values) < 2:
            continue
        rounding = 1e-12 * np.abs(values).max(axis=0)
        if not (values.std(axis=0) <= _MOVING * difference_noise(values) + rounding).all():
            return False
    return True


def decay_start_s(record: Record) -> float:
    """Return the start of the free decay by the stated bump, s; the record may end before it.

    Without a stated bump, at most half-way from onset to end; without an onset, the record's start.
    """
    onset = onset_s(record)
    if onset is None:
        return record.start_s
    if np.isfinite(record.bump_s):
        return onset + record.bump_s + GUARD_S
    # 0.35 s is longer than any bump that is rolled over; the fit moves the start back.
    return min(onset + 0.35 + GUARD_S, (onset + record.end_s) / 2)


def quiet_noise(records: Sequence[Record]) -> dict[str, float]:
    """Return each channel's standard deviation at rest before the bump, pooled over the records.

    In SI units; at least that of rounding to the step of a coarse sensor.  Empty if a channel has
    fewer than 100 samples at rest.
    """
    counts, rests = quiet_counts(records), _rests_by_channel(records)
    names = {c.name for r in records for each in r.recordings for c in each.group.channels}
    if any(counts.get(name, 0) < 100 for name in names):  # too few for a level to 10 %
        return {}
    steps = coarse_steps(records)
    squares = {name: sum(len(v) * np.var(v) for v in each) for name, each in rests.items()}
    return {
        name: max(float(np.sqrt(squares[name] / n_values)), steps.get(name, 0.0) / np.sqrt(12.0))
        for name, n_values in counts.items()
    }


def coarse_steps(records: Sequence[Record]) -> dict[str, float]:
    """Return the steps of the channels that show fewer than half a step of noise at rest, SI.

    Their values at rest are few, so that rounding hides the noise.  The step is the least distance
    of two values in the whole of the records that have a rest.
    """
    resting = [record for record in records if _rest_by_channel(record)]
    all_values = by_channel(r for record in resting for r in record.recordings)
    steps = {}
    for name, rests in _rests_by_channel(records).items():
        rest_values = np.sort(np.concatenate(rests))
        has_few_values = 2 * np.count_nonzero(np.diff(rest_values)) < len(rest_values)
        if has_few_values:
            values = np.sort(np.concatenate(all_values[name]))
            distances = np.diff(values)
            distances = distances[distances > 1e-9 * np.abs(values[[0, -1]]).max()]  # no rounding
            if len(distances) and rest_values.std() < distances.min() / 2.0:
                steps[name] = float(distances.min())
    return steps


def quiet_counts(records: Sequence[Record]) -> dict[str, int]:
    """Return the degrees of freedom of each level of `quiet_noise`: one a run goes for its mean."""
    rests = _rests_by_channel(records)
    return {name: sum(len(v) - 1 for v in each) for name, each in rests.items()}


def by_channel(recordings: Iterable[Recording]) -> dict[str, list[Real]]:
    """Return the values of each channel, one array for each recording that has it."""
    columns: defaultdict[str, list[Real]] = defaultdict(list)
    for recording in recordings:
        for channel, values in zip(recording.group.channels, recording.values.T, strict=True):
            columns[channel.name].append(values)
    return columns


def _rests_by_channel(records: Iterable[Record]) -> dict[str, list[Real]]:
    """Return the values of each channel at rest, one array for each record that shows them."""
    rests: defaultdict[str, list[Real]] = defaultdict(list)
    for record in records:
        for name, values in _rest_by_channel(record).items():
            rests[name].append(values)
    return rests


@lru_cache(maxsize=_CACHED_RUNS)
def _rest_by_channel(record: Record) -> Mapping[str, Real]:
    """Return the values of each channel before the onset; of a group with enough of them."""
    onset = onset_s(record)
    end_s = -np.inf if onset is None else onset - 0.005  # s: the onset is seen a little late
    return {
        channel.name: values[r.time_s < end_s]
        for r in record.recordings
        if np.count_nonzero(r.time_s < end_s) >= _REST_SAMPLES
        for channel, values in zip(r.group.channels, r.values.T, strict=True)
    }


def difference_noise(values: Real) -> Real:
    """Return the white noise of each column, by successive differences (von Neumann).

    A smooth signal adds little to it, so it separates the noise of a residual from its misfit.
    """
    return np.asarray(np.sqrt(np.mean(np.diff(values, axis=0) ** 2, axis=0) / 2))
