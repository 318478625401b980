"""Compares runs of a kind with each other: one with those accepted, and all of them at the end.

A run that passed its verdict may still be that of a changed car: a foot on the sill, a hand on the
roof, a weight that slipped.  Where more runs are accepted than planned, those that belong together
are kept (`left_out`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from statistics import median

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding
from dbc.frames import read_only
from dbc.words import counted

from ..channels import Channel, Quantity
from .motion import of_quantity
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
_SWING_S = 0.05, 0.55
"""Times since the bump between which a sensor's roughness is measured, s."""


# What is measured of a run ------------------------------------------------------------------------


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


def levels(signals: tuple[Trace, ...]) -> dict[str, float]:
    """Return the level of each suspension travel before the bump, m."""
    return {t.name: t.level for t in of_quantity(signals, Quantity.SUSPENSION_TRAVEL)}


def roughness(signals: tuple[Trace, ...]) -> dict[str, float]:
    """Return the RMS of the part that no swing of a wheel explains, by channel."""
    # Fourth differences leave little of a swing; those of noise have 70 (1 + 16 + 36 + 16 + 1)
    # times its variance.
    bends = {trace.name: np.diff(trace.part(*_SWING_S), 4) for trace in signals}
    return {n: float(np.sqrt(np.mean(bend**2) / 70.0)) for n, bend in bends.items() if len(bend)}


# One run and those accepted before ----------------------------------------------------------------


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


# All runs of a kind, if more were accepted than planned -------------------------------------------
#
# Height and timing of a bump do not matter here: the usual run of the others, scaled and shifted in
# time, is first subtracted from the free decay.

FEWEST = 3
"""Least number of runs of a kind that are kept: of two runs, it is not known which one is odd."""
UNUSUAL = 3.0
"""Ratio of a difference to the usual difference among these runs, from which a run is odd."""
UNLIKE = 1.9
"""Ratio, as `UNUSUAL`, for the course, as RMS over all channels: good runs reach 1.5, without
travels 1.8 (753 measured); with 30 N of friction 1.9, but 2.4 to 2.9 if the bump was a tenth higher
(3 of 60: friction damps it less); a hand on a wing that moves begins at 2.2."""
GUARD_S = 0.08
"""Time after the bump from which the decay is compared, s: half of the averaging time of the
course, plus the time for a bump that takes a tenth longer."""
_SLOW_COSINES = 10
"""Number of cosines over the length of the decay by which courses are compared, from the mean to
3.7 Hz: the body does not move faster, and five sixths of the noise are above."""
_FINEST = 1e-3
"""Roughness, as a share of the peak, below which it is ignored: steps of the sensor's output come
and go."""
_NOTABLE = 0.02
"""Least relative difference of a frequency that is named."""


class _Sort(StrEnum):
    """Kinds of difference of a run from the others."""

    LEVEL = "level"
    """Level of a travel before the bump, relative to the largest peak of its quantity."""
    COURSE = "course"
    """RMS of the remainder of a channel's slow decay after scale and shift, relative to the largest
    RMS."""
    PEAK = "peak"
    """Logarithm of the ratio of peaks, without the effect of the bump's height."""
    ROUGH = "rough"
    """Logarithm of the ratio of roughness."""


_LEAST = {_Sort.LEVEL: 0.03, _Sort.COURSE: 0.004, _Sort.PEAK: 0.1, _Sort.ROUGH: 0.6}
"""Least difference that counts, however similar the others are; for the course, the least usual
difference.  Good runs of cars without friction differ by half of it in level (with friction by
more), and by 0.095 and 0.59 in peak and roughness (74 measured, hubs at 200 Hz)."""


@dataclass(frozen=True, slots=True)
class _Usual:
    """Medians of the measures of some runs, by channel."""

    run: RunMeasure
    """Free decay, peaks, roughness, levels; the frequency is None if a run shows none."""
    largest: Mapping[str, float]
    """Largest peak of the channel's kind."""


def left_out(
    channels: Sequence[Channel], bump_s: float, measures: Mapping[str, RunMeasure], planned: int
) -> dict[str, str]:
    """Return the runs that the most consistent set leaves out, each with its difference in words.

    `bump_s`: duration of the bump, s.  `measures`: measures of the accepted runs of one kind, by
    label.  `planned`: number of runs in the campaign; at least this number and `FEWEST` are kept.
    """
    first = max(0, math.ceil((bump_s + GUARD_S - _START_S) / _STEP_S))
    kept = {
        label: replace(m, waves={name: wave[first:] for name, wave in m.waves.items()})
        for label, m in measures.items()
        if m.peaks
    }
    out = {}
    while len(kept) > max(planned, FEWEST):
        ratios = _compared_all(channels, kept, kept)
        odd = max(kept, key=lambda label: ratios[label][0])
        if ratios[odd][0] <= 1.0:
            break
        out[odd] = kept.pop(odd)
    ratios = _compared_all(channels, kept, out) if out else {}
    return {
        label: ratios[label][1] for label in measures if label in out and ratios[label][0] > 1.0
    }


def _compared_all(
    channels: Sequence[Channel], kept: Mapping[str, RunMeasure], asked: Mapping[str, RunMeasure]
) -> dict[str, tuple[float, str]]:
    """Return the largest difference of each requested run relative to its limit, and its text."""
    usual = _usual(channels, list(kept.values()))
    differences_of_kept = [_differences(usual, run) for run in kept.values()]
    limits = {}
    for sort, name in differences_of_kept[0]:
        size = median(abs(differences[sort, name]) for differences in differences_of_kept)
        limits[sort, name] = max(_LEAST[sort], size if sort is _Sort.COURSE else UNUSUAL * size)
    result = {}
    for label, run in asked.items():
        differences = _differences(usual, run)
        ratios = {key: abs(differences[key]) / limits[key] for key in limits if key in differences}
        largest_ratio, words = 0.0, []
        for sort in _Sort:
            of_sort = {name: ratio for (s, name), ratio in ratios.items() if s is sort}
            if not of_sort:
                continue
            worst = max(of_sort, key=lambda name: of_sort[name])
            ratio = of_sort[worst]
            if sort is _Sort.COURSE:
                ratio = math.sqrt(float(np.mean(np.square(list(of_sort.values()))))) / UNLIKE
            largest_ratio = max(largest_ratio, ratio)
            if ratio > 1.0:
                words.append(_words(usual, sort, worst, differences[sort, worst]))
        words = words[:2]
        if run.frequency_hz is not None and usual.run.frequency_hz is not None:
            shift = run.frequency_hz / usual.run.frequency_hz - 1.0
            words += [f"frequency {shift:+.0%}"] if abs(shift) >= _NOTABLE else []
        result[label] = largest_ratio, ", ".join(words)
    return result


def _usual(channels: Sequence[Channel], runs: Sequence[RunMeasure]) -> _Usual:
    """Return the medians of what all runs have measured."""

    def medians(values: Iterable[Mapping[str, float]]) -> dict[str, float]:
        every = list(values)
        known = set.intersection(*map(set, every))
        return {c.name: median(v[c.name] for v in every) for c in channels if c.name in known}

    common = set.intersection(*(set(run.waves) for run in runs))
    peaks = medians(run.peaks for run in runs)
    kinds = {c.name: kind_of(c) for c in channels if c.name in peaks}
    hertz = [run.frequency_hz for run in runs if run.frequency_hz is not None]
    usual = RunMeasure(
        waves={n: np.median([run.waves[n] for run in runs], axis=0) for n in sorted(common)},
        peaks=peaks,
        roughness=medians(run.roughness for run in runs),
        levels=medians(run.levels for run in runs),
        frequency_hz=median(hertz) if len(hertz) == len(runs) else None,
    )
    largest = {
        name: max(1e-12, *(p for other, p in peaks.items() if kinds[other] == kind))
        for name, kind in kinds.items()
    }
    return _Usual(usual, largest)


def _differences(usual: _Usual, measure: RunMeasure) -> dict[tuple[_Sort, str], float]:
    """Return the differences of a run from the usual one, by sort and channel."""
    run, largest = usual.run, usual.largest
    scale, course = _course(usual, measure)
    differences = {(_Sort.COURSE, name): size for name, size in course.items()}
    for name, peak in largest.items():
        if name in measure.levels and name in run.levels:
            differences[_Sort.LEVEL, name] = (measure.levels[name] - run.levels[name]) / peak
        if name in measure.peaks and run.peaks[name] > MAIN * peak:
            differences[_Sort.PEAK, name] = _log(measure.peaks[name], scale * run.peaks[name])
        if name in measure.roughness and name in run.roughness:
            rough, usually = measure.roughness[name], run.roughness[name]
            finest = _FINEST * peak
            differences[_Sort.ROUGH, name] = _log(rough + finest, usually + finest)
    return differences


def _course(usual: _Usual, measure: RunMeasure) -> tuple[float, dict[str, float]]:
    """Return the ratio of the motion to the usual one, and the remainder after scale and shift."""
    names = [n for n in usual.run.waves if n in measure.waves and n in usual.largest]
    if not names:
        return 1.0, {}
    course = np.array([measure.waves[n] / usual.largest[n] for n in names])
    usual_course = np.array([usual.run.waves[n] / usual.largest[n] for n in names])
    # Its derivative times a small time is its shift.
    basis = np.stack([usual_course.ravel(), np.gradient(usual_course, axis=1).ravel()], axis=1)
    weights, *_ = np.linalg.lstsq(basis, course.ravel())
    slow = _cosines(course.shape[1])
    remainder = (course - (basis @ weights).reshape(course.shape)) @ slow.T @ slow
    largest_power = max(1e-12, np.mean(usual_course**2, axis=1).max())
    size = np.sqrt(np.mean(remainder**2, axis=1) / largest_power)
    return float(weights[0]), dict(zip(names, size.tolist(), strict=True))


@cache
def _cosines(count: int) -> NDArray[np.float64]:
    """Return the slowest orthonormal cosines over some samples, one per row (DCT-II)."""
    numbers = np.arange(min(_SLOW_COSINES, count))
    rows = np.cos(np.pi * np.outer(numbers, np.arange(count) + 0.5) / count)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _log(one: float, other: float) -> float:
    return math.log(max(one, 1e-12) / max(other, 1e-12))


def _words(usual: _Usual, sort: _Sort, name: str, size: float) -> str:
    """Return a difference of a channel (`_differences`) in words."""
    match sort:
        case _Sort.LEVEL:
            side = "higher" if size > 0.0 else "lower"
            return f"{name} {abs(size) * usual.largest[name] * 1e3:.1f} mm {side} before the bump"
        case _Sort.COURSE:
            return f"course of {name} {size:.0%} off"
        case _Sort.PEAK:
            return f"peak of {name} {math.exp(size):.2f} times the others'"
        case _Sort.ROUGH:
            return f"{name} {math.exp(size):.1f} times as rough"
