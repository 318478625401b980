"""Judges one run: all checks in the order of cause and effect, and its likeness to earlier runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only
from dbc.words import Finding

from ..bench.campaign import Step
from ..bench.config import Bench
from ..channels import Quantity
from . import checks
from .bump_kind import patterns, wrong_mode
from .window import RunMeasure, RunWindow, Trace, kind_of, traces
from .words import finding

_BEFORE_KIND = (
    checks.stale,
    checks.lost_frames,
    checks.overload,
    checks.frozen,
    checks.not_at_rest,
    checks.too_weak,
    checks.double_bump,
    checks.too_strong,
)
"""The checks that go before the kind of the bump."""
PEAK_RATIO = 1.4
"""Largest ratio of a peak to the median of the accepted runs, in either direction: above it the
bump had another speed or height."""
LIKENESS = 0.85
"""Least correlation of the slow motion with the median: below it, the motion is another one."""
MAIN_RATIO = 0.3
"""Ratio to the largest peak of its kind above which a channel counts: small motions differ much."""


def judge(
    bench: Bench, step: Step, window: RunWindow, accepted: Sequence[RunMeasure]
) -> tuple[tuple[Finding, ...], RunMeasure]:
    """Return the findings on one run, and its measures.

    `step`: the mass state and the kind of bump that were due.  `accepted`: measures of the runs
    accepted so far with the same mass state and excitation.  The findings are of every check that
    the sensors allow, also if it passed; without samples only of silence.  The run is good if all
    passed; the first failed check is the likeliest cause of the others.
    """
    method = bench.campaign.method_of(step.excitation)
    bench = replace(bench, campaign=replace(bench.campaign, method=method))
    signals = traces(bench.channels, window)
    if not signals:
        findings = list(checks.stale(bench, window, signals))
        text = "no channel has samples before and after the bump"
        return (*findings, finding("no_data", False, 0.0, 1.0, "", text)), RunMeasure()
    bump_patterns = patterns(bench, signals)
    measure = RunMeasure({trace.name: trace.peak for trace in signals}, slow_motion(signals))
    findings = [each for check in _BEFORE_KIND for each in check(bench, window, signals)]
    findings += [each for pattern in bump_patterns for each in wrong_mode(step.excitation, pattern)]
    findings += checks.not_decayed(bench, window, signals)
    findings += checks.rest_changed(bench, window, signals)
    findings += not_repeatable(signals, measure, accepted) if accepted else ()
    # The wheels show the kind more clearly than the body, whose pattern is the last.
    purity = bump_patterns[0].likeness[step.excitation] if bump_patterns else None
    wave = body_wave(signals, bench.campaign.bump_s)
    return (*findings, _motion(signals, wave, purity)), measure


def _motion(
    signals: tuple[Trace, ...], wave: tuple[float, float] | None, purity: float | None
) -> Finding:
    """Return size, frequency and damping of the motion, for information.

    `wave`: frequency, Hz, and damping ratio.  `purity`: likeness to the kind that was due, 0..1.
    """
    peak, travel_m = (
        max((t.peak for t in signals if t.channel.unit == unit), default=None)
        for unit in ("m/s2", "m")
    )
    facts = [
        f"peak {peak:.1f} m/s2" if peak is not None else "",
        f"{travel_m * 1e3:.0f} mm" if travel_m is not None else "",
        f"f {wave[0]:.2f} Hz, zeta {wave[1]:.2f}" if wave else "",
        f"{purity:.0%} pure" if purity is not None else "",
    ]
    text = ", ".join(filter(None, facts)) or "nothing measured"
    return finding("motion", True, wave[0] if wave else 0.0, 0.0, "Hz", text)


_BODY = (
    (Quantity.SUSPENSION_TRAVEL,),
    (Quantity.PITCH_RATE, Quantity.ROLL_RATE, Quantity.BODY_ACCELERATION),
    (Quantity.BODY_DISPLACEMENT,),
    (Quantity.PITCH_ACCELERATION, Quantity.ROLL_ACCELERATION),
)
"""Quantities that show the swing of the body, the clearest first."""


def body_wave(signals: tuple[Trace, ...], bump_s: float) -> tuple[float, float] | None:
    """Return natural frequency, Hz, undamped, and damping ratio of the body's motion after a bump.

    A damped wave is fitted to the clearest motion: each of its means over 80 ms is a linear
    combination of the two means before.  `bump_s`: duration of the bump.  None if nothing shows the
    body or it does not swing.
    """
    start_s, step_s = bump_s + 0.2, 0.08  # 0.2 s after the bump the wheels are at rest again
    # Five times the noise and a second of motion, about a period of the body, are enough.
    swinging = [t for t in signals if t.peak > 5.0 * t.noise and t.time_s[-1] > start_s + 1.0]
    by_clarity = (checks.of_quantity(swinging, *quantities) for quantities in _BODY)
    of_body = next(filter(None, by_clarity), None)
    if of_body is None:
        return None
    clearest = max(of_body, key=lambda trace: trace.rms(start_s, np.inf) / max(trace.noise, 1e-12))
    edges_s = np.arange(start_s, clearest.time_s[-1], step_s)
    mean = np.diff(_area(clearest, edges_s)) / step_s  # (n,)
    # (n - 2, 3): the two means before each one, and 1 for the level about which the wave swings.
    previous = np.stack([mean[1:-1], mean[:-2], np.ones(len(mean) - 2)], axis=1)
    of_last, of_last_but_one, _ = np.linalg.lstsq(previous, mean[2:])[0]
    root = np.roots([1.0, -of_last, -of_last_but_one])[0]  # the factor of a step, complex
    if root.imag == 0.0:  # the body returns without swinging
        return None
    pole = np.log(root) / step_s
    return float(abs(pole) / (2 * np.pi)), float(-pole.real / abs(pole))


# Comparison with the accepted runs of the kind ----------------------------------------------------


def slow_motion(signals: tuple[Trace, ...]) -> dict[str, NDArray[np.float64]]:
    """Return by channel the motion of body and travels, (70,), every 20 ms from 0.1 to 1.5 s.

    Each value is the mean over 60 ms, against the jitter of the trigger.
    """
    grid_s, width_s = np.arange(0.1, 1.5, 0.02), 0.06
    means = {}
    for trace in signals:
        if trace.channel.quantity is not Quantity.HUB_ACCELERATION:
            area = _area(trace, grid_s + width_s / 2) - _area(trace, grid_s - width_s / 2)
            means[trace.name] = read_only(area / width_s)
    return means


def _area(trace: Trace, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the integral, up to given times, of the straight lines between the samples."""
    time_s, value = trace.time_s, trace.value
    trapezia = np.diff(time_s) * (value[1:] + value[:-1]) / 2.0
    until_sample = np.concatenate([[0.0], np.cumsum(trapezia)])
    previous = np.searchsorted(time_s, t_s) - 1  # sample before each time: a trace begins earlier
    mean_since = (value[previous] + np.interp(t_s, time_s, value)) / 2.0
    return np.asarray(until_sample[previous] + (t_s - time_s[previous]) * mean_since)


def not_repeatable(
    signals: tuple[Trace, ...], measured: RunMeasure, accepted: Sequence[RunMeasure]
) -> Iterator[Finding]:
    """Yield how peaks and course compare with the median of the accepted runs, at least one run.

    The findings are on the channel whose peak differs most and on the one whose course does, of
    those that move most in this run or in the others; none if no channel moves in all of them.
    """
    in_all_runs = set.intersection(*(set(run.peaks) for run in accepted))
    kinds = {t.name: kind_of(t.channel) for t in signals if t.name in in_all_runs}
    usual = {name: float(np.median([run.peaks[name] for run in accepted])) for name in kinds}
    size = {name: max(measured.peaks[name], usual[name]) for name in kinds}
    largest = {kind: max(size[n] for n in size if kinds[n] == kind) for kind in kinds.values()}
    main = [name for name in size if size[name] > MAIN_RATIO * largest[kinds[name]]]
    if not main:
        return
    # A peak of 0 has no ratio: 1e-12 of any unit takes its place.
    ratios = {n: max(measured.peaks[n], 1e-12) / max(usual[n], 1e-12) for n in main}
    # Half and twice the size are equally far from equal.
    furthest = max(ratios, key=lambda name: abs(math.log(ratios[name])))
    ratio = ratios[furthest]
    text = f"peak of {furthest} is {ratio:.2f} times that of the accepted runs "
    text += f"({1.0 / PEAK_RATIO:.2f} to {PEAK_RATIO:.2f} is allowed)"
    limit = PEAK_RATIO if ratio > 1.0 else 1.0 / PEAK_RATIO
    passed = 1.0 / PEAK_RATIO <= ratio <= PEAK_RATIO
    yield finding("not_repeatable", passed, ratio, limit, "", text, furthest)
    yield from _like_the_others(main, measured, accepted)


def _like_the_others(
    names: Sequence[str], measured: RunMeasure, accepted: Sequence[RunMeasure]
) -> Iterator[Finding]:
    """Yield the finding on the channel whose course is least like the median of accepted runs.

    `names`: channels to compare; nothing is yielded if none of them has a course in all runs.
    """
    comparable = [n for n in names if all(n in run.waves for run in (measured, *accepted))]
    usual_waves = {n: np.median([run.waves[n] for run in accepted], axis=0) for n in comparable}
    likeness = {n: _cosine(measured.waves[n], usual_waves[n]) for n in comparable}
    if likeness:
        least_like = min(likeness, key=lambda name: likeness[name])
        cosine = likeness[least_like]
        text = f"course of {least_like} is {cosine:.0%} like the accepted runs (at least "
        text += f"{LIKENESS:.0%})"
        passed = cosine >= LIKENESS
        yield finding("not_repeatable", passed, cosine, LIKENESS, "", text, least_like)


def _cosine(wave: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the correlation of two waves about zero, -1 to 1; 0 if one of them is zero."""
    product = float(np.linalg.norm(wave) * np.linalg.norm(other))
    return float(wave @ other) / product if product > 0.0 else 0.0
