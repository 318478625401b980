"""Compares a run with the accepted runs of its kind."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding
from dbc.frames import read_only
from dbc.words import counted

from ..channels import Quantity
from .window import RunMeasure, Trace, kin
from .words import finding

PEAK_RATIO = 1.4
"""Largest ratio of a peak to the median of the accepted runs, in either direction: above it the
bump had another speed or height."""
LIKENESS = 0.85
"""Least correlation of the slow motion with the median: below it, the motion is another one."""
MAIN = 0.3
"""Share of the largest peak of its kind that a channel must exceed to count, because small motions
differ much."""
_START_S, _STEP_S, _LENGTH_S, _BIN_S = 0.1, 0.02, 1.5, 0.06
_SWING_S = 0.05, 0.55
"""Times since the bump between which a sensor's roughness is measured, s."""


def waves(signals: tuple[Trace, ...]) -> Mapping[str, NDArray[np.float64]]:
    """Return the slow motion after the bump, averaged against the jitter of the trigger."""
    grid = np.arange(_START_S, _LENGTH_S, _STEP_S)
    result = {}
    for trace in signals:
        if trace.channel.quantity is not Quantity.HUB_ACCELERATION:
            area = _area(trace, grid + _BIN_S / 2) - _area(trace, grid - _BIN_S / 2)
            result[trace.channel.name] = read_only(area / _BIN_S)
    return MappingProxyType(result)


def _area(trace: Trace, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the integral, up to given times, of the straight lines between the samples."""
    time_s, value = trace.time_s, trace.value
    steps = np.diff(time_s) * (value[1:] + value[:-1]) / 2.0
    before = np.searchsorted(time_s, t_s) - 1  # a trace begins before the bump
    rest_s = t_s - time_s[before]
    mean = (value[before] + np.interp(t_s, time_s, value)) / 2.0
    return np.asarray(np.concatenate([[0.0], np.cumsum(steps)])[before] + rest_s * mean)


def after(measure: RunMeasure, start_s: float) -> RunMeasure:
    """Return a measure with waves that begin at a given time since the bump."""
    first = max(0, math.ceil((start_s - _START_S) / _STEP_S))
    return replace(measure, waves={name: wave[first:] for name, wave in measure.waves.items()})


def levels(signals: tuple[Trace, ...]) -> Mapping[str, float]:
    """Return the level of each suspension travel before the bump, m."""
    travels = (t for t in signals if t.channel.quantity is Quantity.SUSPENSION_TRAVEL)
    return MappingProxyType({trace.channel.name: trace.level for trace in travels})


def roughness(signals: tuple[Trace, ...]) -> Mapping[str, float]:
    """Return the RMS of the part that no swing of a wheel explains, by channel."""
    result = {}
    for trace in signals:
        bend = np.diff(trace.part(*_SWING_S), 4)
        if len(bend):
            result[trace.channel.name] = float(np.sqrt(np.mean(bend**2) / 70.0))
    return MappingProxyType(result)


def not_repeatable(
    signals: tuple[Trace, ...],
    measured: RunMeasure,
    accepted: Sequence[RunMeasure],
    unlike: Sequence[RunMeasure] = (),
) -> Iterator[Finding]:
    """Compare peaks and course with the median of the accepted runs; not for the first run.

    `unlike`: measures of the runs rejected only because they do not repeat the accepted ones.  A
    run is repeatable if it is like at least as many of all these runs as it is unlike accepted
    ones.  Otherwise, a first run with a hand on the car would cause the rejection of all good runs
    after it.
    """
    if not accepted:
        return
    found = _compared(signals, measured, accepted)
    if unlike and not all(finding.passed for finding in found):
        same = [_repeats(signals, measured, other) for other in accepted]
        like = sum(same) + sum(_repeats(signals, measured, other) for other in unlike)
        if like >= len(same) - sum(same):
            runs = counted(len(accepted) + len(unlike), "run")
            text = f"like {like} of {runs}, but not the accepted ones"
            found = [finding("not_repeatable", True, like, len(same) - sum(same), "", text)]
    yield from found


def _repeats(signals: tuple[Trace, ...], measured: RunMeasure, other: RunMeasure) -> bool:
    return all(finding.passed for finding in _compared(signals, measured, [other]))


def _compared(
    signals: tuple[Trace, ...], measured: RunMeasure, accepted: Sequence[RunMeasure]
) -> list[Finding]:
    by_course = _by_course(signals, measured, accepted)
    return [_by_peak(signals, measured, accepted), *([by_course] if by_course else [])]


def _main(signals: tuple[Trace, ...], accepted: Sequence[RunMeasure]) -> list[str]:
    """Return the channels that move most in this run or in the others."""
    known = set.intersection(*(set(measure.peaks) for measure in accepted))
    signals = tuple(trace for trace in signals if trace.channel.name in known)

    def size(trace: Trace) -> float:
        before = np.median([measure.peaks[trace.channel.name] for measure in accepted])
        return max(trace.peak, float(before))

    return [
        t.channel.name for t in signals if size(t) > MAIN * max(size(o) for o in kin(t, signals))
    ]


def _by_peak(
    signals: tuple[Trace, ...], measured: RunMeasure, accepted: Sequence[RunMeasure]
) -> Finding:
    worst, name = 1.0, ""
    for channel in _main(signals, accepted):
        usual = float(np.median([measure.peaks[channel] for measure in accepted]))
        ratio = max(measured.peaks[channel], 1e-12) / max(usual, 1e-12)
        # Half and twice the size are equally far from equal.
        if abs(np.log(ratio)) > abs(np.log(worst)):
            worst, name = ratio, channel
    near = 1.0 / PEAK_RATIO <= worst <= PEAK_RATIO
    limit = PEAK_RATIO if worst > 1.0 else 1.0 / PEAK_RATIO
    text = (
        f"peak of {name or 'every channel'} is {worst:.2f} times that of the accepted runs "
        f"({1.0 / PEAK_RATIO:.2f} to {PEAK_RATIO:.2f} is allowed)"
    )
    return finding("not_repeatable", near, worst, limit, "", text, name)


def _by_course(
    signals: tuple[Trace, ...], measured: RunMeasure, accepted: Sequence[RunMeasure]
) -> Finding | None:
    worst, name = 1.0, ""
    for channel in _main(signals, accepted):
        if channel in measured.waves and all(channel in measure.waves for measure in accepted):
            usual = np.median([measure.waves[channel] for measure in accepted], axis=0)
            size = float(np.linalg.norm(usual) * np.linalg.norm(measured.waves[channel]))
            like = float(usual @ measured.waves[channel]) / size if size > 0.0 else 0.0
            if like < worst:
                worst, name = like, channel
    if not name:
        return None
    text = f"course of {name} is {worst:.0%} like the accepted runs (at least {LIKENESS:.0%})"
    return finding("not_repeatable", worst >= LIKENESS, worst, LIKENESS, "", text, name)
