"""Judges one run: all checks in the order of cause and effect."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dbc.finding import Finding

from ..bench.campaign import Step
from ..bench.config import Bench
from ..channels import TIME_DERIVATIVE, Quantity
from . import motion, traffic
from .bump_kind import Pattern, mirrored, patterns, struck, wrong_mode
from .repeats import levels, not_repeatable, roughness, waves
from .wave import body_wave
from .window import RunMeasure, RunWindow, Trace, traces
from .words import finding

_BEFORE_KIND = (
    traffic.stale,
    traffic.lost_frames,
    traffic.overload,
    traffic.frozen,
    motion.not_at_rest,
    motion.too_weak,
    motion.double_bump,
    motion.too_strong,
)
"""The checks that go before the kind of the bump."""


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
        findings = list(traffic.stale(bench, window, signals))
        text = "no channel has samples before and after the bump"
        return (*findings, finding("no_data", False, 0.0, 1.0, "", text)), RunMeasure()
    kinds = patterns(bench, signals)
    measure = _measure(bench, step, signals, kinds[:1])
    findings = [each for check in _BEFORE_KIND for each in check(bench, window, signals)]
    findings += [each for kind in kinds for each in wrong_mode(step.excitation, kind)]
    findings += [each for kind in kinds[:1] for each in mirrored(step.excitation, kind)]
    findings += motion.not_decayed(bench, window, signals)
    findings += motion.rest_changed(bench, window, signals)
    before, doubted = (
        [other for other in others if other.wheels == measure.wheels]
        for others in (accepted, unlike)
    )
    findings += not_repeatable(signals, measure, before, doubted)
    return (*findings, _motion(measure)), measure


def _measure(
    bench: Bench, step: Step, signals: tuple[Trace, ...], kinds: Iterable[Pattern]
) -> RunMeasure:
    """Return the measures of a run; `kinds`: the best pattern of the bump, if there is any."""
    kind = next(iter(kinds), None)
    angular = {Quantity.PITCH_ACCELERATION, Quantity.ROLL_ACCELERATION}
    peaks = {
        order: [
            t.peak
            for t in signals
            if TIME_DERIVATIVE[t.channel.quantity] == order and t.channel.quantity not in angular
        ]
        for order in (0, 2)
    }
    frequency_hz, damping = body_wave(signals, bench.campaign.bump_s) or (None, None)
    return RunMeasure(
        peak_m_s2=max(peaks[2], default=None),
        peak_m=max(peaks[0], default=None),
        frequency_hz=frequency_hz,
        damping=damping,
        shares=kind.shares if kind else {},
        purity=kind.likeness[step.excitation] if kind else None,
        wheels=struck(step.excitation, kind) if kind else None,
        peaks={trace.name: trace.peak for trace in signals},
        waves=waves(signals),
        levels=levels(signals),
        roughness=roughness(signals),
    )


def _motion(measure: RunMeasure) -> Finding:
    """Return size, frequency and damping of the motion, for information."""
    parts = []
    if measure.peak_m_s2 is not None:
        parts.append(f"peak {measure.peak_m_s2:.1f} m/s2")
    if measure.peak_m is not None:
        parts.append(f"{measure.peak_m * 1e3:.0f} mm")
    if measure.frequency_hz is not None:
        parts.append(f"f {measure.frequency_hz:.2f} Hz, zeta {measure.damping:.2f}")
    if measure.purity is not None:
        parts.append(f"{measure.purity:.0%} pure")
    value = measure.frequency_hz or 0.0
    return finding("motion", True, value, 0.0, "Hz", ", ".join(parts) or "nothing measured")
