"""All gates, and the verdict they make together."""

from __future__ import annotations

from daq.sessions import Session
from dbc.finding import Finding

from ..fit.estimation import Estimation
from .cause_ranking import rank_causes
from .cause_texts import cause_findings
from .consistency import repeat_findings
from .excitation import excitation_findings, mode_snr_db
from .finding import Quality
from .lift_off import lift_off_findings
from .misfit import chi2_by_run, misfit_findings
from .plausibility import parameter_findings, undetermined
from .sampling import sampling_findings
from .saturation import saturation_findings
from .whiteness import whiteness_findings

_NON_LINEAR = {"friction_in_the_suspension", "dampers_stronger_in_rebound_than_in_compression"}


def judge(session: Session, estimation: Estimation) -> Quality:
    """Judge an estimation by everything that is known of it."""
    if estimation.nonlinear is not None:
        return _judge_real_car(session, estimation)
    snr_db = mode_snr_db(estimation)
    findings = [
        *misfit_findings(estimation),
        *parameter_findings(estimation),
        *sampling_findings(session),
        *saturation_findings(session),
        *excitation_findings(estimation, snr_db),
    ]
    determined = not undetermined(estimation)
    if determined or not estimation.holds:
        findings += _causes(estimation)
    if determined and estimation.holds:
        findings += [*whiteness_findings(estimation), *lift_off_findings(estimation)]
    return Quality(
        tuple(findings),
        estimation.chi2_per_n,
        chi2_by_run(estimation),
        snr_db,
    )


def _judge_real_car(session: Session, estimation: Estimation) -> Quality:
    """Judge a nonlinear fit: what a linear model would name as causes are elements of it."""
    snr_db = mode_snr_db(estimation)
    findings = [
        *misfit_findings(estimation),
        *parameter_findings(estimation),
        *sampling_findings(session),
        *saturation_findings(session),
        *excitation_findings(estimation, snr_db),
    ]
    if estimation.holds and not undetermined(estimation):
        findings += whiteness_findings(estimation)
    return Quality(tuple(findings), estimation.chi2_per_n, chi2_by_run(estimation), snr_db)


def _causes(estimation: Estimation) -> tuple[Finding, ...]:
    """Report an outlying run first, because it imitates other causes; amplitude last."""
    ranked = rank_causes(estimation)
    repeats = repeat_findings(estimation, ranked[0].strength)
    if any(finding.code == "odd_run" for finding in repeats):
        return repeats
    causes = cause_findings(estimation, ranked)
    explained = bool(causes) and not {finding.code for finding in causes} & _NON_LINEAR
    return causes if explained else (*causes, *repeats)
