"""Finds channels that are frozen while the vehicle moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from daq.median import median
from daq.samples.converter import is_stuck, share_changed

from .decay import Record
from .onset import decay_start_s, onset_s

FROZEN_S = 0.2
"""Time, s, after which a constant channel counts as frozen: two periods of the wheels, too long for
a saturated top."""
_MOVING_S = 0.5  # after this time, a coarse sensor may stay at one step of its converter


@dataclass(frozen=True, slots=True)
class Hold:
    """Longest hold of one value by one channel in one run, and the usual rate of its changes."""

    channel: str
    run: str
    kind: str
    """`channel`, `run`, `kind`: name, label, and the label without the number of the repeat."""
    held_s: float
    """Length of the longest hold that begins in the first half second of the decay, s."""
    held: int
    """Its number of samples."""
    rest_rate: float
    decay_rate: float
    """`rest_rate`, `decay_rate`: share of samples that differ from the one before, before the decay
    and in it; NaN where there are too few samples."""
    constant: bool
    """True if it has one value in the whole run."""


def frozen(records: Sequence[Record]) -> tuple[Hold, ...]:
    """Return the values that were held while the vehicle moved, the longest first.

    A channel may be silent by symmetry (roll in a bounce run), and a coarse one may stay at one
    step of its converter.  So a held value counts only where the channel changes often enough at
    rest before the bump, or, if it is constant there too, in a repeat of the run.
    """
    starts = _starts_s(records)
    holds = [
        h for record, start in zip(records, starts, strict=True) for h in _holds(record, start)
    ]
    moving = {hold.channel for hold in holds if not hold.constant}
    found = [hold for hold in holds if hold.channel in moving and _is_frozen(hold, holds)]
    return tuple(sorted(found, key=lambda hold: -hold.held_s))


def _is_frozen(hold: Hold, holds: Sequence[Hold]) -> bool:
    rate = hold.rest_rate
    if hold.constant or np.isnan(rate):
        repeats = [
            h.decay_rate
            for h in holds
            if h.kind == hold.kind and h.channel == hold.channel and h.run != hold.run
        ]
        rate = float(np.mean(repeats)) if repeats else np.nan
    return hold.held_s >= FROZEN_S and is_stuck(hold.held, rate)


def _starts_s(records: Sequence[Record]) -> list[float]:
    """Return the start of each decay, s; where a stuck channel hides it, that of the other runs."""
    starts = [decay_start_s(r) if onset_s(r) is not None else np.nan for r in records]
    known = [start for start in starts if np.isfinite(start)]
    usual = median(known) if known else -np.inf
    return [
        start if np.isfinite(start) else max(usual, record.start_s)
        for record, start in zip(records, starts, strict=True)
    ]


def _holds(record: Record, start: float) -> Iterator[Hold]:
    kind = record.label.rpartition("_")[0]
    for recording in record.recordings:
        time = recording.time_s
        rest = time < start
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
            change = np.flatnonzero(np.diff(column) != 0.0)
            first = np.concatenate([[0], change + 1])
            last = np.concatenate([change, [len(column) - 1]])
            within = (time[last] > start) & (time[first] < start + _MOVING_S)
            length = np.where(within, time[last] - time[first], 0.0)
            k = int(length.argmax())
            yield Hold(
                channel.name,
                record.label,
                kind,
                float(length[k]),
                int(last[k] - first[k] + 1),
                share_changed(column[rest]),
                share_changed(column[~rest]),
                len(change) == 0,
            )
