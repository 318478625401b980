"""Finds the runs of a kind that belong together, if more were accepted than planned.

A run that passed its verdict may still be that of a changed car: a foot on the sill, a hand on the
roof, a weight that slipped.  Height and timing of a bump do not matter here: the usual run of the
others, scaled and shifted in time, is first subtracted from the free decay.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from statistics import median

import numpy as np
from numpy.typing import NDArray

from ..channels import Channel
from .repeats import MAIN, after
from .window import ANGULAR, RunMeasure

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


class Sort(StrEnum):
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


LEAST: Mapping[Sort, float] = {
    Sort.LEVEL: 0.03,
    Sort.COURSE: 0.004,
    Sort.PEAK: 0.1,
    Sort.ROUGH: 0.6,
}
"""Least difference that counts, however similar the others are; for the course, the least usual
difference.  Good runs of cars without friction differ by half of it in level (with friction by
more), and by 0.095 and 0.59 in peak and roughness (74 measured, hubs at 200 Hz)."""

Differences = Mapping[tuple[Sort, str], float]
"""Differences by sort and channel, with a sign where they have one."""


@dataclass(frozen=True, slots=True)
class _Usual:
    """Medians of the measures of some runs."""

    waves: Mapping[str, NDArray[np.float64]]
    """Free decay, by channel."""
    peaks: Mapping[str, float]
    """By channel."""
    roughness: Mapping[str, float]
    """By channel."""
    levels: Mapping[str, float]
    """By channel."""
    largest: Mapping[str, float]
    """Largest peak of the channel's quantity, by channel."""
    frequency_hz: float | None
    """Natural frequency, Hz; None if a run shows none."""


def left_out(
    channels: Sequence[Channel], bump_s: float, measures: Mapping[str, RunMeasure], planned: int
) -> dict[str, str]:
    """Return the runs that the most consistent set leaves out, each with its difference in words.

    `bump_s`: duration of the bump, s.  `measures`: measures of the accepted runs of one kind, by
    label.  `planned`: number of runs in the campaign; at least this number and `FEWEST` are kept.
    """
    kept = {label: after(m, bump_s + GUARD_S) for label, m in measures.items() if m.peaks}
    out = {}
    while len(kept) > max(planned, FEWEST):
        found = _compared(channels, kept, kept)
        odd = max(kept, key=lambda label: found[label][0])
        if found[odd][0] <= 1.0:
            break
        out[odd] = kept.pop(odd)
    ratios = _compared(channels, kept, out) if out else {}
    return {
        label: ratios[label][1] for label in measures if label in out and ratios[label][0] > 1.0
    }


def _compared(
    channels: Sequence[Channel], kept: Mapping[str, RunMeasure], asked: Mapping[str, RunMeasure]
) -> dict[str, tuple[float, str]]:
    """Return the largest difference of each requested run relative to its limit, and its text."""
    usual = _usual(channels, list(kept.values()))
    among = [_differences(usual, run) for run in kept.values()]
    common = {key: median(abs(found[key]) for found in among) for key in among[0]}
    limits = {
        (sort, name): max(LEAST[sort], size if sort is Sort.COURSE else UNUSUAL * size)
        for (sort, name), size in common.items()
    }
    result = {}
    for label, run in asked.items():
        found = _differences(usual, run)
        ratios = {key: abs(found[key]) / limits[key] for key in limits if key in found}
        over, words = 0.0, []
        for sort in Sort:
            of_sort = {key: ratio for key, ratio in ratios.items() if key[0] is sort}
            if not of_sort:
                continue
            worst = max(of_sort, key=lambda key: of_sort[key])
            ratio = of_sort[worst]
            if sort is Sort.COURSE:
                ratio = float(np.sqrt(np.mean(np.square(list(of_sort.values()))))) / UNLIKE
            over = max(over, ratio)
            if ratio > 1.0:
                words.append(_words(usual, *worst, found[worst]))
        result[label] = over, ", ".join([*words[:2], *_frequency(usual, run)])
    return result


def _usual(channels: Sequence[Channel], runs: Sequence[RunMeasure]) -> _Usual:
    def medians(values: Iterable[Mapping[str, float]]) -> dict[str, float]:
        every = list(values)
        known = set.intersection(*map(set, every))
        return {c.name: median(v[c.name] for v in every) for c in channels if c.name in known}

    waves = [run.waves for run in runs]
    known = set.intersection(*map(set, waves))
    peaks = medians(run.peaks for run in runs)
    kind = {c.name: ANGULAR if c.quantity in ANGULAR else c.quantity for c in channels}
    hertz = [run.frequency_hz for run in runs if run.frequency_hz is not None]
    return _Usual(
        waves={name: np.median([w[name] for w in waves], axis=0) for name in sorted(known)},
        peaks=peaks,
        roughness=medians(run.roughness for run in runs),
        levels=medians(run.levels for run in runs),
        largest={
            name: max(1e-12, *(p for other, p in peaks.items() if kind[other] == kind[name]))
            for name in peaks
        },
        frequency_hz=median(hertz) if len(hertz) == len(runs) else None,
    )


def _differences(usual: _Usual, measure: RunMeasure) -> Differences:
    """Return the differences of a run from the usual one."""
    largest = usual.largest
    scale, course = _course(usual, measure)
    found = {(Sort.COURSE, name): size for name, size in course.items()}
    for name in largest.keys() & measure.levels.keys() & usual.levels.keys():
        found[Sort.LEVEL, name] = (measure.levels[name] - usual.levels[name]) / largest[name]
    for name in largest.keys() & measure.peaks.keys():
        if usual.peaks[name] > MAIN * largest[name]:
            found[Sort.PEAK, name] = _log(measure.peaks[name], scale * usual.peaks[name])
    for name in largest.keys() & measure.roughness.keys() & usual.roughness.keys():
        finest = _FINEST * largest[name]
        rough = measure.roughness[name] + finest, usual.roughness[name] + finest
        found[Sort.ROUGH, name] = _log(*rough)
    return found


def _course(usual: _Usual, measure: RunMeasure) -> tuple[float, dict[str, float]]:
    """Return the ratio of the motion to the usual one, and the remainder after scale and shift."""
    names = [n for n in usual.waves if n in measure.waves and n in usual.largest]
    if not names:
        return 1.0, {}
    course = np.array([measure.waves[n] / usual.largest[n] for n in names])
    there = np.array([usual.waves[n] / usual.largest[n] for n in names])
    basis = np.stack([there.ravel(), np.gradient(there, axis=1).ravel()], axis=1)
    weights, *_ = np.linalg.lstsq(basis, course.ravel())
    slow = _cosines(course.shape[1])
    rest = (course - (basis @ weights).reshape(course.shape)) @ slow.T @ slow
    size = np.sqrt(np.mean(rest**2, axis=1) / max(1e-12, np.mean(there**2, axis=1).max()))
    return float(weights[0]), dict(zip(names, size.tolist(), strict=True))


@cache
def _cosines(count: int) -> NDArray[np.float64]:
    """Return the slowest orthonormal cosines over some samples, one per row (DCT-II)."""
    numbers = np.arange(min(_SLOW_COSINES, count))
    rows = np.cos(np.pi * np.outer(numbers, np.arange(count) + 0.5) / count)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _log(one: float, other: float) -> float:
    return float(np.log(max(one, 1e-12) / max(other, 1e-12)))


def _words(usual: _Usual, sort: Sort, name: str, size: float) -> str:
    match sort:
        case Sort.LEVEL:
            side = "higher" if size > 0.0 else "lower"
            return f"{name} {abs(size) * usual.largest[name] * 1e3:.1f} mm {side} before the bump"
        case Sort.COURSE:
            return f"course of {name} {size:.0%} off"
        case Sort.PEAK:
            return f"peak of {name} {np.exp(size):.2f} times the others'"
        case Sort.ROUGH:
            return f"{name} {np.exp(size):.1f} times as rough"


def _frequency(usual: _Usual, measure: RunMeasure) -> list[str]:
    if measure.frequency_hz is None or usual.frequency_hz is None:
        return []
    shift = measure.frequency_hz / usual.frequency_hz - 1.0
    return [f"frequency {shift:+.0%}"] if abs(shift) >= _NOTABLE else []
