"""Finds clocks that jump in most runs: the motion before the gap fits, that after it does not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from daq.silence import longest_gap_s

from ..decays.decay import FreeDecay, Record
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.likelihood import HOLD
from .format import listed
from .refit import Explanation, as_described, refit, shift_between

_LEAST_S = 0.1
"""Least length of the samples of a group before its gap, s; fewer are left out of the trial."""


def clock_jump(estimation: Estimation) -> Explanation | None:
    """Return the clocks that jump, None if there are none.

    A gap alone is harmless: the model knows when each sample was taken.  But where a clock jumped,
    the samples after it have wrong times, and no model explains both sides, or this group and the
    others.  Without a gap in most of the runs nothing is fitted.  Runs with gaps of more than
    `daq.silence.STALE_S` are left out before.

    `estimation`: a fit that does not hold.
    """
    gaps = [_gaps(record) for record in estimation.records]
    if 2 * sum(map(bool, gaps)) <= len(gaps):
        return None
    pairs = zip(estimation.decays, gaps, strict=True)
    cut = tuple(d for d in (_before(decay, own) for decay, own in pairs) if d.recordings)
    if not cut:
        return None
    start = estimation.box.unknowns(generic_vehicles()[0])
    trial = replace(estimation, decays=cut)
    alone = refit(trial, as_described, start, hold=HOLD)
    if alone.excess > estimation.chi2_limit - 1.0:
        return None
    before = refit(estimation, as_described, estimation.fit.eta)
    names = dict.fromkeys(name for own in gaps for name in own)
    everywhere = len(names) == len(estimation.box.groups)
    length_s = float(np.median([gap for own in gaps for _, gap in own.values()]))
    return Explanation(
        "clocks that jump",
        f"{'all sensors' if everywhere else listed(names)} by about {length_s:.2g} s in "
        f"{sum(map(bool, gaps))} of {len(gaps)} runs; up to there the decays fit",
        "correct the times of the samples after the gap, or record again",
        1.0,
        *shift_between(before, alone),
    )


def _gaps(record: Record) -> dict[str, tuple[float, float]]:
    """Return the largest gap of each group: time in the run before it, and length, s."""
    found = {}
    for r in record.recordings:
        steps = np.diff(r.time_s)
        if len(steps) < 2:
            continue
        worst, period_s = int(np.argmax(steps)), float(np.median(steps))
        if steps[worst] > longest_gap_s(period_s):
            found[r.group.name] = float(r.time_s[worst]), float(steps[worst]) - period_s
    return found


def _before(decay: FreeDecay, gaps: Mapping[str, tuple[float, float]]) -> FreeDecay:
    """Return a decay without the samples that come after the gap in their own group."""
    kept = []
    for r in decay.recordings:
        begin_s, _ = gaps.get(r.group.name, (np.inf, 0.0))
        left_s = begin_s - decay.start_s
        if left_s >= _LEAST_S:
            kept.append(r.between(0.0, left_s) if np.isfinite(left_s) else r)
    return replace(decay, recordings=tuple(kept))
