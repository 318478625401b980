"""Keeps the newest samples as an envelope: lowest and highest value of each channel and time bin.

Terminals draw it.  The bins are a ring of data time; the recorder publishes each complete bin once,
and sends all of them to a client that asks for the history.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bench.config import Bench
from ..control.messages import Lane, LeftOut, Live
from ..runlog.run_log import Code, LoggedRun, LoggedStatus, RunLog, entry
from ..runs import Event, Excitation
from ..samples.mapping import SampleBlock
from ..verdict import RunMeasure, left_out
from .orders import OrderError

BIN_S = 0.02
"""Width of a bin, s."""
KEPT_S = 60.0
"""Length of the ring, s."""
LATE_S = 0.1
"""Time, s, after its end at which a bin counts as complete: buses do not deliver at the same
time."""
MOST_SENT_S = 10.0
"""Longest time, s, that is published at once, after a gap in time."""
_BIN_NS = round(BIN_S * 1e9)
_BINS = round(KEPT_S / BIN_S)


class LiveRing:
    """The last minute of some channels, as an envelope."""

    def __init__(self, channels: Sequence[str]) -> None:
        self._row = {name: row for row, name in enumerate(channels)}
        self._low = np.full((len(channels), _BINS), np.nan)
        self._high = self._low.copy()
        self._end = 0  # bins before this one are or were in the ring
        self._sent = 0  # bins before this one were published
        self._first = 0  # the ring holds nothing before this bin

    def add(self, block: SampleBlock) -> None:
        """Add a block of samples in order of arrival; values that are not finite are left out."""
        pieces = [(self._row[name], *piece) for name, piece in block.items() if len(piece[0])]
        if not pieces:
            return
        last = max(int(t_ns[-1]) for _, t_ns, _ in pieces) // _BIN_NS
        first = min(int(t_ns[0]) for _, t_ns, _ in pieces) // _BIN_NS
        if self._end == 0 or last < self._end - _BINS or last - self._end > _BINS:
            self._begin(first)  # the first data, or after a clock was set
        self._advance(last + 1)
        bins: dict[int, _Bins] = {}  # the channels of a message share their times
        for row, t_ns, value in pieces:
            if id(t_ns) not in bins:
                bins[id(t_ns)] = self._bins(t_ns // _BIN_NS)
            self._put(row, bins[id(t_ns)], value)

    def fresh(self) -> Live | None:
        """Return the complete bins that were not published yet."""
        complete = self._end - math.ceil(LATE_S / BIN_S)
        if complete <= self._sent:
            return None
        first = max(self._sent, complete - round(MOST_SENT_S / BIN_S), self._first)
        self._sent = complete
        return self._live(first, complete)

    def history(self, seconds: float) -> Live:
        """Return the complete bins of the last seconds."""
        complete = max(self._end - math.ceil(LATE_S / BIN_S), self._first)
        return self._live(max(complete - round(seconds / BIN_S), self._first), complete)

    def _begin(self, first: int) -> None:
        self._low[:], self._high[:] = np.nan, np.nan
        self._first = self._sent = self._end = first

    def _advance(self, end: int) -> None:
        if end <= self._end:
            return
        new = np.arange(max(self._end, end - _BINS), end) % _BINS
        self._low[:, new] = np.nan
        self._high[:, new] = np.nan
        self._end = end
        self._first = max(self._first, end - _BINS)

    def _bins(self, bins: NDArray[np.int64]) -> _Bins:
        """Group samples by their bins, at least one."""
        inside = (bins >= self._first) & (bins < self._end)
        starts = np.concatenate(([0], (bins[1:] != bins[:-1]).nonzero()[0] + 1))
        return _Bins(bins, bool(inside.all()), inside, starts, bins[starts] % _BINS)

    def _put(self, row: int, bins: _Bins, value: NDArray[np.float64]) -> None:
        good = np.isfinite(value)
        if not (bins.all_inside and good.all()):
            good &= bins.inside
            if not good.any():
                return
            bins, value = self._bins(bins.number[good]), value[good]
        # A bin may begin in one block and end in the next, or occur twice if time stamps go back.
        np.fmin.at(self._low[row], bins.place, np.minimum.reduceat(value, bins.starts))
        np.fmax.at(self._high[row], bins.place, np.maximum.reduceat(value, bins.starts))

    def _live(self, first: int, stop: int) -> Live:
        columns = np.arange(first, stop) % _BINS
        low, high = self._low[:, columns].tolist(), self._high[:, columns].tolist()
        lanes = (Lane(name, _plain(low[row]), _plain(high[row])) for name, row in self._row.items())
        return Live(first, BIN_S, tuple(lanes))


@dataclass(frozen=True, slots=True)
class _Bins:
    """The n samples of a channel, grouped by their bins."""

    number: NDArray[np.int64]
    """Bin of each sample, shape (n,)."""
    all_inside: bool
    """True if all of these bins are in the ring."""
    inside: NDArray[np.bool_]
    """True where the sample's bin is in the ring, shape (n,)."""
    starts: NDArray[np.intp]
    """First sample of each group of neighbours in one bin."""
    place: NDArray[np.int64]
    """Column of each group in the ring."""


def _plain(values: Sequence[float]) -> tuple[float | None, ...]:
    """Return numbers that JSON can represent, rounded to four digits: a terminal shows fewer."""
    return tuple([None if v != v else float(f"{v:.4g}") for v in values])


# Proposes which accepted runs to leave out, and makes the event of leaving them out ---------------


@dataclass(frozen=True, slots=True)
class ComparedKind:
    """The accepted runs of one kind, and which of them to leave out."""

    accepted: tuple[LoggedRun, ...]
    known: int
    """Number of these runs that are measured: after a restart, measures come later than runs."""
    out: tuple[LeftOut, ...]


Compared = Mapping[tuple[str, Excitation], ComparedKind]
"""The kinds of runs, by mass state and excitation."""


def compared(
    bench: Bench, log: RunLog, measures: Mapping[str, RunMeasure], before: Compared
) -> Compared:
    """Return the runs to leave out, of every kind that has more accepted runs than planned.

    `before`: the last result with this bench, or empty.  It is kept for a kind whose accepted runs
    are the same, because the comparison of hundreds of runs takes a tenth of a second.
    """
    kinds = dict.fromkeys((run.mass_state, run.excitation) for run in log.runs)
    now = {}
    for kind in kinds:
        accepted = tuple(run for run in log.of(*kind) if run.status is LoggedStatus.ACCEPTED)
        known = {run.label: measures[run.label] for run in accepted if run.label in measures}
        last = before.get(kind)
        if last is None or (last.accepted, last.known) != (accepted, len(known)):
            last = ComparedKind(accepted, len(known), _left_out(bench, accepted, known))
        now[kind] = last
    return now


def proposed(found: Compared) -> tuple[LeftOut, ...]:
    """Return the runs to leave out, of all kinds."""
    return tuple(run for kind in found.values() for run in kind.out)


def _left_out(
    bench: Bench, accepted: Sequence[LoggedRun], known: Mapping[str, RunMeasure]
) -> tuple[LeftOut, ...]:
    """Return the runs of one kind to leave out.

    Runs of the other side or axle are compared among themselves.  A run that a person has accepted
    is kept, because a person has decided on it.
    """
    decided = {run.label for run in accepted if run.by}
    found: list[LeftOut] = []
    for wheels in dict.fromkeys(measure.wheels for measure in known.values()):
        alike = {label: m for label, m in known.items() if m.wheels == wheels}
        planned = bench.campaign.repeats - (len(accepted) - len(alike))
        out = left_out(bench.channels, bench.campaign.bump_s, alike, planned)
        found += [LeftOut(label, text) for label, text in out.items() if label not in decided]
    return tuple(found)


def left_out_event(found: tuple[LeftOut, ...], by: str, t_ns: int) -> Event:
    """Return the event that leaves these runs out as one decision.

    Raises OrderError if there is none.
    """
    if not found:
        raise OrderError("there is no proposal to leave runs out")
    reasons = {run.label: f"unlike the others: {run.text}" for run in found}
    return entry(Code.LEAVE_OUT, t_ns, reasons=reasons, by=by)
