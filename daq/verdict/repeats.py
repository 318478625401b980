"""Compares a run with the accepted runs of its kind."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding
from dbc.frames import read_only
from dbc.words import counted

from ..channels import Quantity
from .window import RunMeasure, Trace, kind_of
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
"""Begin, step and end of the times since the bump at which the slow motion is taken, and the time
over which each value is averaged, s."""


def waves(signals: tuple[Trace, ...]) -> dict[str, NDArray[np.float64]]:
    """Return the slow motion after the bump, averaged against the jitter of the trigger."""
    grid = np.arange(_START_S, _LENGTH_S, _STEP_S)
    means = {}
    for trace in signals:
        if trace.channel.quantity is not Quantity.HUB_ACCELERATION:
            area = _area(trace, grid + _BIN_S / 2) - _area(trace, grid - _BIN_S / 2)
            means[trace.name] = read_only(area / _BIN_S)
    return means


def _area(trace: Trace, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the integral, up to given times, of the straight lines between the samples."""
    time_s, value = trace.time_s, trace.value
    steps = np.diff(time_s) * (value[1:] + value[:-1]) / 2.0
    before = np.searchsorted(time_s, t_s) - 1  # a trace begins before the bump
    mean = (value[before] + np.interp(t_s, time_s, value)) / 2.0
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(total[before] + (t_s - time_s[before]) * mean)


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

    def repeats(other: RunMeasure) -> bool:
        return all(each.passed for each in _compared(signals, measured, [other]))

    findings = list(_compared(signals, measured, accepted))
    if unlike and not all(each.passed for each in findings):
        same = [repeats(other) for other in accepted]
        like = sum(same) + sum(map(repeats, unlike))
        others = len(same) - sum(same)
        if like >= others:
            runs = counted(len(accepted) + len(unlike), "run")
            text = f"like {like} of {runs}, but not the accepted ones"
            findings = [finding("not_repeatable", True, like, others, "", text)]
    yield from findings


def _compared(
    signals: tuple[Trace, ...], measured: RunMeasure, accepted: Sequence[RunMeasure]
) -> Iterator[Finding]:
    """Compare the channels that move most in this run or in the others."""
    known = set.intersection(*(set(measure.peaks) for measure in accepted))
    signals = tuple(trace for trace in signals if trace.name in known)
    usual = {t.name: float(np.median([m.peaks[t.name] for m in accepted])) for t in signals}
    size = {t.name: max(t.peak, usual[t.name]) for t in signals}
    kinds = {t.name: kind_of(t.channel) for t in signals}
    largest = {k: max(size[n] for n in size if kinds[n] == k) for k in set(kinds.values())}
    main = [n for n in size if size[n] > MAIN * largest[kinds[n]]]
    ratio, name = 1.0, ""  # the peak that differs most
    like, course_name = 1.0, ""  # the course that is least alike
    for channel in main:
        peak_ratio = max(measured.peaks[channel], 1e-12) / max(usual[channel], 1e-12)
        # Half and twice the size are equally far from equal.
        if abs(math.log(peak_ratio)) > abs(math.log(ratio)):
            ratio, name = peak_ratio, channel
        if all(channel in measure.waves for measure in (measured, *accepted)):
            median_wave = np.median([measure.waves[channel] for measure in accepted], axis=0)
            correlation = _correlation(measured.waves[channel], median_wave)
            if correlation < like:
                like, course_name = correlation, channel
    text = (
        f"peak of {name or 'every channel'} is {ratio:.2f} times that of the accepted runs "
        f"({1.0 / PEAK_RATIO:.2f} to {PEAK_RATIO:.2f} is allowed)"
    )
    limit = PEAK_RATIO if ratio > 1.0 else 1.0 / PEAK_RATIO
    passed = 1.0 / PEAK_RATIO <= ratio <= PEAK_RATIO
    yield finding("not_repeatable", passed, ratio, limit, "", text, name)
    if course_name:
        text = f"course of {course_name} is {like:.0%} like the accepted runs"
        text += f" (at least {LIKENESS:.0%})"
        passed = like >= LIKENESS
        yield finding("not_repeatable", passed, like, LIKENESS, "", text, course_name)


def _correlation(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the cosine between two courses, -1..1; 0 if one of them is at rest."""
    product = float(np.linalg.norm(other) * np.linalg.norm(one))
    return float(other @ one) / product if product > 0.0 else 0.0
