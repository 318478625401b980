"""Judges whether the model holds: convergence, chi2, and the place of the misfit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dbc.finding import Finding, Severity
from dbc.words import counted

from ..decays.onset import coarse_steps, onset_s
from ..fit.estimation import Estimation
from .format import listed

CHI2_LIMIT = 1.5
"""Beyond this a result is refused: every row of the stress list that costs more than a third of a
parameter lies there."""
_MODEL = ("the linear 7-DOF model", "the model with friction, damper curves, stops and mounts")
_UNSETTLED = (
    "check units, signs and positions of the channels",
    "its numbers may be away from the optimum; add runs, or forbid in [vehicle.structure] the "
    "elements that the car does not have",
)
_INTERVALS = ("the intervals do not hold", "the intervals are widened by the unexplained rest")
_LATE_S = 0.015
"""Delay, s, of a decay's start after the stated end of the bump that onset and guard cannot
explain."""


def chi2_by_run(estimation: Estimation) -> dict[str, dict[str, float]]:
    """Return the mean square residual in units of the noise for each run and channel."""
    noise = estimation.noise
    return {
        decay.label: {
            name: float(values @ values) / noise[name] ** 2 / decay.freedom[name]
            for name, values in decay.values.items()
        }
        for decay in estimation.residuals
    }


def misfit_findings(estimation: Estimation) -> tuple[Finding, ...]:
    """Judge convergence and chi2/n."""
    findings = []
    if not estimation.fit.converged:
        advice = _UNSETTLED[bool(estimation.nonlinear)]
        steps = estimation.fit.iterations
        text = f"the fit did not converge in {counted(steps, 'iteration')}: {advice}"
        # The nonlinear fit ends near its optimum even if it has not converged.
        severity = Severity.WARNING if estimation.nonlinear else Severity.ERROR
        findings.append(Finding("convergence", severity, text))
    if not estimation.holds:
        run, channel, worst = _worst(chi2_by_run(estimation))
        refused = not estimation.chi2_per_n <= max(CHI2_LIMIT, estimation.chi2_limit)
        text = (
            f"{_MODEL[bool(estimation.nonlinear)]} does not explain the decays: chi2/n = "
            f"{estimation.chi2_per_n:.3f} (limit {estimation.chi2_limit:.3f}, refused above "
            f"{CHI2_LIMIT}), worst {channel} in {run} with {worst:.2f}: "
            f"{_INTERVALS[bool(estimation.nonlinear and not refused)]}"
        )
        findings.append(Finding("chi2", Severity.ERROR if refused else Severity.WARNING, text))
    if not estimation.rest:
        text = "no quiet stretch before the bumps: the noise is taken from the residuals"
        findings.append(Finding("noise", Severity.NOTE, text))
    coarse = coarse_steps(estimation.records) if estimation.rest else {}
    if coarse:
        units = {c.name: c.unit for group in estimation.box.groups for c in group.channels}
        which = listed(f"{name} ({step:.2g} {units[name]})" for name, step in coarse.items())
        text = (
            f"coarse sensors, whose steps hide the noise at rest: {which}; their noise is taken as "
            "step/sqrt(12): a smaller range of the sensor narrows the intervals"
        )
        findings.append(Finding("coarse_sensors", Severity.NOTE, text))
    return (*findings, *_late_start(estimation))


def _late_start(estimation: Estimation) -> tuple[Finding, ...]:
    late = {}
    for record, decay in zip(estimation.records, estimation.decays, strict=True):
        onset = onset_s(record)
        if onset is not None and np.isfinite(record.bump_s):
            late[record.label] = decay.start_s - onset - record.bump_s
    if late and max(late.values()) > _LATE_S:
        run = max(late, key=lambda label: late[label])
        text = (
            f"the model holds only from {late[run] * 1e3:.0f} ms after the stated end of the bump "
            f"({run}): the bump lasts longer than bump_s says, or the first motion of the wheels "
            "does not fit; check bump_s, the hub sensors, and that no wheel lifted"
        )
        return (Finding("late_start", Severity.WARNING, text),)
    if estimation.later_s and not late:
        text = (
            f"the decays were found to start {estimation.later_s * 1e3:.0f} ms into the records: "
            "begin a record at rest before the bump"
        )
        return (Finding("late_start", Severity.NOTE, text),)
    return ()


def _worst(by_run: Mapping[str, Mapping[str, float]]) -> tuple[str, str, float]:
    rows = [(run, name, chi2) for run, row in by_run.items() for name, chi2 in row.items()]
    return max(rows, key=lambda row: row[2])
