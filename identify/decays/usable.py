"""Leaves out runs that cannot be used: the bench rejects them, an import does not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import LARGEST, Channel, Quantity
from daq.runs import Run, RunStatus, Silence, longest_silence
from daq.samples.converter import FROZEN_S, Hold, longest_hold
from daq.sessions import Session

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
    kind: str
    """`channel`, `run`, `kind`: name, label, and the label without the number of the repeat."""
    longest: Hold


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
    """Find what can be used of a session.

    Values that no motion shows are missing (`without_bad_values`).

    A channel with one value in all runs is unused: the fit would take a dead sensor for a part that
    stands still.

    A run is left out if a channel that shows a part of it is silent for longer than the bench
    allows (`daq.runs`), or holds its value while the vehicle moves: its plug is loose, and what
    it sent before is not sure.  A channel with this fault in most of its runs was recorded so, and
    these runs are used as they are.  Also left out are runs in which times go back, all sensors are
    silent together (the clock jumped), nothing moves, or the free decay is missing.
    """
    session, absurd, spikes = without_bad_values(session)
    session = replace(session, channels=_without_constant(session))
    used = {c.name for c in session.used_channels}
    silences = [_silences(run, used) if run.is_accepted else {} for run in session.runs]
    records = [
        record_of(run, session.channels) if run.is_accepted else None for run in session.runs
    ]
    holds: dict[str, list[ChannelHold]] = {}
    for hold in frozen([record for record in records if record and record.recordings]):
        holds.setdefault(hold.run, []).append(hold)
    shown = [name for of_run in silences for name in of_run]
    often_silent = _silent_in_most(silences)
    often_frozen = _faulty_in_most([one.channel for each in holds.values() for one in each], shown)

    def judged(run: Run, of_run: _Silences, record: Record | None) -> Run:
        """Return the run, rejected for the first kind of fault that it has."""
        if record is None:  # not accepted before
            return run
        reasons = (
            tuple(_back(run, used))
            or tuple(_silent(of_run, often_silent))
            or tuple(_frozen(holds.get(run.label, ()), often_frozen))
            or tuple(_without_decay(record))
        )
        rejected = replace(run, status=RunStatus.REJECTED, reasons=(*run.reasons, *reasons))
        return rejected if reasons else run

    runs = tuple(map(judged, session.runs, silences, records))
    accepted = [
        (record, of_run)
        for run, of_run, record in zip(runs, silences, records, strict=True)
        if record is not None and run.is_accepted
    ]
    return Usable(
        replace(session, runs=runs),
        tuple(record for record, _ in accepted if record.recordings),
        _silent_in_most([of_run for _, of_run in accepted]),
        absurd,
        spikes,
    )


def _without_constant(session: Session) -> tuple[Channel, ...]:
    """Return the channels; those that have one value in all accepted runs are unused.

    A channel without values stays as it is.
    """
    changes: dict[str, bool] = {}
    for group in (g for run in session.accepted for g in run.groups):
        for name, values in group.values.items():
            finite = values[np.isfinite(values)]
            if len(finite):
                changes[name] = changes.get(name, False) or bool((finite != finite[0]).any())
    return tuple(
        c if changes.get(c.name, True) else replace(c, quantity=Quantity.UNUSED, corner=None)
        for c in session.channels
    )


def _silent_in_most(silences: Sequence[_Silences]) -> tuple[str, ...]:
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
        name: group.time_s[np.isfinite(values) & np.isfinite(group.time_s)]
        for group in run.groups
        for name, values in group.values.items()
        if name in used
    }
    # Most channels of a group share their times: equal times have one key and are looked at once.
    key_of = {name: time_s.tobytes() for name, time_s in times_s.items() if len(time_s)}
    if not key_of:
        return {}
    by_key = {key: times_s[name] for name, key in key_of.items()}
    together_s = np.sort(np.concatenate(list(by_key.values())), kind="stable")
    key_of[_ALL] = b""
    by_key[b""] = together_s[np.diff(together_s, prepend=-np.inf) > 0.0]
    begin_s, end_s = float(together_s[0]), float(together_s[-1])
    longest = {key: longest_silence(time_s, begin_s, end_s) for key, time_s in by_key.items()}
    return {name: longest[key] for name, key in key_of.items()}


def _back(run: Run, used: set[str]) -> Iterator[str]:
    """Yield a line for each clock of used channels that goes back."""
    for group in run.groups:
        back = np.flatnonzero(np.diff(group.time_s) < 0.0)
        if used & group.values.keys() and len(back):
            yield f"the times of {group.name} go back after {group.time_s[back[0]]:.2f} s"


def _silent(silences: _Silences, usual: Sequence[str]) -> Iterator[str]:
    """Yield a line for each span of time in which channels were silent together.

    `usual`: channels that are silent in most runs.  A silence of all sensors hides those of single
    ones.
    """
    by_span: dict[str, list[str]] = {}
    for name, silence in silences.items():
        if silence.is_stale and name not in usual:
            begin_s = max(silence.begin_s, 0.0)  # the first sample may come before 0
            span = f"from {begin_s:.2f} to {silence.end_s:.2f} s (limit {silence.limit_s:.2f} s)"
            by_span.setdefault(span, []).append(name)
    if silences and silences[_ALL].is_stale:
        by_span = {span: ["all sensors"] for span, names in by_span.items() if _ALL in names}
    for span, names in by_span.items():
        yield f"{', '.join(names)} sent nothing {span}"


def _frozen(holds: Sequence[ChannelHold], usual: Sequence[str]) -> Iterator[str]:
    """Yield a line for each length of time for which channels held one value.

    `usual`: channels that do so in most runs.
    """
    by_length: dict[str, list[str]] = {}
    for hold in holds:
        if hold.channel not in usual:
            by_length.setdefault(f"{hold.longest.length_s:.2f} s", []).append(hold.channel)
    for length, names in by_length.items():
        yield f"{', '.join(names)} held one value for {length} (limit {FROZEN_S:.2f} s)"


def _without_decay(record: Record) -> Iterator[str]:
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
    holds = []
    for record, (rest_s, start_s) in zip(records, _starts_s(records), strict=True):
        kind = record.label.rpartition("_")[0]
        for recording in record.recordings:
            for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
                longest = longest_hold(recording.time_s, column, rest_s, start_s)
                holds.append(ChannelHold(channel.name, record.label, kind, longest))
    long_ones = [one for one in holds if one.longest.length_s >= FROZEN_S]
    counted = [one for one in long_ones if _is_frozen(one, holds)]
    return tuple(sorted(counted, key=lambda one: -one.longest.length_s))


def _is_frozen(one: ChannelHold, holds: Sequence[ChannelHold]) -> bool:
    """Return whether a hold is a fault, by how often the channel usually changes.

    `holds`: those of all runs.  Where the channel has one value in the whole run, or too few
    samples at rest, the rate of change is the mean of that in the repeats of the run.
    """
    rate = one.longest.rest_rate
    if one.longest.constant or np.isnan(rate):
        repeats = [
            other.longest.decay_rate
            for other in holds
            if other.kind == one.kind and other.channel == one.channel and other.run != one.run
        ]
        rate = float(np.mean(repeats)) if repeats else np.nan
    return one.longest.is_frozen(rate)


def _starts_s(records: Sequence[Record]) -> list[tuple[float, float]]:
    """Return the end of the rest and the start of the decay of each record, s.

    Where a stuck channel hides the onset, the rest ends with the decay's start, which is the median
    of the other runs.
    """
    spans = [
        None if onset is None else (onset, decay_start_s(record))
        for record in records
        for onset in [onset_s(record)]
    ]
    known_s = [start_s for span in spans if span is not None for _, start_s in [span]]
    usual_s = float(np.median(known_s)) if known_s else -np.inf
    hidden_s = [max(usual_s, record.start_s) for record in records]
    return [span or (start_s, start_s) for span, start_s in zip(spans, hidden_s, strict=True)]


# Takes values that no motion shows out of a session: absurd ones, and spikes ----------------------

_Array = NDArray[np.float64]
_SMALLEST = 1e-100
"""Smallest magnitude that is not taken as zero: the squares of smaller ones vanish."""
_ROUNDING = 1e-12
"""Magnitude, SI, below which a channel shows only a simulation's rounding: it is taken as zero."""
_LONGEST = 3
"""Most samples of a spike."""
_STEEP = 12.0
"""Least height in units of the usual change from one sample to the next, which is about the noise:
a lower spike hardly matters in a fit."""
_STEPS = 6.0
"""Least height in steps of the converter: one at rest changes by one or two."""
_CURVED = 6.0
"""Least height in units of the curvature on either side.  Peaks of motion that is sampled at 20 Hz
or more do not reach it, neither those of wheels that strike the bump; of 4, some do."""
_NEAR_S = 0.05
_NEAR_SAMPLES = 12
"""Length of a side: the longer of the two."""
_OTHERS = 10
"""One in so many samples of a side may belong to other spikes."""
_MOST = 0.01
"""Share of the samples above which spikes belong to the signal."""
_GAP = 1.5
"""Ratio of the time between the neighbours of a spike to the usual one above which samples are
missing there: then the motion went on meanwhile."""


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
    count: int = 1
    """Number of these values."""


def without_bad_values(
    session: Session,
) -> tuple[Session, tuple[BadValue, ...], tuple[BadValue, ...]]:
    """Return a session whose accepted runs miss (NaN) bad values, the absurd ones, and the spikes.

    Absurd are those above `LARGEST`, infinite ones too.  Values below `_SMALLEST` become 0, and all
    of a channel that never exceeds `_ROUNDING`.
    """
    used = {c.name for c in session.used_channels}
    absurd: list[BadValue] = []
    spiked: list[BadValue] = []

    def cleaned(run: Run, name: str, time_s: _Array, values: _Array) -> _Array:
        """Return the values of one channel; the same array if none of them is bad or tiny."""
        too_large = np.abs(values) > LARGEST  # false for NaN
        moves = bool(np.fmax.reduce(np.abs(values), initial=0.0) > _ROUNDING)
        tiny = (np.abs(values) < (_SMALLEST if moves else _ROUNDING)) & (values != 0.0)
        if too_large.any():
            first = int(np.argmax(too_large))
            count = int(np.count_nonzero(too_large))
            one = BadValue(name, run.label, float(time_s[first]), float(values[first]), count)
            absurd.append(one)
        if too_large.any() or tiny.any():
            values = np.where(too_large, np.nan, np.where(tiny, 0.0, values))
        finite = np.flatnonzero(np.isfinite(values))
        for spike in spikes(time_s[finite], values[finite]):
            first = int(finite[spike][0])
            spiked.append(BadValue(name, run.label, float(time_s[first]), float(values[first])))
            values = values.copy()
            values[finite[spike]] = np.nan
        return values

    runs = []
    for run in session.runs:
        if not run.is_accepted:
            runs.append(run)
            continue
        groups = []
        for group in run.groups:
            values = {
                name: cleaned(run, name, group.time_s, column) if name in used else column
                for name, column in group.values.items()
            }
            unchanged = all(values[name] is column for name, column in group.values.items())
            groups.append(group if unchanged else replace(group, values=values))
        unchanged = all(new is old for new, old in zip(groups, run.groups, strict=True))
        runs.append(run if unchanged else replace(run, groups=tuple(groups)))
    return replace(session, runs=tuple(runs)), tuple(absurd), tuple(spiked)


def spikes(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> list[slice]:
    """Return the samples of each spike, none if there are too many to be errors.

    `time_s`, `values`: times and values of one channel, (n,) float64, finite.
    """
    if len(values) < 2 * _NEAR_SAMPLES:
        return []
    change = np.abs(np.diff(values))
    usual_change = float(np.partition(change, len(change) // 2)[len(change) // 2])  # the median
    least = _STEEP * usual_change
    first = np.flatnonzero(change > least) + 1  # samples at which a spike may begin
    if not len(first):
        return []
    converter_step = float(change[change > 0.0].min())
    least = max(least, _STEPS * converter_step)
    if change[0] > least:
        first = np.concatenate([[0], first])
    # Beyond its ends a record goes on as it went.
    ends = [3.0 * values[i] - 2.0 * values[j] for i, j in ((1, 2), (-2, -3))]
    padded = np.concatenate([ends[:1], values, ends[1:]])
    found: list[slice] = []
    for samples in range(_LONGEST, 0, -1):
        begin = first[first + samples <= len(values)]
        inside = values[begin[:, None] + np.arange(samples)]
        sides = padded[begin[:, None] + [0, samples + 1]]
        above = inside.min(axis=1) - sides.max(axis=1)
        height = np.maximum(above, sides.min(axis=1) - inside.max(axis=1))
        for b, h in zip(begin[height > least].tolist(), height[height > least], strict=True):
            one = slice(b, b + samples)
            if any(one.start < other.stop and other.start < one.stop for other in found):
                continue
            if _is_whole(time_s, one) and h > _CURVED * _curvature(time_s, values, one):
                found.append(one)
    # A spike beside an end misleads about how the record went on there.
    starts, stops = {one.start for one in found}, {one.stop for one in found}
    found = [
        one
        for one in found
        if not (one.start == 0 and one.stop in starts)
        and not (one.stop == len(values) and one.start in stops)
    ]
    most = max(_LONGEST, _MOST * len(values))
    return found if sum(one.stop - one.start for one in found) <= most else []


def _curvature(time_s: NDArray[np.float64], values: NDArray[np.float64], spike: slice) -> float:
    """Return the larger curvature of the two sides, over the length of the spike."""
    width = spike.stop - spike.start + 1
    begin, end = np.searchsorted(
        time_s, time_s[[spike.start, spike.stop - 1]] + [-_NEAR_S, _NEAR_S]
    )
    sides = (
        values[max(min(int(begin), spike.start - _NEAR_SAMPLES), 0) : spike.start],
        values[spike.stop : max(int(end), spike.stop + _NEAR_SAMPLES)],
    )
    curved = [0.0]
    for side in sides:
        bend = np.abs(side[width:-width] - (side[: -2 * width] + side[2 * width :]) / 2.0)
        if len(bend):
            curved.append(float(np.sort(bend)[-1 - len(bend) // _OTHERS]))
    return max(curved)


def _is_whole(time_s: NDArray[np.float64], spike: slice) -> bool:
    """Return True if no samples are missing between a spike and its neighbours."""
    before, after = max(spike.start - 1, 0), min(spike.stop, len(time_s) - 1)
    period_s = np.median(np.diff(time_s))
    return bool(time_s[after] - time_s[before] <= _GAP * (after - before) * period_s)
