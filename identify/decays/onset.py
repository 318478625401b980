"""Finds the start of the free decay of a record, and the noise of its sensors at rest.

A bump forces the wheels as long as they are on it.  The free decay begins when the last wheel has
left it: 5 ms too early costs 15 % of error, 20 ms too late a fifth of the precision
(docs/method.md, "The start of a decay").  The onset of motion is seen to a millisecond or two; the
stated length of the bump and a guard are added.  Where the length is not known, the misfit of the
fit shows how far back the decay reaches.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from .decay import Record, Recording

GUARD_S = 0.01  # onset detection and the spread of the four wheels over the bump
UNKNOWN_BUMP_S = 0.35  # longer than any bump that is rolled over; shortened afterwards
_REST_S = 0.08  # must be at rest; the paper's records have 0.1 s
_REST_SAMPLES = 3
_MOVING = 4.0
"""Scatter in units of the noise, above which a channel moves."""
_ONSET_SIGMA = 6.0
_ONSET_SHARE = 0.02  # of the channel's peak, where there is no noise to compare with
_QUIET_SAMPLES = 100  # fewer do not give a noise level to 10 %
_QUIET_MARGIN_S = 0.005
_ONSETS: WeakKeyDictionary[Record, float | None] = WeakKeyDictionary()
"""Onset of each record in use; computed once, because every gate asks for it."""
_Quiet = tuple[tuple[Recording, NDArray[np.bool_]], ...]
_QUIET: WeakKeyDictionary[Record, _Quiet] = WeakKeyDictionary()
"""Recordings of each record in use that have samples at rest, and which samples these are."""


def onset_s(record: Record) -> float | None:
    """Return the time at which the motion starts, s; None if the record starts in motion.

    `record`: a run with its time stamps as measured.
    """
    if record not in _ONSETS:
        _ONSETS[record] = _seen_onset_s(record)
    return _ONSETS[record]


def _seen_onset_s(record: Record) -> float | None:
    onsets = []
    # A slow group has too few samples in so short a rest; the others show whether there is one.
    resting = [(r, r.time_s < record.start_s + _REST_S) for r in record.recordings]
    seen = [(r, rest) for r, rest in resting if rest.sum() >= _REST_SAMPLES]
    for recording, rest in seen:
        level = recording.values[rest].mean(axis=0)
        spread = recording.values[rest].std(axis=0)
        noise = difference_noise(recording.values[-max(len(recording.values) // 5, 3) :])
        still = np.maximum(_MOVING * noise, _ONSET_SHARE * recording.values.std(axis=0))
        if (spread > still).any():
            return None
        away = np.abs(recording.values - level)
        limit = np.maximum(
            _ONSET_SIGMA * np.maximum(spread, noise), _ONSET_SHARE * away.max(axis=0)
        )
        above = away > limit
        moved = above[:-1] & above[1:]  # one sample alone is a glitch
        onsets += [float(recording.time_s[np.argmax(m)]) for m in moved.T if m.any()]
    return min(onsets) if onsets else None


def is_still(record: Record) -> bool:
    """Return whether nothing but noise is in a record: no bump, and no motion after one."""
    return onset_s(record) is None and all(
        (r.values.std(axis=0) <= _MOVING * difference_noise(r.values) + rounding).all()
        for r in record.recordings
        if len(r.time_s) > 1
        for rounding in [1e-12 * np.abs(r.values).max(axis=0)]
    )


def decay_start_s(record: Record) -> float:
    """Return the start of the free decay by the stated bump, s; the record may end before it.

    Where no bump is stated, it is at most half-way between the onset and the end.
    """
    onset = onset_s(record)
    if onset is None:
        return record.start_s
    if np.isfinite(record.bump_s):
        return onset + record.bump_s + GUARD_S
    return min(onset + UNKNOWN_BUMP_S + GUARD_S, (onset + record.end_s) / 2)


def quiet_noise(records: Sequence[Record]) -> dict[str, float]:
    """Return each channel's standard deviation at rest before the bump, pooled over the records.

    In SI units; at least that of rounding to the step of a coarse sensor.  Empty if a channel has
    fewer than 100 samples at rest.
    """
    counts = quiet_counts(records)
    names = {c.name for r in records for q in r.recordings for c in q.group.channels}
    if any(counts.get(name, 0) < _QUIET_SAMPLES for name in names):
        return {}
    squares = dict.fromkeys(counts, 0.0)
    for recording, at_rest in (pair for record in records for pair in _quiet(record)):
        quiet = recording.values[at_rest]
        spread = np.sum((quiet - quiet.mean(axis=0)) ** 2, axis=0)
        for channel, total in zip(recording.group.channels, spread.tolist(), strict=True):
            squares[channel.name] += total
    rounding = {name: step / np.sqrt(12.0) for name, step in coarse_steps(records).items()}
    return {
        name: max(float(np.sqrt(squares[name] / n)), rounding.get(name, 0.0))
        for name, n in counts.items()
    }


def rest_levels(record: Record) -> dict[str, float]:
    """Return each channel's mean at rest before the bump, SI; empty without a quiet stretch."""
    return {
        channel.name: float(level)
        for recording, at_rest in _quiet(record)
        for channel, level in zip(
            recording.group.channels, recording.values[at_rest].mean(axis=0), strict=True
        )
    }


def coarse_steps(records: Sequence[Record]) -> dict[str, float]:
    """Return the steps of the channels that show fewer than half a step of noise at rest, SI.

    Their values at rest are few, so that rounding hides the noise.
    """
    at_rest: dict[str, list[NDArray[np.float64]]] = {}
    whole: dict[str, list[NDArray[np.float64]]] = {}
    for record in records:
        for recording, resting in _quiet(record):
            for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
                at_rest.setdefault(channel.name, []).append(column[resting])
                whole.setdefault(channel.name, []).append(column)
    steps = {}
    for name, parts in at_rest.items():
        quiet = np.sort(np.concatenate(parts))
        if 2 * np.count_nonzero(np.diff(quiet)) < len(quiet):
            levels = np.sort(np.concatenate(whole[name]))
            apart = np.diff(levels)
            apart = apart[apart > 1e-9 * np.abs(levels[[0, -1]]).max()]
            if len(apart) and quiet.std() < apart.min() / 2.0:
                steps[name] = float(apart.min())
    return steps


def quiet_counts(records: Sequence[Record]) -> dict[str, int]:
    """Return the degrees of freedom of each level of `quiet_noise`."""
    counts: dict[str, int] = {}
    for recording, at_rest in (pair for record in records for pair in _quiet(record)):
        n = int(np.count_nonzero(at_rest))
        for channel in recording.group.channels:
            counts[channel.name] = counts.get(channel.name, 0) + n - 1
    return counts


def _quiet(record: Record) -> _Quiet:
    if record not in _QUIET:
        onset = onset_s(record)
        end_s = -np.inf if onset is None else onset - _QUIET_MARGIN_S
        pairs = ((recording, recording.time_s < end_s) for recording in record.recordings)
        _QUIET[record] = tuple((r, at_rest) for r, at_rest in pairs if at_rest.sum() >= 3)
    return _QUIET[record]


def difference_noise(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the white noise of each column, by successive differences (von Neumann).

    A smooth signal adds little to it, so it separates the noise of a residual from its misfit.
    """
    return np.asarray(np.sqrt(np.mean(np.diff(values, axis=0) ** 2, axis=0) / 2))
