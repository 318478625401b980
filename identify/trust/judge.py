"""Applies all gates; together they give the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf

from daq.loading import WEIGHT_SAG
from daq.sessions import Session
from dbc.finding import Finding

from ..fit.estimation import Estimation
from .cause_ranking import rank_causes
from .cause_texts import Causes, causes_of, wrong_channel_cause
from .consistency import moves_without, repeat_findings
from .contradiction import contradicted_shift, contradictions
from .excitation import excitation_findings, mode_snr_db
from .finding import Judgement
from .lift_off import lift_off_findings
from .linear_effects import ONE_WEIGHT, WEIGHTS
from .misfit import chi2_by_run, misfit_findings
from .plausibility import parameter_findings, undetermined
from .refit import Explanation, largest_shift
from .sampling import sampling_findings
from .saturation import saturation_findings
from .scale import gain_findings, scale_findings, weight_findings
from .survival import Hypothesis, survival
from .whiteness import whiteness_findings

_OF_WEIGHTS = {WEIGHTS.replace(" ", "_")}
_NON_LINEAR = {"friction_in_the_suspension", "dampers_stronger_in_rebound_than_in_compression"}


def judge(
    session: Session,
    estimation: Estimation,
    signs: Sequence[Finding] = (),
    unused: Sequence[Finding] = (),
    wrong: Explanation | None = None,
) -> Judgement:
    """Judge an estimation by all gates.

    For a nonlinear fit, no cause is sought that only a linear model lacks: its elements are in the
    fit.

    `signs`: channels whose sign is wrong (`daq.check.opposed_signs`), or weights that the sag
    contradicts (`contradicted_by_sag`), the cause if there are any.
    `unused`: what was left out (`unused_findings`).  `wrong`: the channel or the clocks that
    are the cause (`wrong_channel`, `clock_jump`), if there are any.
    """
    linear, holds = estimation.nonlinear is None, estimation.holds
    determined = not undetermined(estimation)
    snr_db = mode_snr_db(estimation)
    known = bool(signs or wrong)
    causes = wrong_channel_cause(wrong) if wrong else Causes(tuple(map(_as_cause, signs)))
    if linear and not known and (determined or not holds):
        causes = _causes(estimation)
    explained = _explains(estimation, causes)
    parameters = parameter_findings(estimation)
    findings = [
        *unused,
        *(() if holds else causes.findings),  # what to do before what is wrong
        *(f for f in misfit_findings(estimation) if determined or f.code != "convergence"),
        *(f for f in parameters if not (explained and f.code == "contradiction")),
        *(scale_findings(estimation.box) if determined else ()),
        *(gain_findings(estimation.box) if determined else ()),
        *(weight_findings(session.mass_states) if determined else ()),
        *sampling_findings(session, estimation.records),
        *saturation_findings(session, estimation.records),
        *excitation_findings(estimation, snr_db),
        *(causes.findings if holds else ()),
    ]
    if determined and holds:
        findings += whiteness_findings(estimation)
        findings += lift_off_findings(estimation) if linear else ()
    hypotheses = list(_hypotheses(estimation, causes, determined and not explained))
    return Judgement(
        tuple(findings),
        estimation.chi2_per_n,
        chi2_by_run(estimation),
        snr_db,
        survival(estimation, hypotheses),
    )


def _as_cause(finding: Finding) -> Finding:
    fault = ONE_WEIGHT if finding.code == WEIGHT_SAG else "wrong signs"
    text = f"likely cause: {fault}, {finding.text}: {finding.advice}"
    return replace(finding, text=text)


def _causes(estimation: Estimation) -> Causes:
    """Report an outlying run first, because it imitates other causes; amplitude last."""
    ranked = rank_causes(estimation)
    repeats = repeat_findings(estimation, ranked[0].strength)
    at_odds = contradictions(estimation) if estimation.holds else ()
    if at_odds and at_odds[0].of_place:  # a gain, or a bar, would explain a part of it
        ranked = tuple(s for s in ranked if s.score.gain > at_odds[0].sigmas ** 2)
    for odd in (finding for finding in repeats if finding.code == "odd_run"):
        excess = max(estimation.chi2_per_n - 1.0, 1e-9)
        moved = moves_without(estimation, odd.subject.split(", "))
        share = 1.0 - (odd.value - 1.0) / excess
        run = Explanation(f"run {odd.subject}", "", "", share, *largest_shift(moved), moved)
        return Causes(repeats, (run,))
    causes = causes_of(estimation, ranked)
    explained = bool(causes.findings) and not {f.code for f in causes.findings} & _NON_LINEAR
    return causes if explained else Causes((*causes.findings, *repeats), causes.tried)


def _explains(estimation: Estimation, causes: Causes) -> bool:
    """Return whether a named cause is the reason why stated values disagree with the runs."""
    named = {finding.code for finding in causes.findings} - {"amplitude"}
    return bool(named) and (not estimation.holds or bool(named & _OF_WEIGHTS))


def _hypotheses(estimation: Estimation, causes: Causes, at_odds: bool) -> Iterator[Hypothesis]:
    """Yield every sized cause with the changes that it means; without a misfit, all compete."""
    for cause in causes.tried:
        yield Hypothesis(cause.name, inf if estimation.holds else cause.explained, cause.moved)
    found = contradictions(estimation) if at_odds else ()
    if found:
        moved = contradicted_shift(estimation, found).tolist()
        names = estimation.box.parameters
        wrong = "; ".join(one.name for one in found)
        yield Hypothesis(wrong, inf, dict(zip(names, moved, strict=True)))
