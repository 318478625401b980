"""Finds channels that are frozen while the vehicle moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from daq.median import median
from daq.samples.hold import FROZEN_S, Hold, longest_hold

from .decay import Record
from .onset import decay_start_s, onset_s


@dataclass(frozen=True, slots=True)
class ChannelHold:
    """Longest hold of one value by one channel in one run."""

    channel: str
    run: str
    kind: str
    """`channel`, `run`, `kind`: name, label, and the label without the number of the repeat."""
    longest: Hold


def frozen(records: Sequence[Record]) -> tuple[ChannelHold, ...]:
    """Return the values that were held while the vehicle moved, the longest first.

    A channel may be silent by symmetry (roll in a bounce run), and a coarse one may stay at one
    step of its converter.  So a held value counts only where the channel changes often enough at
    rest before the bump, or, if it is constant there too, in a repeat of the run.
    """
    starts = _starts_s(records)
    holds = [one for record, at in zip(records, starts, strict=True) for one in _holds(record, *at)]
    found = [one for one in holds if one.longest.held_s >= FROZEN_S and _is_frozen(one, holds)]
    return tuple(sorted(found, key=lambda one: -one.longest.held_s))


def _is_frozen(one: ChannelHold, holds: Sequence[ChannelHold]) -> bool:
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

    Where a stuck channel hides them, the start is that of the other runs, and ends the rest.
    """
    onsets = [onset_s(record) for record in records]
    starts = [
        decay_start_s(record) if onset is not None else np.nan
        for record, onset in zip(records, onsets, strict=True)
    ]
    known = [start for start in starts if np.isfinite(start)]
    usual = median(known) if known else -np.inf
    return [
        (start, start) if onset is None else (onset, start)
        for record, onset, given in zip(records, onsets, starts, strict=True)
        for start in [given if np.isfinite(given) else max(usual, record.start_s)]
    ]


def _holds(record: Record, rest_s: float, start_s: float) -> Iterator[ChannelHold]:
    kind = record.label.rpartition("_")[0]
    for recording in record.recordings:
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
            hold = longest_hold(recording.time_s, column, rest_s, start_s)
            yield ChannelHold(channel.name, record.label, kind, hold)
