"""Channels that look alive and are not: dead in every run, or frozen while the vehicle moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel
from daq.runs import Run

from ..decay import record_of
from ..window import decay_start_s
from .finding import Finding, Verdict
from .places import listed

FROZEN_S = 0.2
"""Two periods of the wheels, and too long for a saturated top."""
_MOVING_S = 0.5  # after this, a coarse sensor may rest on one step of its converter
_LONGER = 4.0  # than the channel holds a value elsewhere
_FEWEST = 20  # samples that show how a channel holds its values


@dataclass(frozen=True, slots=True)
class _Hold:
    """How long one channel held one value in one run.

    Parameters
    ----------
    channel, run, kind : str
        Name, label, and the label without the number of the repeat.
    decay_s : float
        The longest hold that begins in the first half second of the decay, s.
    rest_s : float
        The longest hold before the decay, s; infinite where there is nothing to compare with.
    constant : bool
        Whether it has one value in the whole run.
    """

    channel: str
    run: str
    kind: str
    decay_s: float
    rest_s: float
    constant: bool


def stuck_findings(runs: Sequence[Run], channels: tuple[Channel, ...]) -> tuple[Finding, ...]:
    """Find channels that do not move.

    A channel may be silent by symmetry (roll in a bounce run), and a coarse one may rest on one
    step of its converter.  So a value held is held against it only where the same channel holds
    values for shorter times at rest, or in a repeat of the run.

    Parameters
    ----------
    runs : sequence of Run
        The accepted ones.
    channels : tuple of Channel
        The session's.
    """
    holds = [hold for run in runs for hold in _holds(run, channels)]
    moving = {hold.channel for hold in holds if not hold.constant}
    dead = dict.fromkeys(hold.channel for hold in holds if hold.channel not in moving)
    findings = []
    if dead:
        findings.append(
            Finding(
                "dead_channels",
                Verdict.DOUBTFUL,
                f"never moves in any run: {listed(dead)}; the fit takes a dead sensor for a part "
                "that stands still: mend it or map it as unused",
            )
        )
    frozen = [h for h in holds if h.channel in moving and _is_frozen(h, holds)]
    if frozen:
        frozen.sort(key=lambda hold: -hold.decay_s)
        places = listed(f"{h.channel} in {h.run}" for h in frozen)
        findings.append(
            Finding(
                "stuck_channels",
                Verdict.DOUBTFUL,
                f"holds one value for {frozen[0].decay_s:.2f} s (limit {FROZEN_S:g}) while the "
                f"vehicle moves: {places}; these samples are not measured and bias the result: "
                "check the sensor and repeat the run",
            )
        )
    return tuple(findings)


def _is_frozen(hold: _Hold, holds: Sequence[_Hold]) -> bool:
    repeats = [
        h.decay_s
        for h in holds
        if h.kind == hold.kind and h.channel == hold.channel and h.run != hold.run
    ]
    usual = min(hold.rest_s, *repeats, np.inf)
    return hold.decay_s >= FROZEN_S and hold.decay_s > _LONGER * usual


def _holds(run: Run, channels: tuple[Channel, ...]) -> Iterator[_Hold]:
    record = record_of(run, channels)
    if not record.recordings:
        return
    start = decay_start_s(record)
    kind = run.label.rpartition("_")[0]
    for recording in record.recordings:
        time = recording.time_s
        for channel, column in zip(recording.clock.channels, recording.values.T, strict=True):
            begin, length = _plateaus(time, column)
            within = (begin + length > start) & (begin < start + _MOVING_S)
            before = time < start
            _, at_rest = _plateaus(time[before], column[before])
            yield _Hold(
                channel.name,
                run.label,
                kind,
                float(length[within].max(initial=0.0)),
                float(at_rest.max()) if before.sum() >= _FEWEST else np.inf,
                bool((column == column[0]).all()),
            )


def _plateaus(
    time_s: NDArray[np.float64], column: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return begin and length, s, of each stretch of equal successive values."""
    if not len(time_s):
        return np.zeros(0), np.zeros(0)
    change = np.flatnonzero(np.diff(column) != 0.0)
    first = np.concatenate([[0], change + 1])
    last = np.concatenate([change, [len(column) - 1]])
    return time_s[first], time_s[last] - time_s[first]
