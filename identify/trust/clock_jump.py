"""Finds clocks that jump in most runs: the motion before the gap fits, that after it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from daq.median import median
from daq.silence import longest_gap_s
from dbc.words import counted

from ..decays.decay import FreeDecay, Record
from ..fit.estimation import Estimation, later_may_hold
from ..fit.generic_vehicles import generic_vehicles
from ..fit.likelihood import HOLD
from .format import listed
from .refit import Explanation, as_described, refit, shift_between

_LEAST_S = 0.1
"""Least length of the samples of a group before its gap, s; fewer are left out of the trial."""
_Gaps = Mapping[str, tuple[float, float]]
"""Largest gap of each group that has one: time in the run before it, and length, s."""


def clock_jump(estimation: Estimation) -> Explanation | None:
    """Return the clocks that jump, None if there are none.

    A gap alone is harmless: the model knows when each sample was taken.  But where a clock jumped,
    the samples after it have wrong times, and no model explains both sides, or this group and the
    others.  Where all clocks jump soon after the bump, the samples after it fit among themselves;
    if those from a start between the bump and the gap fit, too, the bump was longer.  Without a gap
    in most of the runs nothing is fitted.  Runs with gaps of more than `daq.silence.STALE_S` are
    left out before.

    `estimation`: a fit that does not hold.
    """
    gaps = [_gaps(record) for record in estimation.records]
    if 2 * sum(map(bool, gaps)) <= len(gaps):
        return None
    cut, is_before = _one_side(estimation, gaps)
    if not is_before and later_may_hold(estimation, generic_vehicles()):
        return None
    start = estimation.box.unknowns(generic_vehicles()[0])
    trial = replace(estimation, decays=tuple(decay for decay in cut if decay.recordings))
    alone = refit(trial, as_described, start, hold=HOLD)
    if alone.excess > estimation.chi2_limit - 1.0:
        return None
    before = refit(estimation, as_described, estimation.fit.eta)
    names = dict.fromkeys(name for own in gaps for name in own)
    everywhere = len(names) == len(estimation.box.groups)
    length_s = median([gap for own in gaps for _, gap in own.values()])
    where = "up to" if is_before else "from"
    return Explanation(
        "clocks that jump",
        f"{'all sensors' if everywhere else listed(names)} by about {length_s:.2g} s in "
        f"{sum(map(bool, gaps))} of {counted(len(gaps), 'run')}; {where} there the decays fit",
        "correct the times of the samples after the gap, or record again",
        1.0,
        *shift_between(before, alone),
    )


def without_jump(estimation: Estimation) -> tuple[FreeDecay, ...]:
    """Return the decays of a fit, each on one side of the gaps of its clocks."""
    return _one_side(estimation, [_gaps(record) for record in estimation.records])[0]


def _one_side(estimation: Estimation, gaps: Sequence[_Gaps]) -> tuple[tuple[FreeDecay, ...], bool]:
    """Return the decays before the gaps, and True; those after them if no decay has a before."""
    before = tuple(map(_before, estimation.decays, gaps))
    if any(decay.recordings for decay in before):
        return before, True
    return tuple(map(_after, estimation.records, estimation.decays, gaps)), False


def _gaps(record: Record) -> dict[str, tuple[float, float]]:
    found = {}
    for r in record.recordings:
        steps = np.diff(r.time_s)
        if len(steps) < 2:
            continue
        worst, period_s = int(np.argmax(steps)), median(steps)
        if steps[worst] > longest_gap_s(period_s):
            found[r.group.name] = float(r.time_s[worst]), float(steps[worst]) - period_s
    return found


def _before(decay: FreeDecay, gaps: _Gaps) -> FreeDecay:
    """Return a decay without the samples that come after the gap in their own group."""
    kept = []
    for r in decay.recordings:
        begin_s, _ = gaps.get(r.group.name, (np.inf, 0.0))
        left_s = begin_s - decay.start_s
        if left_s >= _LEAST_S:
            kept.append(r.between(0.0, left_s) if np.isfinite(left_s) else r)
    return replace(decay, recordings=tuple(kept))


def _after(record: Record, decay: FreeDecay, gaps: _Gaps) -> FreeDecay:
    """Return a decay that begins when the last of the gaps has ended."""
    ends_s = [begin_s + length_s for begin_s, length_s in gaps.values()]
    return record.decay(max([decay.start_s, *ends_s]))
