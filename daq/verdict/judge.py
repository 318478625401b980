"""Judges one run: all checks in the order of cause and effect."""

from __future__ import annotations

from collections.abc import Sequence

from dbc.words import Finding

from ..bench.campaign import Step
from ..bench.config import Bench
from . import motion, traffic
from .bump_kind import mirrored, patterns, struck, wrong_mode
from .motion import body_wave, not_repeatable, waves
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
    kind = kinds[0] if kinds else None
    wave = body_wave(signals, bench.campaign.bump_s)
    measure = RunMeasure(
        wheels=struck(step.excitation, kind) if kind else None,
        peaks={trace.name: trace.peak for trace in signals},
        waves=waves(signals),
    )
    findings = [each for check in _BEFORE_KIND for each in check(bench, window, signals)]
    findings += [each for way in kinds for each in wrong_mode(step.excitation, way)]
    findings += mirrored(step.excitation, kind) if kind else ()
    findings += motion.not_decayed(bench, window, signals)
    findings += motion.rest_changed(bench, window, signals)
    before, doubted = (
        [other for other in others if other.wheels == measure.wheels]
        for others in (accepted, unlike)
    )
    findings += not_repeatable(signals, measure, before, doubted)
    purity = kind.likeness[step.excitation] if kind else None
    return (*findings, _motion(signals, wave, purity)), measure


def _motion(
    signals: tuple[Trace, ...], wave: tuple[float, float] | None, purity: float | None
) -> Finding:
    """Return size, frequency and damping of the motion, for information."""
    sizes = {
        "m/s2": max((t.peak for t in signals if t.channel.unit == "m/s2"), default=None),
        "m": max((t.peak for t in signals if t.channel.unit == "m"), default=None),
    }
    parts = [
        f"peak {sizes['m/s2']:.1f} m/s2" if sizes["m/s2"] is not None else "",
        f"{sizes['m'] * 1e3:.0f} mm" if sizes["m"] is not None else "",
        f"f {wave[0]:.2f} Hz, zeta {wave[1]:.2f}" if wave else "",
        f"{purity:.0%} pure" if purity is not None else "",
    ]
    text = ", ".join(filter(None, parts)) or "nothing measured"
    return finding("motion", True, wave[0] if wave else 0.0, 0.0, "Hz", text)
