"""Finds channels that are frozen while the vehicle moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.median import median
from daq.samples.converter import is_stuck, share_changed

from .decay import Record
from .onset import decay_start_s, onset_s

FROZEN_S = 0.2
"""Time, s, after which a constant channel counts as frozen: two periods of the wheels, too long for
a saturated top."""
_MOVING_S = 0.5
"""Time in the decay, s, in which a hold must begin: later a coarse sensor may stay at one step of
its converter."""


@dataclass(frozen=True, slots=True)
class Hold:
    """A value that a channel held in a run while the vehicle moved."""

    channel: str
    run: str
    """`channel`, `run`: name and label."""
    held_s: float
    """Length of the hold, s."""


@dataclass(frozen=True, slots=True)
class _Column:
    """The samples of one channel in one run."""

    channel: str
    run: str
    kind: str
    """`channel`, `run`, `kind`: name, label, and the label without the number of the repeat."""
    start_s: float
    """Start of the decay, s."""
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    """`time_s`, `values`: of each sample, shape (n,)."""

    @property
    def longest_hold(self) -> tuple[float, int]:
        """Length, s, and samples of the longest hold that counts (`_MOVING_S`)."""
        last = np.flatnonzero(np.diff(self.values, append=np.nan) != 0.0)
        first = np.concatenate([[0], last[:-1] + 1])
        begin_s, end_s = self.time_s[first], self.time_s[last]
        within = (end_s > self.start_s) & (begin_s < self.start_s + _MOVING_S)
        length_s = np.where(within, end_s - begin_s, 0.0)
        k = int(length_s.argmax())
        return float(length_s[k]), int(last[k] - first[k] + 1)

    @property
    def is_constant(self) -> bool:
        """True if there is one value in the whole run."""
        return not (self.values != self.values[0]).any()

    @property
    def rest_rate(self) -> float:
        """Share of samples before the decay that differ from the one before; NaN if few."""
        return share_changed(self.values[self.time_s < self.start_s])

    @property
    def decay_rate(self) -> float:
        """The same share in the decay."""
        return share_changed(self.values[self.time_s >= self.start_s])


def frozen(records: Sequence[Record]) -> tuple[Hold, ...]:
    """Return the values that were held while the vehicle moved, the longest first.

    A channel may be silent by symmetry (roll in a bounce run), and a coarse one may stay at one
    step of its converter.  So a held value counts only where the channel changes often enough at
    rest before the bump, or, if it is constant there too, in a repeat of the run.
    """
    columns = [
        _Column(channel.name, record.label, record.label.rpartition("_")[0], start_s, r.time_s, v)
        for record, start_s in zip(records, _starts_s(records), strict=True)
        for r in record.recordings
        for channel, v in zip(r.group.channels, r.values.T, strict=True)
    ]
    found = []
    for column in columns:
        held_s, held = column.longest_hold
        if held_s >= FROZEN_S and is_stuck(held, _rate(column, columns)):
            found.append(Hold(column.channel, column.run, held_s))
    return tuple(sorted(found, key=lambda hold: -hold.held_s))


def _rate(column: _Column, columns: Sequence[_Column]) -> float:
    """Return the share of samples at which a channel changes in a run like this; NaN if unknown."""
    rate = column.rest_rate
    if column.is_constant or np.isnan(rate):
        alike = [c for c in columns if (c.channel, c.kind) == (column.channel, column.kind)]
        repeats = [c.decay_rate for c in alike if c.run != column.run]
        rate = float(np.mean(repeats)) if repeats else np.nan
    return rate


def _starts_s(records: Sequence[Record]) -> list[float]:
    """Return the start of each decay, s; where a stuck channel hides it, that of the other runs."""
    starts = [decay_start_s(r) if onset_s(r) is not None else np.nan for r in records]
    known = [start for start in starts if np.isfinite(start)]
    usual = median(known) if known else -np.inf
    return [
        start if np.isfinite(start) else max(usual, record.start_s)
        for record, start in zip(records, starts, strict=True)
    ]
