"""Applies all gates; together they give the verdict, and what survives of the parameters.

Every cause whose size was estimated implies a change of each parameter.  A parameter survives if
none of the causes that may still be true moves it by more than its standard deviation: with noise
and cause together it then still lies within three of them.  (With half of the 95 % interval as the
limit, survivors of the stress list had errors of four standard deviations.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, isfinite, nan

import numpy as np

from daq.sessions import Session
from dbc.words import Finding, Severity

from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED
from ..fit.uncertainty import determined
from .faults import Causes, likely_causes
from .finding import MOST, Cause, Judgement, Loss, Survival
from .gates import (
    CHI2_LIMIT,
    chi2_by_run,
    misfit_findings,
    mode_snr_db,
    parameter_findings,
    undetermined,
    whiteness_findings,
)
from .samples import sample_findings
from .statements import contradicted_shift, contradictions, unseen_findings

_RIVAL = 0.5
"""Share of the best cause's explanation above which another cause may be the true one."""
_UNEXPLAINED = "no cause that was tried explains the misfit"
_UNEXPLAINED_TEXT = (
    "the misfit is not explained: half of it or more is due to none of wrong signs, units and "
    "gains, swapped channels and mass states, lateness, low-passes, drifts, clocks that jump, "
    "second bumps, wrong weights, odd runs, a turned IMU, unequal sides, friction and dampers: "
    "look at the runs with the largest chi2/n"
)
_LARGEST_LOG = 3.0
"""Change of a logarithm beyond which its size has no meaning: a factor of twenty."""


def judge(
    session: Session,
    estimation: Estimation,
    unused: Sequence[Finding] = (),
    causes: Causes | None = None,
) -> Judgement:
    """Judge an estimation by all gates.

    For a nonlinear fit, no cause is sought that only a linear model lacks: its elements are in the
    fit.

    `unused`: what was left out (`unused_findings`).  `causes`: the fault of the bench that was
    found before, if any.
    """
    linear, holds = estimation.nonlinear is None, estimation.holds
    sure = not undetermined(estimation)
    snr_db = mode_snr_db(estimation)
    causes = causes or Causes()
    if linear and not causes.findings and (sure or not holds):
        causes = likely_causes(estimation)
    # A named cause may be the reason why stated values disagree with the runs.
    codes = {finding.code for finding in causes.findings} - {"amplitude"}
    explained = bool(codes) and (not holds or "added_weights_off_by_a_common_factor" in codes)
    misfit = tuple(f for f in misfit_findings(estimation) if sure or f.code != "convergence")
    # What causes a misfit is as grave as the misfit, and comes first.
    grave = max((f.severity for f in misfit if f.code == "chi2"), default=Severity.NOTE)
    named = [
        f if holds or f.code == "amplitude" else replace(f, severity=max(f.severity, grave))
        for f in causes.findings
    ]
    if linear and not (holds or named):
        named.append(Finding("unexplained", Severity.WARNING, _UNEXPLAINED_TEXT))
    of_parameters = parameter_findings(estimation)
    findings = [
        *unused,
        *([] if holds else named),  # what to do before what is wrong
        *misfit,
        *(f for f in of_parameters if not (explained and f.code == "contradiction")),
        *(unseen_findings(estimation.box, session.mass_states) if sure else ()),
        *sample_findings(session, estimation.records),
        *(named if holds else []),
        *(whiteness_findings(estimation) if sure and holds else ()),
    ]
    rivals = [replace(c, explained=inf) if holds else c for c in causes.tried]
    contradicted = contradictions(estimation) if sure and not explained else ()
    if contradicted:  # one cause; without a misfit, all compete
        name = "; ".join(one.name for one in contradicted)
        moved = contradicted_shift(estimation, contradicted)
        rivals.append(Cause(name, explained=inf, moved=moved))
    return Judgement(
        tuple(findings),
        estimation.chi2_per_n,
        chi2_by_run(estimation),
        snr_db,
        survival(estimation, rivals),
    )


def survival(estimation: Estimation, causes: Sequence[Cause]) -> Survival:
    """Divide the parameters into those that survive and those that are lost.

    The intervals of a nonlinear fit that converged include the little that it leaves unexplained.
    In a linear fit with a misfit, a parameter survives only if the known causes explain nearly all
    of the misfit.

    `causes`: all that were refitted or sized, and that stand out of the noise.
    """
    box, fit = estimation.box, estimation.fit
    names, linear = box.parameters, estimation.nonlinear is None
    if not fit.converged and (linear or not estimation.holds):
        return Survival((), dict.fromkeys(box.names, Loss("the fit did not converge")))
    known = zip(names, determined(box, fit.covariance), strict=True)
    lost = {name: Loss("not determined") for name, is_known in known if not is_known}
    rivals = list(causes)
    if linear and not estimation.holds:
        best = max((h.explained for h in causes if isfinite(h.explained)), default=0.0)
        unexplained = 1.0 + (estimation.chi2_per_n - 1.0) * (1.0 - min(best, 1.0))
        if best <= MOST or unexplained > CHI2_LIMIT:
            return Survival((), dict.fromkeys(box.names, Loss(_UNEXPLAINED)) | lost)
        rivals = [h for h in causes if h.explained >= _RIVAL * best]
    std = np.sqrt(np.diag(fit.covariance)[: len(names)])
    for name, within in zip(names, std.tolist(), strict=True):
        # Two causes may be one shift in two words: rounding must not choose which of them is named.
        worst = max(rivals, key=lambda h: float(f"{abs(h.moved[name]):.6g}"), default=None)
        if name not in lost and worst is not None and abs(worst.moved[name]) > within:
            by = float(np.expm1(np.clip(worst.moved[name], -_LARGEST_LOG, _LARGEST_LOG)))
            lost[name] = Loss(worst.name, nan if name in SIGNED else by)
    return Survival(tuple(name for name in box.names if name not in lost), lost)
