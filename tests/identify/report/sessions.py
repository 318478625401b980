"""Sessions of the stress list with their identifications, each made once."""

from dataclasses import replace
from functools import cache

from daq.sessions import Session
from daq.vehicle import FORD_GRANADA
from identify import Identification, identify
from identify.cross_checks import CrossChecks, cross_checks
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.pipeline import grey_box
from identify.report.blocks import Report, Source
from identify.report.content import report_of

from ..stress import stress_session

SOURCE = Source("car.h5", "ab" * 32, "0.0", {"numpy": "2"})
HOSTILE = "</script><script>alert(1)</script> $\\frac{1 & <b>"


@cache
def made(name: str) -> tuple[Session, Identification]:
    whole = stress_session(name, 1, 100.0)
    session = replace(whole, runs=tuple(run for run in whole.runs if run.repeat == 1))
    return session, identify(session)


@cache
def reported(name: str) -> Report:
    session, result = made(name)
    assert result.estimation is not None
    return report_of(session, result, cross_checks(result.estimation), SOURCE)


@cache
def estimated(name: str) -> Estimation:
    """Return the fit alone, begun at the truth."""
    session = stress_session(name, 1, 100.0)
    records = usable(session).records
    return estimate(grey_box(session, records), records, [FORD_GRANADA.to_array()])


@cache
def hostile() -> Report:
    """Return the report of a vehicle and a run whose texts try to break out of the page."""
    session, result = made("linear")
    run = replace(session.runs[0], reasons=(HOSTILE,))
    session = replace(
        session,
        vehicle=replace(session.vehicle, name=HOSTILE),
        runs=(run, *session.runs[1:]),
        provenance={**session.provenance, "bench_toml": HOSTILE},
    )
    report = report_of(session, result, CrossChecks(), replace(SOURCE, name=HOSTILE))
    kept = [s for s in report.sections if s.key in {"parameters", "runs", "provenance"}]
    finding = {"gate": "chi2", "severity": "ok", "text": HOSTILE}
    document = {**report.document, "findings": [finding]}
    return replace(report, sections=tuple(kept), document=document)
