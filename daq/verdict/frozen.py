"""Checks that no channel held one value while the vehicle moved."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

import numpy as np

from dbc.finding import Finding

from ..bench.config import Bench
from ..samples.converter import FROZEN_S, Hold, longest_hold
from .window import ANGULAR, BEFORE_S, RunWindow, Trace, kin
from .words import finding


def frozen(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find channels that held one value: by the rule with which the identification omits a run."""
    holds = {
        trace.channel.name: longest_hold(
            trace.time_s, trace.value, -BEFORE_S, bench.campaign.bump_s
        )
        for trace in signals
    }
    found = []
    for trace in signals:
        hold = holds[trace.channel.name]
        rate = hold.rest_rate
        if hold.constant or np.isnan(rate):
            rate = _usual_rate(trace, signals, holds)
        if hold.is_frozen(rate):
            found.append((hold.held_s, trace.channel.name))
    if not found:
        text = f"no sensor held one value for {FROZEN_S:g} s"
        yield finding("frozen", True, 0.0, FROZEN_S, "s", text)
        return
    held_s, worst = max(found)
    names = ", ".join(name for _, name in found)
    text = f"{names} held one value for {held_s:.2f} s (limit {FROZEN_S:.2f} s)"
    yield finding("frozen", False, held_s, FROZEN_S, "s", text, worst)


def _usual_rate(trace: Trace, signals: tuple[Trace, ...], holds: dict[str, Hold]) -> float:
    """Return the share of samples at which a channel should change, by others of its quantity.

    Each bump moves the suspensions and the body up and down; a rate of roll or pitch may be silent
    by symmetry.  Where all channels of a quantity are constant although others move, each sample
    should change.
    """
    if trace.channel.quantity in ANGULAR:
        return nan
    rates = [holds[other.channel.name].decay_rate for other in kin(trace, signals)]
    still = all(hold.constant for hold in holds.values())
    return max((rate for rate in rates if rate > 0.0), default=nan if still else 1.0)
