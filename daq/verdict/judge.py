"""Judges one run: all checks in the order of cause and effect."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

from dbc.finding import Finding

from ..bench.campaign import Step
from ..bench.config import Bench
from ..channels import TIME_DERIVATIVE, Quantity
from . import motion, traffic
from .frozen import frozen
from .pattern import mirrored, patterns, struck, wrong_mode
from .repeats import levels, not_repeatable, roughness, waves
from .strikes import Pattern
from .wave import body_wave
from .window import ANGULAR, RunMeasure, RunWindow, Trace, traces
from .words import finding

_CHECKS = (
    traffic.stale,
    traffic.lost_frames,
    traffic.overload,
    frozen,
    motion.not_at_rest,
    motion.too_weak,
    motion.double_bump,
    motion.too_strong,
)


def judge(
    bench: Bench,
    step: Step,
    window: RunWindow,
    accepted: Sequence[RunMeasure],
    unlike: Sequence[RunMeasure] = (),
) -> tuple[tuple[Finding, ...], RunMeasure]:
    """Judge one run.

    `step`: the mass state and the kind of bump that were due.  `accepted`: measures of the runs
    accepted so far with the same mass state and excitation.  `unlike`: measures of the runs that
    were rejected only as not repeatable.  Returns every check with value and limit, also those that
    passed, and the measures, for the comparison with later runs; the run is good if all checks
    passed.  The first failed check is the likeliest cause of the others.  A check that the sensors
    do not allow is left out.
    """
    signals = traces(bench.channels, window)
    if not signals:
        findings = tuple(traffic.stale(bench, window, signals))
        text = "no channel has samples before and after the bump"
        return (*findings, finding("no_data", False, 0.0, 1.0, "", text)), RunMeasure()
    findings = tuple(found for check in _CHECKS for found in check(bench, window, signals))
    bump_patterns = patterns(bench, signals)
    measure = _measure(bench, step, signals, bump_patterns)
    findings += tuple(found for way in bump_patterns for found in wrong_mode(step.excitation, way))
    findings += tuple(
        found for way in bump_patterns[:1] for found in mirrored(step.excitation, way)
    )
    findings += tuple(motion.not_decayed(bench, window, signals))
    findings += tuple(motion.rest_changed(bench, window, signals))
    before, doubted = (
        [other for other in others if other.wheels == measure.wheels]
        for others in (accepted, unlike)
    )
    findings += tuple(not_repeatable(signals, measure, before, doubted))
    return (*findings, _motion(measure)), measure


def _measure(
    bench: Bench, step: Step, signals: tuple[Trace, ...], bump_patterns: tuple[Pattern, ...]
) -> RunMeasure:
    linear = [trace for trace in signals if trace.channel.quantity not in ANGULAR]

    def largest(derivative: int) -> float | None:
        return max(
            (t.peak for t in linear if TIME_DERIVATIVE[t.channel.quantity] == derivative),
            default=None,
        )

    how = bump_patterns[0] if bump_patterns else None
    wave = body_wave(signals, bench.campaign.bump_s)
    return RunMeasure(
        peak_m_s2=largest(TIME_DERIVATIVE[Quantity.BODY_ACCELERATION]),
        peak_m=largest(TIME_DERIVATIVE[Quantity.SUSPENSION_TRAVEL]),
        frequency_hz=wave[0] if wave else None,
        damping=wave[1] if wave else None,
        shares=how.shares if how else MappingProxyType({}),
        purity=how.likeness[step.excitation] if how else None,
        wheels=struck(step.excitation, how) if how else None,
        peaks=MappingProxyType({trace.channel.name: trace.peak for trace in signals}),
        waves=waves(signals),
        levels=levels(signals),
        roughness=roughness(signals),
    )


def _motion(measure: RunMeasure) -> Finding:
    parts = []
    if measure.peak_m_s2 is not None:
        parts.append(f"peak {measure.peak_m_s2:.1f} m/s2")
    if measure.peak_m is not None:
        parts.append(f"{measure.peak_m * 1e3:.0f} mm")
    if measure.frequency_hz is not None and measure.damping is not None:
        parts.append(f"f {measure.frequency_hz:.2f} Hz, zeta {measure.damping:.2f}")
    if measure.purity is not None:
        parts.append(f"{measure.purity:.0%} pure")
    value = measure.frequency_hz or 0.0
    return finding("motion", True, value, 0.0, "Hz", ", ".join(parts) or "nothing measured")
