"""Leaves out runs that cannot be used: the bench rejects them, an import does not."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq.channels import LARGEST, Channel, Quantity
from daq.runs import Run, RunStatus, SampleGroup, Silence, longest_silence
from daq.samples.converter import FROZEN_S, Hold, longest_hold
from daq.sessions import Session

from ..model.matrices import Real
from .decay import Record, decay_start_s, is_still, onset_s, record_of

_LEAST_S = 0.2
"""Least length of a decay, s: two periods of the wheels.  Shorter ones of a car with friction are
fitted by no model, after a long search."""
_Silences = Mapping[str, Silence]
"""The longest silence of each channel that shows a run, and the longest of all together."""
_ALL = ""
"""Stands for all channels together: then the clock jumped, or a piece was lost."""


@dataclass(frozen=True, slots=True)
class ChannelHold:
    """Longest hold of one value by one channel in one run."""

    channel: str
    run: str
    """`channel`, `run`: name and label."""
    longest: Hold

    @property
    def kind(self) -> str:
        """Mass state and kind of bump: the label without the number of the repeat."""
        return self.run.rpartition("_")[0]


@dataclass(frozen=True, slots=True)
class Usable:
    """The part of a session that can be used."""

    session: Session
    """The session; runs that cannot be used are rejected, with reasons, channels are unused."""
    records: tuple[Record, ...]
    """Record of each run that can be used and has samples."""
    silent: tuple[str, ...]
    """Channels that are silent for too long in most of these runs."""
    absurd: tuple[BadValue, ...]
    """Values of accepted runs that no sensor shows."""
    spikes: tuple[BadValue, ...]
    """Samples of accepted runs that stand out from those on both sides."""


def usable_session(session: Session) -> Session:
    """Return a session with only what can be used; see `usable`."""
    return usable(session).session


def usable(session: Session) -> Usable:
    """Return what can be used of a session.

    Values that no motion shows become NaN (`without_bad_values`).

    A channel with one value in all runs is unused: the fit would take a dead sensor for a part that
    stands still.

    A run is left out if a channel that shows a part of it is silent for longer than the bench
    allows (`daq.runs`), or holds its value while the vehicle moves: its plug is loose, and what
    it sent before is not sure.  A channel with this fault in most of its runs was recorded so, and
    these runs are used as they are.  Also left out are runs in which times go back, all sensors are
    silent together (the clock jumped), nothing moves, or the free decay is missing.
    """
    session, absurd, spiked = without_bad_values(session)
    session = replace(session, channels=_without_constant(session))
    used = {c.name for c in session.used_channels}
    silences = {run.label: _silences(run, used) for run in session.accepted}
    records = {run.label: record_of(run, session.channels) for run in session.accepted}
    holds = frozen([record for record in records.values() if record.recordings])
    shown_names = [name for of_run in silences.values() for name in of_run]
    often_silent = _silent_in_most(silences.values())
    often_frozen = _faulty_in_most([hold.channel for hold in holds], shown_names)
    runs = []
    for run in session.runs:
        if run.is_accepted:
            of_run = [h for h in holds if h.run == run.label and h.channel not in often_frozen]
            reasons = (  # of the first kind of fault that it has
                tuple(_backward_clocks(run, used))
                or tuple(_silence_lines(silences[run.label], often_silent))
                or tuple(_hold_lines(of_run))
                or tuple(_no_decay_lines(records[run.label]))
            )
            if reasons:
                run = replace(run, status=RunStatus.REJECTED, reasons=(*run.reasons, *reasons))
        runs.append(run)
    kept = [run.label for run in runs if run.is_accepted]
    kept_records = tuple(records[label] for label in kept if records[label].recordings)
    silent = _silent_in_most([silences[label] for label in kept])
    return Usable(replace(session, runs=tuple(runs)), kept_records, silent, absurd, spiked)


def _without_constant(session: Session) -> tuple[Channel, ...]:
    """Return the channels; those that never vary within an accepted run are unused.

    A channel without values stays as it is.
    """
    varies: defaultdict[str, list[bool]] = defaultdict(list)  # in each run that has values
    for group in (g for run in session.accepted for g in run.groups):
        for name, values in group.values.items():
            finite = values[np.isfinite(values)]
            if len(finite):
                varies[name].append(bool((finite != finite[0]).any()))
    constant = {name for name, in_runs in varies.items() if not any(in_runs)}
    return tuple(
        replace(c, quantity=Quantity.UNUSED, corner=None) if c.name in constant else c
        for c in session.channels
    )


def _silent_in_most(silences: Iterable[_Silences]) -> tuple[str, ...]:
    """Return the channels that are silent for too long in most of the runs that they show.

    Runs in which all channels are silent together do not count.
    """
    counted = [of_run for of_run in silences if of_run and not of_run[_ALL].is_stale]
    shown = [name for of_run in counted for name in of_run]
    stale = [name for of_run in counted for name, silence in of_run.items() if silence.is_stale]
    return _faulty_in_most(stale, shown)


def _faulty_in_most(faulty: Sequence[str], shown: Sequence[str]) -> tuple[str, ...]:
    """Return the channels with a fault in most of the runs that they show.

    `faulty`, `shown`: name of each channel, once for each run that it is faulty in, or shows.
    """
    return tuple(n for n in dict.fromkeys(faulty) if 2 * faulty.count(n) > shown.count(n))


def _silences(run: Run, used: set[str]) -> _Silences:
    """Return the longest silence of each used channel that has samples in a run, and of `_ALL`."""
    times_s = {
        name: time_s
        for group in run.groups
        for name, values in group.values.items()
        if name in used
        and len(time_s := group.time_s[np.isfinite(values) & np.isfinite(group.time_s)])
    }
    if not times_s:
        return {}
    times_s[_ALL] = all_times_s = np.unique(np.concatenate(list(times_s.values())))
    begin_s, end_s = float(all_times_s[0]), float(all_times_s[-1])
    return {name: longest_silence(time_s, begin_s, end_s) for name, time_s in times_s.items()}


def _backward_clocks(run: Run, used: set[str]) -> Iterator[str]:
    """Yield a line for each clock of used channels that goes back."""
    for group in run.groups:
        backward = np.flatnonzero(np.diff(group.time_s) < 0.0)
        if used & group.values.keys() and len(backward):
            yield f"the times of {group.name} go back after {group.time_s[backward[0]]:.2f} s"


def _silence_lines(silences: _Silences, often_silent: Sequence[str]) -> Iterator[str]:
    """Yield a line for each span of time in which channels were silent together.

    Not of those in `often_silent`.  A silence of all sensors hides those of single ones.
    """
    spans: defaultdict[str, list[str]] = defaultdict(list)
    all_silent = bool(silences) and silences[_ALL].is_stale
    for name, silence in silences.items():
        if silence.is_stale and name not in often_silent and (name == _ALL or not all_silent):
            begin_s = max(silence.begin_s, 0.0)  # the first sample may come before 0
            span = f"from {begin_s:.2f} to {silence.end_s:.2f} s (limit {silence.limit_s:.2f} s)"
            spans[span].append(name or "all sensors")
    for span, names in spans.items():
        yield f"{', '.join(names)} sent nothing {span}"


def _hold_lines(holds: Sequence[ChannelHold]) -> Iterator[str]:
    """Yield a line for each length of time for which channels held one value."""
    lengths: defaultdict[str, list[str]] = defaultdict(list)
    for hold in holds:
        lengths[f"{hold.longest.length_s:.2f} s"].append(hold.channel)
    for length, names in lengths.items():
        yield f"{', '.join(names)} held one value for {length} (limit {FROZEN_S:.2f} s)"


def _no_decay_lines(record: Record) -> Iterator[str]:
    """Yield the reason why a run with samples shows no free decay."""
    if not record.recordings:
        return
    length_s = record.end_s - decay_start_s(record)
    if is_still(record):
        yield "nothing moves in it"
    elif length_s < _LEAST_S:
        least = f"record longer (at least {_LEAST_S:.2f} s)"
        yield f"it ends {max(length_s, 0.0):.2f} s after the bump: {least}"


def frozen(records: Sequence[Record]) -> tuple[ChannelHold, ...]:
    """Return the values that were held while the vehicle moved, the longest first.

    A channel may be silent by symmetry (roll in a bounce run), and a coarse one may stay at one
    step of its converter.  So a held value counts only where the channel changes often enough at
    rest before the bump, or, if it is constant there too, in a repeat of the run.
    """
    # Where a channel hides the onset, the decay begins as in most other runs.
    starts_s = [decay_start_s(record) for record in records if onset_s(record) is not None]
    usual_start_s = float(np.median(starts_s)) if starts_s else -np.inf
    holds = []
    for record in records:
        rest_end_s, start_s = onset_s(record), decay_start_s(record)
        if rest_end_s is None:
            # With the bump as rest a coarse channel is frozen, which spares the fit this bump.
            rest_end_s = start_s = max(usual_start_s, record.start_s)
        for recording in record.recordings:
            for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
                longest = longest_hold(recording.time_s, column, rest_end_s, start_s)
                holds.append(ChannelHold(channel.name, record.label, longest))

    def usual_rate(hold: ChannelHold) -> float:
        """Return the changes per sample of the channel when it is healthy; NaN if not known."""
        rate = hold.longest.rest_rate
        # Of one value in the whole run, or with too few samples at rest: as in repeats with a rate.
        if hold.longest.length_s >= FROZEN_S and (hold.longest.constant or np.isnan(rate)):
            of_kind = [h for h in holds if (h.channel, h.kind) == (hold.channel, hold.kind)]
            rates = [r for h in of_kind if h is not hold and (r := h.longest.decay_rate) >= 0.0]
            rate = float(np.mean(rates)) if rates else np.nan
        return rate

    stuck = [hold for hold in holds if hold.longest.is_frozen(usual_rate(hold))]
    return tuple(sorted(stuck, key=lambda hold: -hold.longest.length_s))


# Takes values that no motion shows out of a session: absurd ones, and spikes ----------------------

_ROUNDING = 1e-12
"""Magnitude, SI, below which a channel shows only a simulation's rounding: it is taken as zero."""
_MOST_SAMPLES = 3
"""Most samples of a spike."""
_NEAR_S, _NEAR_SAMPLES = 0.05, 12
"""Length of a side of a spike in time and in samples: the longer of the two is compared."""


@dataclass(frozen=True, slots=True)
class BadValue:
    """Values of one channel in one run that no motion shows."""

    channel: str
    run: str
    """`channel`, `run`: name and label."""
    time_s: float
    """Time of the first of them since the run's t0, s."""
    value: float
    """Its value, SI."""
    count: int
    """Number of these values."""


def without_bad_values(
    session: Session,
) -> tuple[Session, tuple[BadValue, ...], tuple[BadValue, ...]]:
    """Return a session whose accepted runs miss (NaN) bad values, the absurd ones, and the spikes.

    Absurd are those above `LARGEST`, infinite ones too.  A channel that never exceeds `_ROUNDING`
    in a run is zero there.
    """
    used = {c.name for c in session.used_channels}
    absurd: list[BadValue] = []
    spiked: list[BadValue] = []

    def cleaned(run: Run, group: SampleGroup, name: str) -> Real:
        """Return a channel's values in a run, NaN for bad ones, which go into the two lists."""
        values = group.values[name].copy()
        if np.fmax.reduce(np.abs(values), initial=0.0) <= _ROUNDING:
            values[np.isfinite(values)] = 0.0
        is_absurd = np.abs(values) > LARGEST  # false for NaN
        finite = np.flatnonzero(np.isfinite(values) & ~is_absurd)
        bad = [(absurd, np.flatnonzero(is_absurd))]
        bad += [(spiked, finite[s]) for s in spikes(group.time_s[finite], values[finite])]
        for known, indices in bad:
            if len(indices):
                time_s, value = float(group.time_s[indices[0]]), float(values[indices[0]])
                known.append(BadValue(name, run.label, time_s, value, len(indices)))
                values[indices] = np.nan
        return values

    runs = []
    for run in session.runs:
        if run.is_accepted:
            groups = []
            for group in run.groups:
                clean = {name: cleaned(run, group, name) for name in group.values if name in used}
                if any(
                    not np.array_equal(values, group.values[name], equal_nan=True)
                    for name, values in clean.items()
                ):
                    group = replace(group, values={**group.values, **clean})
                groups.append(group)
            run = replace(run, groups=tuple(groups))
        runs.append(run)
    return replace(session, runs=tuple(runs)), tuple(absurd), tuple(spiked)


def spikes(time_s: Real, values: Real) -> list[slice]:
    """Return the samples of each spike of a channel, none if there are too many to be errors.

    `time_s`, `values`: its times and values, (n,) float64, finite.
    """
    n = len(values)
    change = np.abs(np.diff(values))
    if n < 2 * _NEAR_SAMPLES or not change.any():
        return []
    # At least twelve times the usual change, which is about the noise: a lower spike hardly matters
    # in a fit; and six steps of the converter: one at rest changes by one or two.
    least = max(12.0 * float(np.median(change)), 6.0 * float(change[change > 0.0].min()))
    # Beyond its ends a record goes on as in most samples there.
    ends = 2 * _MOST_SAMPLES + 1
    padded = np.concatenate([[np.median(values[:ends])], values, [np.median(values[-ends:])]])
    steps = np.flatnonzero(np.abs(np.diff(padded[:-1])) > least)  # where a spike may begin
    if not len(steps):
        return []
    period_s = float(np.median(np.diff(time_s)))
    bad = np.zeros(n, bool)
    found_spikes = []
    for length in range(_MOST_SAMPLES, 0, -1):
        begins = steps[steps + length <= n]
        # At each place where one may begin: its samples, and both sides (`padded` is one ahead).
        inside = values[begins[:, None] + np.arange(length)]
        sides = padded[begins[:, None] + [0, length + 1]]
        above = inside.min(axis=1) - sides.max(axis=1)
        height = np.maximum(above, sides.min(axis=1) - inside.max(axis=1))
        high = height > least
        for i, its_height in zip(begins[high].tolist(), height[high], strict=True):
            spike = slice(i, i + length)
            before, after = max(i - 1, 0), min(i + length, n - 1)
            # Where samples are missing beside it, the motion went on meanwhile.
            has_gap = time_s[after] - time_s[before] > 1.5 * (after - before) * period_s
            if has_gap or bad[spike].any():
                continue
            # Peaks of motion that is sampled at 20 Hz or more do not reach six times the curvature,
            # neither those of wheels that strike the bump; four times it, some do.
            if its_height > 6.0 * _curvature(time_s, values, spike):
                bad[spike] = True
                found_spikes.append(spike)
    # More than 1 % of the samples belong to the signal.
    return found_spikes if np.count_nonzero(bad) <= max(_MOST_SAMPLES, 0.01 * n) else []


def _curvature(time_s: Real, values: Real, spike: slice) -> float:
    """Return the larger curvature of the two sides, over the length of the spike."""
    shift = spike.stop - spike.start + 1
    sides_s = time_s[[spike.start, spike.stop - 1]] + [-_NEAR_S, _NEAR_S]
    begin, end = np.searchsorted(time_s, sides_s).tolist()
    sides = (
        values[max(min(begin, spike.start - _NEAR_SAMPLES), 0) : spike.start],
        values[spike.stop : max(end, spike.stop + _NEAR_SAMPLES)],
    )
    # From the mean of the two samples that lie as far before and after as those beside the spike.
    bends = [
        np.abs(side[shift:-shift] - (side[: -2 * shift] + side[2 * shift :]) / 2.0)
        for side in sides
    ]
    # One in ten samples of a side may belong to other spikes.
    return max(
        (float(np.sort(bend)[-1 - len(bend) // 10]) for bend in bends if len(bend)), default=0.0
    )
