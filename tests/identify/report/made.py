"""Sessions of the stress list with their reports, each made once; and what blocks hold."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

from daq.sessions import Session
from daq.vehicle import FORD_GRANADA
from identify import Identification, identify, identify_parameters
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.pipeline import grey_box
from identify.report.content import report_of
from identify.report.evidence import CrossChecks, cross_checks
from identify.report.page import Picture, Report, Section, Source, Table

from ..stress import stress_session

SOURCE = Source("car.h5", "ab" * 32, "1.2", {"numpy": "2.1", "scipy": "1.14"}, "2026-11-22")
HOSTILE = "</script><script>alert(1)</script> $\\frac{1 & <b>"


@cache
def recorded(name: str) -> Session:
    """Return one run of each kind of a session of the stress list."""
    whole = stress_session(name, 1, 100.0)
    return replace(whole, runs=tuple(run for run in whole.runs if run.repeat == 1))


@cache
def made(name: str) -> tuple[Session, Identification]:
    return recorded(name), identify(recorded(name))


@cache
def without_modes(name: str) -> tuple[Session, Identification]:
    return recorded(name), identify_parameters(recorded(name))


@cache
def reported(name: str) -> Report:
    session, result = made(name)
    assert result.estimation is not None
    return report_of(session, result, cross_checks(result.estimation), SOURCE)


@cache
def estimated(name: str) -> Estimation:
    """Return the fit alone, begun at the truth."""
    session = recorded(name)
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
    (first, *others) = result.quality.findings
    findings = (replace(first, text=HOSTILE), *others)
    result = replace(result, quality=replace(result.quality, findings=findings))
    report = report_of(session, result, CrossChecks(), replace(SOURCE, name=HOSTILE))
    kept = [s for s in report.sections if s.key in {"parameters", "runs", "provenance"}]
    return replace(report, sections=tuple(kept))


def tables(section: Section) -> dict[str, Table]:
    """Return the tables of a section by their title."""
    return {block.title: block for block in section.blocks if isinstance(block, Table)}


def texts(table: Table) -> list[list[str]]:
    return [list(row) for row in table.rows]


def picture(section: Section, key: str) -> Picture:
    (found,) = (one for one in section.pictures if one.key == key)
    return found


def drawn(picture: Picture) -> tuple[Any, ...]:
    """Return the data that a picture draws."""
    assert isinstance(picture.draw, partial)
    return picture.draw.args
